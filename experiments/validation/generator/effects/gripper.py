"""A parallel gripper that takes a part up and puts it down: two fingers with a drive, a free part, friction alone."""

from __future__ import annotations

from dataclasses import dataclass, replace

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from validation.generator.arms import Floats
from validation.generator.effects.effect import Scene
from validation.generator.effects.sprung import inertial
from validation.generator.nominal_model import Tool
from validation.generator.world import STEP, nominal_world, tool_path, wrench

IMPOSED = 1e6
"""kg and kg m^2 of the link that carries the hand, so that nothing that the hand does changes the motion."""
SPEED, EASY = 0.1, 10.0
"""m/s of the fingers, and N of the drive, while they move."""
TOUCH, SQUEEZE = 0.1, 0.1
"""s that the fingers have to touch in, and that the full force needs to build up."""
PAD = 0.015
"""m, half the edge of a pad, which is square."""
SPRING, TWIST, DAMPING = 1000.0, 0.5, 0.3
"""N/m, Nm/rad and damping ratio of the nest that holds the part before it is gripped and after it is put down."""
FAR = np.full(3, 50.0)
"""m, where the part is while it is not there."""


@dataclass(frozen=True)
class Part:
    """A box that is gripped, not everywhere of one density."""

    mass: float
    """kg."""
    half: Floats
    """(3,) m, half its edges; the pads press on the faces across x."""
    center: Floats
    """(3,) m, of mass, from the middle of the box."""


@dataclass(frozen=True)
class Gripper:
    """A hand, open but for the part; it closes along the x axis of the sensor."""

    middle: Floats
    """(3,) m, sensor frame, between the pads."""
    masses: tuple[float, float]
    """kg of the fingers: one carries more of the drive than the other."""
    stroke: float
    """m of each finger from open to the part."""
    force: float
    """N of the drive on each finger while it holds the part."""
    friction: float
    """Coefficient between pads and part."""
    part: Part

    @property
    def closes(self) -> float:
        """S from the start of a grip until the part is held with full force."""
        return self.stroke / SPEED + TOUCH + SQUEEZE


@dataclass(frozen=True)
class Handover:
    """The part is taken up, or put down; the arm is at rest meanwhile."""

    start: float
    """s at which the fingers begin to close, or the nest begins to take the weight."""
    gone: float
    """s at which the arm is about to move on; a part that was put down is taken away."""
    takes: float
    """s for the weight to go over."""
    offset: Floats
    """(3,) m by which the part is presented off the middle of the pads."""


def at_rest(scene: Scene) -> list[tuple[float, float]]:
    """(first, last) s of the spells in which the arm is still."""
    moving = np.abs(scene.motion(scene.grid)[1]).max(1) > 1e-9
    edges = np.diff(np.concatenate([[True], moving, [True]]).astype(int))
    first, end = np.flatnonzero(edges < 0), np.flatnonzero(edges > 0)
    return [(float(scene.grid[a]), float(scene.grid[b - 1])) for a, b in zip(first, end, strict=True)]


def with_fingers(scene: Scene, gripper: Gripper) -> Scene:
    """The scene of an owner who knows the tool with its fingers, open."""
    model = _model(scene, gripper)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    bodies = [model.body(name).id for name in ("tool", "left", "right")]
    mass, places = model.body_mass[bodies], data.xipos[bodies]
    center = mass @ places / mass.sum()
    inertia = np.zeros((3, 3))
    for body, arm, own in zip(bodies, places - center, mass, strict=True):
        axes = data.ximat[body].reshape(3, 3)
        inertia += axes @ np.diag(model.body_inertia[body]) @ axes.T + own * (
            arm @ arm * np.eye(3) - np.outer(arm, arm)
        )
    belief = replace(scene.belief, tool=Tool(float(mass.sum()), center - data.body("tool").xpos, inertia))
    world = nominal_world(belief)
    return replace(scene, belief=belief, world=world, nominal=wrench(world, scene.motion, scene.grid))


def carried(scene: Scene, gripper: Gripper, handovers: list[Handover]) -> tuple[Floats, Floats]:
    """What the sensor feels while the hand takes the part up and puts it down in turn.

    Args:
        scene: with the hand alone as its tool, without fingers.
        gripper: with the part.
        handovers: in time; the part is taken up first.

    Returns:
        wrench (S, 6) N, Nm on the scene's grid; the part's centre of mass (S, 3) m, sensor frame, NaN while it is not
        held.
    """
    model = _model(scene, gripper)
    data = mujoco.MjData(model)
    t = scene.grid
    path = tool_path(scene.world, scene.motion, t)
    middle, spin = path.points(gripper.middle), np.einsum("tji,tj->ti", path.rotation, path.angular_velocity())
    turns = Rotation.from_matrix(path.rotation).as_quat(scalar_first=True)
    speeds = np.concatenate([path.velocity(gripper.middle), spin], 1)
    rates = np.gradient(speeds, t, axis=0)
    shares, drives = _shares(t, gripper, handovers), _drives(t, gripper, handovers)
    presented = {int((h.start - 0.05 - t[0]) / STEP): h.offset for h in handovers[::2]}
    put_down = {int((h.start - t[0]) / STEP) for h in handovers[1::2]}
    removed = {int((h.gone - t[0]) / STEP) for h in handovers[1::2]}
    reading, center = np.empty((len(t), 6)), np.full((len(t), 3), np.nan)
    home = _moved(data, FAR, turns[0])
    for k in range(len(t)):
        data.qpos[:3], data.qpos[3:7], data.qvel[:6] = middle[k], turns[k], speeds[k]
        if k in presented:
            home = _moved(data, middle[k] + path.rotation[k] @ presented[k], turns[k])
        elif k in put_down:
            home = data.qpos[9:].copy()
        elif k in removed:
            home = _moved(data, FAR, turns[0])
        data.qfrc_applied[:6] = IMPOSED * rates[k]
        data.qfrc_applied[6:8] = drives[k]
        if shares[k] < 1:
            own = Rotation.from_quat(data.qpos[12:], scalar_first=True).apply(gripper.part.center)
            center[k] = path.rotation[k].T @ (data.qpos[9:12] + own - path.position[k])
        _hold(model, data, home, shares[k])
        mujoco.mj_step(model, data)
        reading[k] = data.sensordata
    return reading, center


def _model(scene: Scene, gripper: Gripper) -> mujoco.MjModel:
    """The last link, moved at will, with the hand on it, and the part.

    The link's frame is between the pads: MuJoCo's contacts take a turning body for one that goes straight on, and far
    from the frame friction would slip for that.
    """
    part, edges = gripper.part, 2 * gripper.part.half
    inertia = part.mass / 12 * np.diag((edges**2).sum() - edges**2)
    tool = scene.belief.tool
    return mujoco.MjModel.from_xml_string(f"""<mujoco><compiler angle="radian"/>
        <option gravity="{_text(scene.belief.gravity)}" timestep="{STEP!r}" integrator="RK4" cone="elliptic"
        impratio="100" tolerance="1e-14" iterations="200" ls_tolerance="1e-6" ls_iterations="100"/><worldbody>
        <body name="link" gravcomp="1"><freejoint/>{inertial(IMPOSED, np.zeros(3), IMPOSED * np.eye(3))}
        <body name="tool" pos="{_text(-gripper.middle)}">{inertial(tool.mass, tool.com, tool.inertia)}
        <site name="sensor"/>{_fingers(gripper)}</body></body>
        <body name="part"><freejoint/>{inertial(part.mass, part.center, inertia)}
        <geom type="box" size="{_text(part.half)}" mass="0" contype="2" conaffinity="1" {_contact(gripper)}/></body>
        </worldbody><equality><joint joint1="left" joint2="right" solref="0.002 1" solimp="0.99 0.99 0.001"/></equality>
        <sensor><force site="sensor"/><torque site="sensor"/></sensor></mujoco>""")


def _fingers(gripper: Gripper) -> str:
    """Two bodies that slide along x in step, open at 0."""
    text, away = "", gripper.part.half[0] + gripper.stroke + PAD / 2
    for name, side, mass in zip(("left", "right"), (-1.0, 1.0), gripper.masses, strict=True):
        text += f"""<body name="{name}" pos="{_text(gripper.middle + np.array([side * away, 0, 0]))}">
            <joint name="{name}" type="slide" axis="{-side} 0 0" limited="true" range="0 {gripper.stroke + 0.005!r}"
            damping="{EASY / SPEED!r}" solreflimit="0.004 1" solimplimit="0.99 0.99 0.001"/>
            {inertial(mass, np.zeros(3), 2e-4 * mass * np.eye(3))}{_pad(gripper, side)}</body>"""
    return text


def _pad(gripper: Gripper, side: float) -> str:
    """Four balls at its corners: a pad that is a box touches here in one step and there in the next."""
    corners = [np.array([-side * PAD / 4, y, z]) for y in (-PAD, PAD) for z in (-PAD, PAD)]
    return "".join(
        f'<geom size="{PAD / 4!r}" pos="{_text(at)}" mass="0" contype="1" conaffinity="2" {_contact(gripper)}/>'
        for at in corners
    )


def _contact(gripper: Gripper) -> str:
    return f'condim="4" friction="{gripper.friction!r} 0.005 0.0001" solref="0.004 1" solimp="0.99 0.99 0.001"'


def _shares(t: Floats, gripper: Gripper, handovers: list[Handover]) -> Floats:
    """(T,) how much of the part's weight the nest carries: less, or more, along a straight line in time."""
    share = np.ones(len(t))
    for h in handovers[::2]:
        share -= np.clip((t - h.start - gripper.closes) / h.takes, 0, 1)
    for h in handovers[1::2]:
        share += np.clip((t - h.start) / h.takes, 0, 1)
    return share


def _drives(t: Floats, gripper: Gripper, handovers: list[Handover]) -> Floats:
    """(T,) N of the drive on each finger, positive where it closes."""
    times, values = [t[0]], [-EASY]
    for h in handovers[::2]:
        times += [h.start, h.start + 0.01, h.start + gripper.closes - SQUEEZE, h.start + gripper.closes]
        values += [-EASY, EASY, EASY, gripper.force]
    for h in handovers[1::2]:
        times += [h.start + h.takes, h.start + h.takes + SQUEEZE]
        values += [gripper.force, -EASY]
    order = np.argsort(times)
    return np.interp(t, np.array(times)[order], np.array(values)[order])


def _moved(data: mujoco.MjData, place: Floats, turn: Floats) -> Floats:
    """(7,) where the part is from now on, at rest."""
    data.qpos[9:], data.qvel[8:] = [*place, *turn], 0
    return data.qpos[9:].copy()


def _hold(model: mujoco.MjModel, data: mujoco.MjData, home: Floats, share: float) -> None:
    """The nest carries its share of the weight, and holds the part where its home (7,) is."""
    part = model.body("part").id
    mass, inertia = model.body_mass[part], model.body_inertia[part].min()
    by, turn = np.empty(3), np.empty(9)
    mujoco.mju_subQuat(by, data.qpos[12:], home[3:])
    mujoco.mju_quat2Mat(turn, data.qpos[12:])
    push = SPRING * (home[:3] - data.qpos[9:12]) - 2 * DAMPING * np.sqrt(SPRING * mass) * data.qvel[8:11]
    twist = -TWIST * by - 2 * DAMPING * np.sqrt(TWIST * inertia) * data.qvel[11:]
    data.xfrc_applied[part, :3] = share * (push - mass * model.opt.gravity)
    data.xfrc_applied[part, 3:] = share * (turn.reshape(3, 3) @ twist)


def _text(values: Floats) -> str:
    return " ".join(repr(float(value)) for value in values)
