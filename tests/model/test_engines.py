"""Pose, twist, acceleration and tool wrench against an independent physics engine."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pinocchio as pin
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
    """Quantities of the sensor frame from an engine, in the conventions of the package."""

    rotation: Array
    position: Array
    twist: Array
    acceleration: Array
    wrench: Array


def axes_and_points(arm):
    """Whether each joint turns, its axis, and a point on the axis."""
    for linear, angular in zip(np.asarray(arm.linear), np.asarray(arm.angular), strict=True):
        turns = bool(angular.any())
        yield turns, angular if turns else linear, np.cross(angular, linear)


def pinocchio(arm, q, dq, ddq):
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


@jax.jit
def ours(arm, q, dq, ddq):
    inertia = PRINCIPAL_AXES @ np.diag(PRINCIPAL_INERTIA) @ PRINCIPAL_AXES.T
    theta = tool_parameters(jnp.asarray(MASS), CENTER, jnp.asarray(inertia[np.triu_indices(3)]))
    params = Params(arm, jnp.asarray(GRAVITY), theta, joint=None, bias=None)
    motion, wrench = predict_wrench(params, jnp.stack([q, dq, ddq], 1))
    twist = jnp.concatenate([motion.linear_velocity, motion.angular_velocity])
    acceleration = jnp.concatenate([motion.linear_acceleration, motion.angular_acceleration])
    return Observed(motion.R_base_sensor, motion.p_base_sensor, twist, acceleration, wrench)


@pytest.mark.parametrize("seed", range(3))
def test_an_independent_engine_agrees(arm, seed):
    state = np.random.default_rng(seed).uniform(-2, 2, (3, len(arm.linear)))
    for name, expected, value in zip(Observed._fields, pinocchio(arm, *state), ours(arm, *state), strict=True):
        difference = np.linalg.norm(value - expected) / np.linalg.norm(expected)
        assert difference < 1e-9, f"{name} differs by {difference:.1e}"
