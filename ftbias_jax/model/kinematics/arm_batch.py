"""An arm at many samples at once: ``screws.sensor_motion`` with vectors as lists of entries, arrays over the samples.

A loop over the joints of such arrays is a few vectorised operations, where ``vmap`` would make many 3 x 3 products.
Everything is in the base frame.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ftbias_jax.model.kinematics.screws import Arm
from ftbias_jax.runtime.compiled_loops import compile_whole
from ftbias_jax.runtime.lanes import Rows, Vector, cross, product, scale, times, total
from ftbias_jax.runtime.trigonometry import sine_and_versine

if TYPE_CHECKING:
    from jaxtyping import Float


Pose = tuple[Rows, Vector]


class Columns(NamedTuple):
    """Columns of the space Jacobian, one for every joint: three entries (n, C) each."""

    linear: Vector
    angular: Vector


class Twist(NamedTuple):
    """Spatial velocity or acceleration, of the point that passes the origin: three entries (C,) each."""

    linear: Vector
    angular: Vector


class Moving(NamedTuple):
    """How the last link moves."""

    velocity: Twist
    acceleration: Twist


class ArmMotion(NamedTuple):
    """How an arm and its sensor move, base frame; T samples."""

    link_rotation: Float[Array, "3 3 n+1 T"]
    """(3, 3, n + 1, T) turn of the link before each joint, and of the last link, since all joints were at 0."""
    link_position: Float[Array, "3 n+1 T"]
    """(3, n + 1, T) m, where the point of that link is that was at the origin when all joints were at 0."""
    sensor_rotation: Float[Array, "3 3 T"]
    """(3, 3, T) R_base_sensor."""
    sensor_position: Float[Array, "3 T"]
    """(3, T) m."""
    acceleration: Float[Array, "3 T"]
    """(3, T) m/s^2, of the sensor's origin, without gravity."""
    angular_velocity: Float[Array, "3 T"]
    """(3, T) rad/s."""
    angular_acceleration: Float[Array, "3 T"]
    """(3, T) rad/s^2."""


def arm_motion(arm: Arm, q: Float[Array, "n T"], dq: Float[Array, "n T"], ddq: Float[Array, "n T"]) -> ArmMotion:
    """The motion of an arm at joint states (n, T)."""
    (R, p), (link_R, link_p, columns) = _scan_joints(arm, q, lambda pose, column: (*pose, column))
    sensor_R, sensor_p = _sensor(arm, R, p)
    moving, _ = motion(columns, dq, ddq)
    return ArmMotion(
        jnp.concatenate([_rows(link_R), _rows(R)[:, :, None]], 2),
        jnp.concatenate([jnp.stack(link_p), jnp.stack(p)[:, None]], 1),
        _rows(sensor_R),
        jnp.stack(sensor_p),
        jnp.stack(acceleration_at(sensor_p, moving)),
        jnp.stack(moving.velocity.angular),
        jnp.stack(moving.acceleration.angular),
    )


def _rows(matrix: Rows) -> Array:
    return jnp.stack([jnp.stack(row) for row in matrix])


def sensor_pose(arm: Arm, q: Float[Array, "n C"]) -> tuple[Rows, Vector, Columns]:
    """Rotation and position of the sensor, entries (C,), and the Jacobian, from joint positions (n, C)."""
    (R, p), columns = _scan_joints(arm, q, lambda pose, column: column)
    return *_sensor(arm, R, p), columns


def _sensor(arm: Arm, R: Rows, p: Vector) -> tuple[Rows, Vector]:
    """Rotation and position of the sensor, from how the last link has moved since q = 0."""
    return product(R, [list(row) for row in arm.zero_rotation]), total(p, times(R, list(arm.zero_position)))


def _scan_joints(arm: Arm, q: Array, keep: Callable[[Pose, Columns], Any]) -> tuple[Pose, Any]:
    """How the last link has moved since q = 0, and what to keep of each joint: of the pose before it and its column."""
    sin, versine = sine_and_versine(q)
    zero = jnp.zeros_like(q[0])
    at_rest = [[zero + (a == b) for b in range(3)] for a in range(3)], [zero] * 3

    def joint(pose: Pose, constants: tuple[Array, ...]) -> tuple[Pose, Any]:
        R, p = pose
        v, s, *products_and_moved = constants
        # Without s, which is not read: XLA may abort on an argument of a marked call that nothing reads.
        rotation, translation = compile_whole(_turn)(v, *products_and_moved)
        angular = times(R, list(s))
        linear = total(times(R, list(v)), cross(p, angular))
        after = product(R, rotation), total(p, times(R, translation))
        return after, keep(pose, Columns(linear, angular))

    found: tuple[Pose, Any] = jax.lax.scan(joint, at_rest, (*arm[:6], q, sin, versine))
    return found


def _turn(v: Array, skew: Array, skew_squared: Array, skew_v: Array, skew_squared_v: Array, *moved: Array) -> Pose:
    """The exponential of a joint's screw (v, s), whose q, sin q and 1 - cos q are given."""
    q, sin, versine = moved
    rotation = [[(a == b) + sin * skew[a, b] + versine * skew_squared[a, b] for b in range(3)] for a in range(3)]
    return rotation, [q * v[a] + versine * skew_v[a] + (q - sin) * skew_squared_v[a] for a in range(3)]


def motion(columns: Columns, dq: Float[Array, "n C"], ddq: Float[Array, "n C"]) -> tuple[Moving, Twist]:
    """Spatial velocity and acceleration as sums over the joints (n, C), and the velocities (n, C) before each joint."""

    def joint(moving: Moving, own: tuple[Columns, Array, Array]) -> tuple[Moving, Twist]:
        (v, w), (v_rate, w_rate) = moving
        (V, W), dq, ddq = own
        v_rate = total(v_rate, scale(ddq, V), scale(dq, total(cross(w, V), cross(v, W))))
        w_rate = total(w_rate, scale(ddq, W), scale(dq, cross(w, W)))
        after = Twist(total(v, scale(dq, V)), total(w, scale(dq, W)))
        return Moving(after, Twist(v_rate, w_rate)), moving.velocity

    zero = [jnp.zeros_like(dq[0])] * 3
    found: tuple[Moving, Twist] = jax.lax.scan(joint, Moving(Twist(zero, zero), Twist(zero, zero)), (columns, dq, ddq))
    return found


def acceleration_at(position: Vector, moving: Moving) -> Vector:
    """Acceleration of the point of the link that is at a position, m/s^2."""
    (v, w), (v_rate, w_rate) = moving
    return total(v_rate, cross(w_rate, position), cross(w, total(v, cross(w, position))))
