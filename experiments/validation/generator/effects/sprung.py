"""A part of the tool on springs (flexibility) or hanging free (sloshing): its MuJoCo body and its motion in time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from validation.generator.arms import Floats
from validation.generator.nominal_model import Tool

SUBSTEP = 5e-4  # s, integration step; the simulated wrench has twice this spacing
SETTLE = 1.0  # s of heavy damping at the start, so that the log does not begin with the transient of the start


@dataclass(frozen=True)
class Sprung:
    """A part of the tool that can move relative to the rest; undeflected, both together are the nominal tool."""

    kind: str
    """"lateral": two slides; "pivot": two hinges at the sensor; "hinge": one of them; "pendulum": a bob hanging from
    the centre of mass, whose weight seems to act there."""
    share: float
    """Share of the tool's mass (and inertia) in the moving part."""
    hz: float
    """Natural frequency with the sensor held fixed."""
    zeta: float
    """Damping ratio."""
    counterbalanced: bool = False
    """Whether a constant-force balance carries the weight; otherwise gravity deflects the springs and the part sags."""


def sprung_mjcf(tool: Tool, sprung: Sprung | None, gravity: Floats) -> tuple[str, str]:
    """Return the inertial element of the rigid part and the child body of the moving part (empty without one)."""
    if sprung is None:
        return inertial(tool.mass, tool.com, tool.inertia), ""
    moving = sprung.share * tool.mass
    if sprung.kind == "pendulum":
        rigid = inertial(tool.mass - moving, tool.com, tool.inertia)
        length = float(np.linalg.norm(gravity)) / (2 * np.pi * sprung.hz) ** 2
        damping = 2 * sprung.zeta * 2 * np.pi * sprung.hz * moving * length**2
        bob = inertial(moving, np.array([0, 0, -length]), 0.05 * moving * length**2 * np.eye(3))
        return rigid, f'<body pos="{_text(tool.com)}"><joint type="ball" damping="{damping!r}"/>{bob}</body>'
    rigid = inertial(tool.mass - moving, tool.com, (1 - sprung.share) * tool.inertia)
    joints = "".join(_spring_joint(sprung, *joint) for joint in _joints(tool, sprung))
    return rigid, f"<body>{joints}{inertial(moving, tool.com, sprung.share * tool.inertia)}</body>"


def _joints(tool: Tool, sprung: Sprung) -> list[tuple[str, Floats, Floats, float]]:
    """Type, axis, point (tool frame) and moved inertia (kg or kg m^2) of every spring joint."""
    x, y, c = np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), tool.com
    mass, inertia = sprung.share * tool.mass, sprung.share * tool.inertia
    if sprung.kind == "lateral":
        return [("slide", axis, c, mass) for axis in (x, y)]
    axes = (x,) if sprung.kind == "hinge" else (x, y)
    about_sensor = inertia + mass * (c @ c * np.eye(3) - np.outer(c, c))
    return [("hinge", axis, np.zeros(3), float(axis @ about_sensor @ axis)) for axis in axes]


def _spring_joint(sprung: Sprung, kind: str, axis: Floats, point: Floats, moved: float) -> str:
    omega = 2 * np.pi * sprung.hz
    stiffness, damping = moved * omega**2, 2 * sprung.zeta * omega * moved
    return (
        f'<joint type="{kind}" axis="{_text(axis)}" pos="{_text(point)}" '
        f'stiffness="{stiffness!r}" damping="{damping!r}"/>'
    )


def swing(
    model: mujoco.MjModel,
    n: int,
    sprung: Sprung,
    arm_motion: Callable[[Floats], tuple[Floats, Floats, Floats]],
    t: Floats,
) -> tuple[Floats, Floats, Floats]:
    """Motion of arm and moving part: qpos, qvel, qacc at the times t (T,) s, with the motion of the arm imposed.

    Hybrid dynamics by MuJoCo's inverse dynamics: with zero accelerations of the moving part they return the force r
    that this requires; without that force, M a = -r. M, the mass matrix of the part, is that of its rest position.

    Args:
        model: model of arm, tool and part.
        n: number of joints of the arm.
        sprung: the moving part.
        arm_motion: true joint motion as a function of time.
        t: s, evenly spaced by a multiple of SUBSTEP.
    """
    every = round((t[1] - t[0]) / SUBSTEP)
    fine = t[0] + SUBSTEP * np.arange(every * (len(t) - 1) + 1)
    q, dq, ddq = arm_motion(fine)
    data = mujoco.MjData(model)
    start = data.qpos.copy()
    start[:n] = q[0]
    if sprung.kind == "pendulum":
        start[n:] = _hanging(model, start)
    mass = _mass_matrix(model, start, n)
    damping = model.dof_damping.copy()
    positions, rates, accelerations = [], [], []
    data.qpos[:] = start
    for k in range(len(fine)):
        model.dof_damping[:] = damping * (1 / sprung.zeta if fine[k] < t[0] + SETTLE else 1)
        data.qpos[:n], data.qvel[:n], data.qacc[:n] = q[k], dq[k], ddq[k]
        data.qacc[n:] = 0
        mujoco.mj_inverse(model, data)
        residual = data.qfrc_inverse[n:] + (_weight(model, data, n) if sprung.counterbalanced else 0)
        data.qacc[n:] = np.linalg.solve(mass, -residual)
        if k % every == 0:
            positions.append(data.qpos.copy())
            rates.append(data.qvel.copy())
            accelerations.append(data.qacc.copy())
        data.qvel[n:] += SUBSTEP * data.qacc[n:]
        mujoco.mj_integratePos(model, data.qpos, data.qvel, SUBSTEP)
    model.dof_damping[:] = damping
    return np.array(positions), np.array(rates), np.array(accelerations)


def _mass_matrix(model: mujoco.MjModel, qpos: Floats, n: int) -> Floats:
    """Mass matrix of the moving part's degrees of freedom, those after the first n, at qpos."""
    data = mujoco.MjData(model)

    def needed(acceleration: Floats) -> Floats:
        data.qpos[:], data.qvel[:], data.qacc[:] = qpos, 0, 0
        data.qacc[n:] = acceleration
        mujoco.mj_inverse(model, data)
        return data.qfrc_inverse[n:].copy()

    unit = np.eye(model.nv - n)
    return np.stack([needed(column) - needed(0 * column) for column in unit], 1)


def _weight(model: mujoco.MjModel, data: mujoco.MjData, n: int) -> Floats:
    """Generalised force of gravity on the moving part's degrees of freedom."""
    jacobian = np.zeros((3, model.nv))
    part = model.nbody - 1
    mujoco.mj_jacBodyCom(model, data, jacobian, None, part)
    return model.body_mass[part] * jacobian[:, n:].T @ model.opt.gravity


def _hanging(model: mujoco.MjModel, qpos: Floats) -> Floats:
    """Quaternion of the ball joint with the bob hanging straight down."""
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    down = data.body("tool").xmat.reshape(3, 3).T @ model.opt.gravity
    rotation, _ = Rotation.align_vectors(down[None], np.array([[0.0, 0.0, -1.0]]))
    return rotation.as_quat(scalar_first=True)


def inertial(mass: float, com: Floats, inertia: Floats) -> str:
    """Return the MuJoCo inertial element: kg, m, kg m^2 about the centre of mass; body axes."""
    xx, xy, xz, yy, yz, zz = inertia[np.triu_indices(3)]
    full = _text(np.array([xx, yy, zz, xy, xz, yz]))
    return f'<inertial pos="{_text(com)}" mass="{float(mass)!r}" fullinertia="{full}"/>'


def _text(values: Floats) -> str:
    return " ".join(repr(float(value)) for value in values)
