"""The physics: MuJoCo moves the tool along an imposed joint motion; its force and torque sensors measure the wrench.

Every wrench here is the one that the sensor exerts on the tool, in the sensor frame, torque about the sensor origin.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from validation.generator.arms import Arm, Floats
from validation.generator.effects.rotor import Rotor, rotor_mjcf, spinning
from validation.generator.effects.sprung import Sprung, sprung_mjcf, swing
from validation.generator.motion import Trajectory
from validation.generator.nominal_model import Belief, Tool

STEP = 1e-3  # s, spacing of simulated wrenches
BEFORE, AFTER = 1.5, 0.5  # s simulated before and after the log, needed by delays, filters and jitter


@dataclass(frozen=True)
class Cable:
    """One elastic strand from an anchor to the tool, slack below its rest length; two make a stiffening cable."""

    stiffness: float
    """N/m."""
    length: float
    """m, rest length."""
    anchor: Floats
    """(3,) m, base frame at q = 0."""
    on_forearm: bool
    end: Floats
    """(3,) m, attachment to the tool, sensor frame."""


@dataclass(frozen=True)
class ToolPath:
    """Path of the tool: time (T,) s, rotation (T, 3, 3) and position (T, 3) m of its frame in the base frame."""

    t: Floats
    rotation: Floats
    position: Floats

    def points(self, point: Floats) -> Floats:
        """Positions (T, 3) m in the base frame of a point (3,) m of the tool frame."""
        return self.position + self.rotation @ point

    def velocity(self, point: Floats) -> Floats:
        """Velocity (T, 3) m/s in the base frame of a point (3,) m of the tool frame."""
        velocity: Floats = np.gradient(self.points(point), self.t, axis=0).astype(np.float64)
        return velocity

    def acceleration(self, point: Floats) -> Floats:
        """Acceleration (T, 3) m/s^2 in the base frame of a point (3,) m of the tool frame."""
        acceleration: Floats = np.gradient(self.velocity(point), self.t, axis=0).astype(np.float64)
        return acceleration

    def angular_velocity(self) -> Floats:
        """Angular velocity (T, 3) rad/s of the tool in the base frame."""
        spin = np.gradient(self.rotation, self.t, axis=0) @ self.rotation.transpose(0, 2, 1)
        return np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], 1)


Load = Callable[[ToolPath], tuple[Floats, Floats]]
"""Tool path -> external force (T, 3) N and its point of application (T, 3) m, both in the base frame."""
Couple = Callable[[ToolPath], Floats]
"""Tool path -> external torque (T, 3) Nm in the base frame, without a force."""


@dataclass(frozen=True)
class World:
    """True parameters of the mechanics."""

    arm: Arm
    gravity: Floats
    """(3,) m/s^2, base frame."""
    mount_position: Floats
    """(3,) m, sensor origin in the flange frame."""
    mount_rotation: Floats
    """(3, 3) tool frame in the flange frame."""
    sensor_axes: Floats
    """(3, 3) true measurement axes of the sensor in the tool frame; identity if they are as stated in the setup."""
    tool: Tool
    joint_error: Callable[[Floats], Floats]
    """Measured joint positions (T, n) rad -> error of the encoders (T, n) rad, measured minus true."""
    cables: tuple[Cable, ...] = ()
    loads: tuple[Load, ...] = ()
    couples: tuple[Couple, ...] = ()
    sprung: Sprung | None = None
    rotor: Rotor | None = None


def nominal_world(belief: Belief) -> World:
    """Return the world of the nominal model, without effects."""
    return World(
        belief.arm,
        belief.gravity,
        belief.mount_position,
        Rotation.from_euler("xyz", belief.mount_rpy).as_matrix(),
        np.eye(3),
        belief.tool,
        np.zeros_like,
    )


def time_grid(duration: float) -> Floats:
    """Return the simulated times in s, from BEFORE a log of ``duration`` s until AFTER it."""
    return STEP * np.arange(-round(BEFORE / STEP), round((duration + AFTER) / STEP) + 1, dtype=np.float64)


def wrench(world: World, motion: Trajectory, t: Floats) -> Floats:
    """Simulate the wrench (T, 6) N, Nm at times t (T,) s, STEP apart, while the *encoders* read ``motion``."""
    model = build(world)
    q, dq, ddq = true_motion(world, motion, t)
    if world.sprung is not None:
        q, dq, ddq = swing(model, len(world.arm.home), world.sprung, lambda s: true_motion(world, motion, s), t)
    if world.rotor is not None:
        q, dq, ddq = spinning(world.rotor, q, dq, ddq, t)
    forces, torques = _external(world, model, t, q)
    data = mujoco.MjData(model)
    body = model.body("tool").id
    reading = np.empty((len(t), 6))
    for k in range(len(t)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], dq[k], ddq[k]
        if world.loads or world.couples:
            data.xfrc_applied[body, :3], data.xfrc_applied[body, 3:] = forces[k], torques[k]
        mujoco.mj_inverse(model, data)
        reading[k] = data.sensordata
    return reading


def true_motion(world: World, motion: Trajectory, t: Floats) -> tuple[Floats, Floats, Floats]:
    """True joint motion while the encoders read ``motion``; the rates of their slowly varying error are neglected."""
    q, dq, ddq = motion(t)
    return q - world.joint_error(q), dq, ddq


def tool_path(world: World, motion: Trajectory, t: Floats) -> ToolPath:
    """Return the path of the tool frame at the times t (T,) s."""
    return _follow(build(world), t, true_motion(world, motion, t)[0])


def cable_length(world: World, motion: Trajectory, t: Floats) -> Floats:
    """Distance (T,) m between the ends of the world's first cable at the times t (T,) s."""
    model = build(world)
    data = mujoco.MjData(model)
    lengths = []
    for q in true_motion(world, motion, t)[0]:
        data.qpos[:] = q
        mujoco.mj_fwdPosition(model, data)
        lengths.append(float(data.ten_length[0]))
    return np.array(lengths)


def _follow(model: mujoco.MjModel, t: Floats, q: Floats) -> ToolPath:
    data = mujoco.MjData(model)
    body = model.body("tool").id
    rotation, position = np.empty((len(t), 3, 3)), np.empty((len(t), 3))
    for k in range(len(t)):
        data.qpos[: q.shape[1]] = q[k]
        mujoco.mj_kinematics(model, data)
        rotation[k], position[k] = data.xmat[body].reshape(3, 3), data.xpos[body]
    return ToolPath(t, rotation, position)


def _external(world: World, model: mujoco.MjModel, t: Floats, q: Floats) -> tuple[Floats, Floats]:
    """Sum of loads and couples: force (T, 3) N, torque (T, 3) Nm about the tool's centre of mass, base frame."""
    force, torque = np.zeros((len(t), 3)), np.zeros((len(t), 3))
    if not world.loads and not world.couples:
        return force, torque
    path = _follow(model, t, q)
    center = path.points(model.body("tool").ipos)
    for load in world.loads:
        f, at = load(path)
        force += f
        torque += np.cross(at - center, f)
    for couple in world.couples:
        torque += couple(path)
    return force, torque


def build(world: World) -> mujoco.MjModel:
    """Build the MuJoCo model: a chain of links, the tool fixed to the last one, and a force and torque sensor there."""
    arm, tool = world.arm, world.tool
    last = len(arm.axes) - 1
    position = arm.flange_position + arm.flange_rotation @ world.mount_position - arm.points[last]
    rotation = arm.flange_rotation @ world.mount_rotation
    origin = np.vstack([np.zeros(3), arm.points[:-1]])
    links = ""
    for j, (axis, point, start) in enumerate(zip(arm.axes, arm.points, origin, strict=True)):
        links += f"""<body name="link{j}" pos="{_text(point - start)}"><joint type="hinge" axis="{_text(axis)}"/>
            <inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>"""
        if j == arm.forearm:
            links += _anchors(world.cables, True, point)
    tool, wheel = rotor_mjcf(tool, world.rotor)
    axes = _quaternion(world.sensor_axes)
    rigid, part = sprung_mjcf(tool, world.sprung, world.gravity)
    ends = "".join(f'<site name="end{i}" pos="{_text(cable.end)}"/>' for i, cable in enumerate(world.cables))
    return mujoco.MjModel.from_xml_string(f"""<mujoco><compiler angle="radian"/>
        <option gravity="{_text(world.gravity)}"><flag contact="disable"/></option><worldbody>
        {_anchors(world.cables, False, np.zeros(3))}{links}
        <body name="tool" pos="{_text(position)}" quat="{_quaternion(rotation)}">{rigid}
        <site name="sensor" quat="{axes}"/>{ends}{part}{wheel}</body>{"</body>" * len(arm.axes)}
        </worldbody>{_tendons(world.cables)}
        <sensor><force site="sensor"/><torque site="sensor"/></sensor></mujoco>""")


def _anchors(cables: tuple[Cable, ...], on_forearm: bool, origin: Floats) -> str:
    return "".join(
        f'<site name="anchor{i}" pos="{_text(cable.anchor - origin)}"/>'
        for i, cable in enumerate(cables)
        if cable.on_forearm == on_forearm
    )


def _tendons(cables: tuple[Cable, ...]) -> str:
    strands = "".join(
        f'<spatial stiffness="{cable.stiffness!r}" springlength="0 {cable.length!r}"><site site="anchor{i}"/>'
        f'<site site="end{i}"/></spatial>'
        for i, cable in enumerate(cables)
    )
    return f"<tendon>{strands}</tendon>" if cables else ""


def _text(values: Floats) -> str:
    return " ".join(repr(float(value)) for value in values)


def _quaternion(rotation: Floats) -> str:
    return _text(Rotation.from_matrix(rotation).as_quat(scalar_first=True))
