"""Pose, twist, acceleration and tool wrench against two independent physics engines."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.filtering.pipeline import predict_wrench
from ftbias_jax.model.params import Params
from ftbias_jax.model.wrench.tool_wrench import tool_parameters
from ftbias_jax.setup.rotations import rotation_from_rpy
from ftbias_jax.types import Array

GRAVITY = np.array([1.0, -2.0, -9.5])
MASS = 0.9
CENTER = np.array([0.02, -0.03, 0.07])
PRINCIPAL_INERTIA = np.array([0.004, 0.003, 0.002])
PRINCIPAL_AXES = rotation_from_rpy(np.array([0.3, -0.5, 0.8]))


class Observed(NamedTuple):
    """What an engine says of the sensor frame, in the conventions of the package."""

    rotation: Array
    position: Array
    twist: Array
    acceleration: Array
    wrench: Array


def axes_and_points(arm):
    """Of each joint: whether it turns, its axis, and a point on it."""
    for linear, angular in zip(np.asarray(arm.linear), np.asarray(arm.angular), strict=True):
        turns = bool(angular.any())
        yield turns, angular if turns else linear, np.cross(angular, linear)


def pinocchio(arm, q, dq, ddq):
    pin = pytest.importorskip("pinocchio", reason="Pinocchio (pip install pin) is not installed")
    model = pin.Model()
    model.gravity.linear = GRAVITY
    parent, origin = 0, np.zeros(3)
    for turns, axis, point in axes_and_points(arm):
        joint = pin.JointModelRevoluteUnaligned(axis) if turns else pin.JointModelPrismaticUnaligned(axis)
        parent = model.addJoint(parent, joint, pin.SE3(np.eye(3), point - origin), f"joint{parent}")
        origin = point
    mount = pin.SE3(np.asarray(arm.zero_rotation), np.asarray(arm.zero_position) - origin)
    inertia = PRINCIPAL_AXES @ np.diag(PRINCIPAL_INERTIA) @ PRINCIPAL_AXES.T
    model.appendBodyToJoint(parent, pin.Inertia(MASS, CENTER, inertia), mount)
    sensor = model.addFrame(pin.Frame("sensor", parent, mount, pin.FrameType.OP_FRAME))
    data = model.createData()
    pin.forwardKinematics(model, data, q, dq, ddq)
    pose = pin.updateFramePlacement(model, data, sensor)
    twist = pin.getFrameVelocity(model, data, sensor, pin.LOCAL_WORLD_ALIGNED).vector
    acceleration = pin.getFrameClassicalAcceleration(model, data, sensor, pin.LOCAL_WORLD_ALIGNED).vector
    pin.rnea(model, data, q, dq, ddq)
    return Observed(pose.rotation, pose.translation, twist, acceleration, mount.actInv(data.f[parent]).vector)


def mujoco(arm, q, dq, ddq):
    mj = pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    model = mj.MjModel.from_xml_string(mjcf(arm))
    data = mj.MjData(model)
    data.qpos, data.qvel, data.qacc = q, dq, ddq
    mj.mj_inverse(model, data)
    site = mj.mjtObj.mjOBJ_SITE
    twist, acceleration = np.zeros(6), np.zeros(6)
    mj.mj_objectVelocity(model, data, site, 0, twist, 0)
    mj.mj_objectAcceleration(model, data, site, 0, acceleration, 0)
    twist, acceleration = np.roll(twist, 3), np.roll(acceleration, 3)  # MuJoCo puts the angular part first
    acceleration[:3] += GRAVITY  # and reports what an accelerometer feels
    return Observed(data.site_xmat[0].reshape(3, 3), data.site_xpos[0], twist, acceleration, data.sensordata)


def mjcf(arm):
    """The arm with all link frames on the base at q = 0, massless but for the tool."""

    def numbers(x):
        return " ".join(repr(float(value)) for value in np.ravel(x))

    links = [
        f'<body><inertial pos="0 0 0" mass="1e-9" diaginertia="1e-9 1e-9 1e-9"/>'
        f'<joint type="{"hinge" if turns else "slide"}" axis="{numbers(axis)}" pos="{numbers(point)}"/>'
        for turns, axis, point in axes_and_points(arm)
    ]
    sensor = f'pos="{numbers(arm.zero_position)}" xyaxes="{numbers(arm.zero_rotation[:, :2].T)}"'
    tool = (
        f'<body {sensor}><inertial pos="{numbers(CENTER)}" mass="{MASS}" diaginertia="{numbers(PRINCIPAL_INERTIA)}" '
        f'xyaxes="{numbers(PRINCIPAL_AXES[:, :2].T)}"/><site name="sensor"/></body>'
    )
    return f"""
    <mujoco><compiler angle="radian"/><option gravity="{numbers(GRAVITY)}"/>
      <worldbody>{"".join(links)}{tool}{"</body>" * len(links)}</worldbody>
      <sensor><force site="sensor"/><torque site="sensor"/></sensor>
    </mujoco>"""


@jax.jit
def ours(arm, q, dq, ddq):
    inertia = PRINCIPAL_AXES @ np.diag(PRINCIPAL_INERTIA) @ PRINCIPAL_AXES.T
    theta = tool_parameters(jnp.asarray(MASS), CENTER, jnp.asarray(inertia[np.triu_indices(3)]))
    params = Params(arm, jnp.asarray(GRAVITY), theta, joint=None, bias=None)
    motion, wrench = predict_wrench(params, jnp.stack([q, dq, ddq], 1))
    twist = jnp.concatenate([motion.linear_velocity, motion.angular_velocity])
    acceleration = jnp.concatenate([motion.linear_acceleration, motion.angular_acceleration])
    return Observed(motion.R_base_sensor, motion.p_base_sensor, twist, acceleration, wrench)


@pytest.mark.parametrize("engine", [pinocchio, mujoco])
@pytest.mark.parametrize("seed", range(3))
def test_an_independent_engine_agrees(engine, arm, seed):
    state = np.random.default_rng(seed).uniform(-2, 2, (3, len(arm.linear)))
    for name, expected, value in zip(Observed._fields, engine(arm, *state), ours(arm, *state), strict=True):
        difference = np.linalg.norm(value - expected) / np.linalg.norm(expected)
        assert difference < 1e-9, f"{name} differs by {difference:.1e}"
