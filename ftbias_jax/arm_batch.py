"""An arm at many samples at once: ``screws.sensor_motion`` with vectors as lists of entries, arrays over the samples.

A loop over the joints of such arrays is a few vectorised operations, where ``vmap`` would make many 3 x 3 products.
Everything is in the base frame.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

from ftbias_jax.screws import Arm
from ftbias_jax.small_matrices import Rows, Vector, cross, product, scale, times, total
from ftbias_jax.types import Array


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


def links(arm: Arm, q: Array) -> tuple[Array, Array]:
    """Pose of the last link relative to where it is at q = 0: (n, C) rad -> rotation (3, 3, C), position (3, C) m."""
    R, p, _ = _links(arm, q)
    return jnp.stack([jnp.stack(row) for row in R]), jnp.stack(p)


def sensor_pose(arm: Arm, q: Array) -> tuple[Rows, Vector, Columns]:
    """Rotation and position of the sensor, entries (C,), and the Jacobian, from joint positions (n, C)."""
    R, p, columns = _links(arm, q)
    position = total(p, times(R, list(arm.zero_position)))
    return product(R, [list(row) for row in arm.zero_rotation]), position, columns


def _links(arm: Arm, q: Array) -> tuple[Rows, Vector, Columns]:
    sin, versine = jnp.sin(q), 2 * jnp.sin(q / 2) ** 2
    zero = jnp.zeros_like(q[0])
    at_rest = [[zero + (a == b) for b in range(3)] for a in range(3)], [zero] * 3

    def joint(pose: tuple[Rows, Vector], constants: tuple[Array, ...]) -> tuple[tuple[Rows, Vector], Columns]:
        R, p = pose
        v, s, skew, skew_squared, skew_v, skew_squared_v, q, sin, versine = constants
        rotation = [[(a == b) + sin * skew[a, b] + versine * skew_squared[a, b] for b in range(3)] for a in range(3)]
        translation = [q * v[a] + versine * skew_v[a] + (q - sin) * skew_squared_v[a] for a in range(3)]
        angular = times(R, list(s))
        linear = total(times(R, list(v)), cross(p, angular))
        return (product(R, rotation), total(p, times(R, translation))), Columns(linear, angular)

    (R, p), columns = jax.lax.scan(joint, at_rest, (*arm[:6], q, sin, versine))
    return R, p, columns


def motion(columns: Columns, dq: Array, ddq: Array) -> tuple[Moving, Twist]:
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
