"""A parallel gripper that picks up and puts down a free part: two driven fingers that hold it by friction alone."""

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
"""kg and kg m^2, inertia of the link that carries the hand, so large that the hand does not affect the motion."""
SPEED, EASY = 0.1, 10.0
"""m/s, speed of the moving fingers, and N, force of their drive at this speed."""
TOUCH, SQUEEZE = 0.1, 0.1
"""s that the fingers have to make contact, and s in which the full force builds up."""
PAD = 0.015
"""m, half the edge of a square pad."""
SPRING, TWIST, DAMPING = 1000.0, 0.5, 0.3
"""N/m, Nm/rad and damping ratio of the nest that holds the part before it is gripped and after it is released."""
FAR = np.full(3, 50.0)
"""m, position of the part while it is absent."""


@dataclass(frozen=True)
class Part:
    """A gripped box of non-uniform density."""

    mass: float
    """kg."""
    half: Floats
    """(3,) m, half the edges; the pads press on the faces across x."""
    center: Floats
    """(3,) m, centre of mass from the middle of the box."""


@dataclass(frozen=True)
class Gripper:
    """A hand that is open unless it holds its part; it closes along the x axis of the sensor."""

    middle: Floats
    """(3,) m, point between the pads, sensor frame."""
    masses: tuple[float, float]
    """kg of the two fingers, one of which carries more of the drive."""
    stroke: float
    """m, travel of each finger from open to the part."""
    force: float
    """N, force of the drive on each finger while it holds the part."""
    friction: float
    """Coefficient between pads and part."""
    part: Part

    @property
    def closes(self) -> float:
        """Duration in s from the start of a grip until the part is held with full force."""
        return self.stroke / SPEED + TOUCH + SQUEEZE


@dataclass(frozen=True)
class Handover:
    """One pick-up or put-down of the part, during which the arm is at rest."""

    start: float
    """s at which the fingers begin to close, or the nest begins to take the weight."""
    gone: float
    """s at which the arm is about to move on, and a part that was put down is removed."""
    takes: float
    """s, duration of the transfer of the weight."""
    offset: Floats
    """(3,) m, offset of the presented part from the middle of the pads."""


def at_rest(scene: Scene) -> list[tuple[float, float]]:
    """Return (first, last) s of each interval in which the arm is at rest."""
    moving = np.abs(scene.motion(scene.grid)[1]).max(1) > 1e-9
    edges = np.diff(np.concatenate([[True], moving, [True]]).astype(int))
    first, end = np.flatnonzero(edges < 0), np.flatnonzero(edges > 0)
    return [(float(scene.grid[a]), float(scene.grid[b - 1])) for a, b in zip(first, end, strict=True)]


def with_fingers(scene: Scene, gripper: Gripper) -> Scene:
    """Return the scene whose nominal tool includes the open fingers."""
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
    """Simulate the wrench while the hand alternately picks up the part and puts it down.

    Args:
        scene: scene whose nominal tool is the hand without fingers.
        gripper: gripper with its part.
        handovers: pick-ups and put-downs in turn and in order of time, a pick-up first.

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
    """Model of the last link, whose motion is imposed, with the hand on it, and of the part.

    The link's frame is between the pads, because MuJoCo's contacts treat a rotating body as one that moves straight on,
    and friction far from the frame would slip.
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
    """MJCF of two bodies that slide synchronously along x, open at 0."""
    text, away = "", gripper.part.half[0] + gripper.stroke + PAD / 2
    for name, side, mass in zip(("left", "right"), (-1.0, 1.0), gripper.masses, strict=True):
        text += f"""<body name="{name}" pos="{_text(gripper.middle + np.array([side * away, 0, 0]))}">
            <joint name="{name}" type="slide" axis="{-side} 0 0" limited="true" range="0 {gripper.stroke + 0.005!r}"
            damping="{EASY / SPEED!r}" solreflimit="0.004 1" solimplimit="0.99 0.99 0.001"/>
            {inertial(mass, np.zeros(3), 2e-4 * mass * np.eye(3))}{_pad(gripper, side)}</body>"""
    return text


def _pad(gripper: Gripper, side: float) -> str:
    """MJCF of a pad as four balls at its corners, because the contact points of a box change from step to step."""
    corners = [np.array([-side * PAD / 4, y, z]) for y in (-PAD, PAD) for z in (-PAD, PAD)]
    return "".join(
        f'<geom size="{PAD / 4!r}" pos="{_text(at)}" mass="0" contype="1" conaffinity="2" {_contact(gripper)}/>'
        for at in corners
    )


def _contact(gripper: Gripper) -> str:
    return f'condim="4" friction="{gripper.friction!r} 0.005 0.0001" solref="0.004 1" solimp="0.99 0.99 0.001"'


def _shares(t: Floats, gripper: Gripper, handovers: list[Handover]) -> Floats:
    """Share (T,) of the part's weight that the nest carries, with linear ramps in time."""
    share = np.ones(len(t))
    for h in handovers[::2]:
        share -= np.clip((t - h.start - gripper.closes) / h.takes, 0, 1)
    for h in handovers[1::2]:
        share += np.clip((t - h.start) / h.takes, 0, 1)
    return share


def _drives(t: Floats, gripper: Gripper, handovers: list[Handover]) -> Floats:
    """Force (T,) N of the drive on each finger, positive if it closes."""
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
    """Set the part to rest at a pose; returns the pose (7,)."""
    data.qpos[9:], data.qvel[8:] = [*place, *turn], 0
    return data.qpos[9:].copy()


def _hold(model: mujoco.MjModel, data: mujoco.MjData, home: Floats, share: float) -> None:
    """Apply the forces of the nest: its share of the weight, and springs to the part's home pose (7,)."""
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
