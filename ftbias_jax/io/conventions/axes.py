"""The sensor's axes at every stamp, and wrenches that are recorded in those of the base frame."""

from __future__ import annotations

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.log import Log
from ftbias_jax.io.pose import interpolated, rotate
from ftbias_jax.setup.types import RobotSetup, SensorSetup, Setup
from ftbias_jax.types import Array


def arm_rotations(robot: RobotSetup, sensor: SensorSetup, q: Array) -> Array:
    """(T, 3, 3) sensor frame in the base frame, of joint positions (T, n)."""
    rotation = np.broadcast_to(np.eye(3), (len(q), 3, 3))
    for screw, angle in zip(robot.screws, q.T, strict=True):
        x, y, z = screw[3:]
        K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        turn = np.eye(3) + np.sin(angle)[:, None, None] * K + (1 - np.cos(angle))[:, None, None] * (K @ K)
        rotation = rotation @ turn
    return rotation @ robot.flange_rotation @ sensor.rotation


def sensor_rotations(t: Array, q: Array, setup: Setup, file: str = "") -> Array:
    """(T, 3, 3) sensor frame in the base frame at all stamps, between the rows that have the joints or the pose.

    Args:
        t: (T,) s.
        q: (T, n) joints or entries of the pose; NaN = not measured.
        setup: the arm, and how the sensor is mounted.
        file: the name in messages.
    """
    known = np.isfinite(q[:, :4] if setup.pose else q).all(1)
    if not known.any():
        what = "orientation" if setup.pose else "row with all joints"
        raise LogError(f"no motion data: there is no {what}", file=file, field="q", remedy="record it")
    if setup.pose is not None:
        quaternion = interpolated(q[:, :4], t)
        columns = [rotate(quaternion, np.tile(axis, (len(t), 1))) for axis in setup.sensor.rotation.T]
        return np.stack(columns, 2)
    between = np.stack([np.interp(t, t[known], column[known]) for column in q.T], 1)
    return arm_rotations(setup.robot, setup.sensor, between)


def in_sensor_axes(log: Log, setup: Setup, file: str = "") -> Log:
    """A log whose wrench is in the sensor's axes, about the same point, whichever the setup says it is recorded in."""
    if setup.log.wrench_axes == "sensor":
        return log
    rotations = sensor_rotations(log.t, log.q, setup, file)
    parts = [np.einsum("tji,tj->ti", rotations, log.wrench[:, half]) for half in (slice(0, 3), slice(3, 6))]
    return log._replace(wrench=np.concatenate(parts, 1))
