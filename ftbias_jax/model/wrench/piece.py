"""The wrench of the tool, and what the joints' uncertainty adds to its variance, for a piece of a log.

The equations are those of ``pipeline.predict_wrench`` and ``tool_wrench.joint_sensitivity``; vectors are lists of
entries, each an array over samples (C,), as in arm_batch.py, and theta is the list of its ten numbers.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ftbias_jax.model.kinematics.arm_batch import Columns, acceleration_at, motion, sensor_pose
from ftbias_jax.model.wrench.tool_wrench import Model
from ftbias_jax.runtime.compiled_loops import compile_whole
from ftbias_jax.runtime.lanes import Rows, Vector, cross, scale, times, total, transpose

if TYPE_CHECKING:
    from jaxtyping import Float


class Felt(NamedTuple):
    """What the sensor feels of the motion, sensor frame."""

    specific_force: Vector
    """Acceleration of the sensor origin minus gravity, m/s^2."""
    angular_velocity: Vector
    angular_acceleration: Vector


class Turned(NamedTuple):
    """What the motion of one joint by itself does to the sensor, sensor frame."""

    linear: Vector
    angular: Vector
    falling: Vector
    """Gravity's change as the sensor turns."""


def wrench_piece(
    model: Model, q: Float[Array, "n C"], dq: Float[Array, "n C"], ddq: Float[Array, "n C"], *covariance: Array
) -> tuple[Vector, Vector]:
    """Wrench and variance, six entries (C,) each.

    Args:
        model: arm, gravity and tool.
        q: (n, C) joint positions, rad.
        dq: (n, C) joint velocities, rad/s.
        ddq: (n, C) joint accelerations, rad/s^2.
        covariance: P_qq, P_qa and P_aa (n, C), or none for zeros; velocities are left out, as in
            ``joint_sensitivity``.
    """
    theta, gravity = list(model.theta), list(model.gravity)
    R, p, columns = sensor_pose(model.arm, q)
    moving, _ = motion(columns, dq, ddq)
    R_sensor_base = transpose(R)
    rates = acceleration_at(p, moving), moving.velocity.angular, moving.acceleration.angular
    wrench = wrench_of(theta, felt_of(gravity, R_sensor_base, *rates))
    zero = [jnp.zeros_like(q[0])] * 6
    if not covariance:
        return wrench, zero
    g = times(R_sensor_base, gravity)

    def joint(variance: Vector, own: tuple[Columns, tuple[Array, ...]]) -> tuple[Vector, None]:
        column, (qq, qa, aa) = own
        turned = compile_whole(turned_by)(R_sensor_base, p, g, column)
        by_q, by_ddq = compile_whole(sensitivity)(theta, turned)
        added = [b * (b * qq + 2 * a * qa) + a**2 * aa for a, b in zip(by_ddq, by_q, strict=True)]
        return total(variance, added), None

    return wrench, jax.lax.scan(joint, zero, (columns, covariance))[0]


def felt_of(gravity: Vector, R_sensor_base: Rows, acceleration: Vector, velocity: Vector, turning: Vector) -> Felt:
    """What the sensor feels of its acceleration, angular velocity and angular acceleration, all in the base frame."""
    specific = [a - g for a, g in zip(acceleration, gravity, strict=True)]
    return Felt(*(times(R_sensor_base, x) for x in (specific, velocity, turning)))


def wrench_of(theta: Vector, felt: Felt) -> Vector:
    """D theta (tool_wrench.data_matrix)."""
    f, w, w_rate = felt
    c = theta[1:4]
    force, torque = inertial(theta, f, w_rate)
    return [*total(force, cross(w, cross(w, c))), *total(torque, cross(w, turn(theta, w)))]


def inertial(theta: Vector, linear: Vector, angular: Vector) -> tuple[Vector, Vector]:
    """Force and torque that linear and angular acceleration cost without rotation."""
    c = theta[1:4]
    return total(scale(theta[0], linear), cross(angular, c)), total(cross(c, linear), turn(theta, angular))


def turn(theta: Vector, angular: Vector) -> Vector:
    """Moment of inertia about the sensor origin times a vector."""
    xx, xy, xz, yy, yz, zz = theta[4:]
    return times([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], angular)


def turned_by(R_sensor_base: Rows, p: Vector, g: Vector, column: Columns) -> Turned:
    """A column of the space Jacobian as the sensor at p feels it; g: gravity in the sensor frame."""
    angular = times(R_sensor_base, column.angular)
    return Turned(times(R_sensor_base, total(column.linear, cross(column.angular, p))), angular, cross(angular, g))


def sensitivity(theta: Vector, turned: Turned) -> tuple[Vector, Vector]:
    """Wrench per q and per ddq of one joint, six entries each (tool_wrench.joint_sensitivity)."""
    falling_torque = cross(theta[1:4], turned.falling)
    force, torque = inertial(theta, turned.linear, turned.angular)
    return [*scale(theta[0], turned.falling), *falling_torque], [*force, *torque]
