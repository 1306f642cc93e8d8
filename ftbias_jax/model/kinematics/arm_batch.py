"""Motion of an arm at many samples together: ``screws.sensor_motion`` with vectors as lists of arrays over samples.

A loop over the joints takes a few vectorised operations on such arrays, where ``vmap`` would make many 3 x 3 products.
Everything is in the base frame.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from ftbias_jax.model.kinematics.screws import Arm
from ftbias_jax.runtime.compiled_loops import compile_whole
from ftbias_jax.runtime.lanes import Rows, Vector, cross, dot, product, scale, times, total
from ftbias_jax.runtime.trigonometry import sine_and_versine

Pose = tuple[Rows, Vector]


class Columns(NamedTuple):
    """Columns of a Jacobian, of one joint or of all: three entries (C,) or (n, C) each."""

    linear: Vector
    angular: Vector


class Twist(NamedTuple):
    """Spatial velocity or acceleration, of the body point that passes the origin: three entries (C,) each."""

    linear: Vector
    angular: Vector


class Moving(NamedTuple):
    """Velocity and acceleration of a link."""

    velocity: Twist
    acceleration: Twist


class ArmMotion(NamedTuple):
    """Motion of an arm and its sensor at T samples, base frame."""

    link_rotation: Float[Array, "3 3 n+1 T"]
    """(3, 3, n + 1, T) rotation of the link before each joint, and of the last link, relative to all joints at 0."""
    link_position: Float[Array, "3 n+1 T"]
    """(3, n + 1, T) m, position of the point of that link that is at the origin with all joints at 0."""
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
    velocity: Float[Array, "3 T"]
    """(3, T) m/s, of the sensor's origin."""


def arm_motion(arm: Arm, q: Float[Array, "n T"], dq: Float[Array, "n T"], ddq: Float[Array, "n T"]) -> ArmMotion:
    """The motion of an arm at joint states (n, T)."""
    zero = jnp.zeros_like(q[0])
    at_rest = [[zero + (a == b) for b in range(3)] for a in range(3)], [zero] * 3
    still = Twist([zero] * 3, [zero] * 3)

    def joint(carry: tuple[Pose, Moving], constants: tuple[Array, ...]) -> tuple[Any, Pose]:
        ((R, p), ((v, w), (v_rate, w_rate))), (own_v, own_s, *turn, dq, ddq) = carry, constants
        rotation, translation = compile_whole(_turn)(own_v, own_s, *turn)
        W = times(R, list(own_s))
        V = total(times(R, list(own_v)), cross(p, W))
        v_rate = total(v_rate, scale(ddq, V), scale(dq, total(cross(w, V), cross(v, W))))
        w_rate = total(w_rate, scale(ddq, W), scale(dq, cross(w, W)))
        moving = Moving(Twist(total(v, scale(dq, V)), total(w, scale(dq, W))), Twist(v_rate, w_rate))
        return ((product(R, rotation), total(p, times(R, translation))), moving), (R, p)

    constants = (arm.linear, arm.angular, q, *sine_and_versine(q), dq, ddq)
    ((R, p), ((v, w), (v_rate, w_rate))), (link_R, link_p) = jax.lax.scan(
        joint, (at_rest, Moving(still, still)), constants
    )
    position = total(p, times(R, list(arm.zero_position)))
    velocity = total(v, cross(w, position))
    return ArmMotion(
        jnp.concatenate([_rows(link_R), _rows(R)[:, :, None]], 2),
        jnp.concatenate([jnp.stack(link_p), jnp.stack(p)[:, None]], 1),
        _rows(product(R, [list(row) for row in arm.zero_rotation])),
        jnp.stack(position),
        *map(jnp.stack, (total(v_rate, cross(w_rate, position), cross(w, velocity)), w, w_rate, velocity)),
    )


def jacobians(arm: Arm, moving: ArmMotion) -> Float[Array, "U 6 n"]:
    """(U, 6, n) sensor Jacobians, base frame, of a motion whose kinematics are already computed."""
    turned = moving.link_rotation[:, :, :-1]
    angular = jnp.einsum("ijnu,nj->uin", turned, arm.angular)
    linear = jnp.einsum("ijnu,nj->uin", turned, arm.linear)
    lever = moving.link_position[:, :-1] - moving.sensor_position[:, None]
    return jnp.concatenate([linear + jnp.cross(jnp.moveaxis(lever, 2, 0), angular, axis=1), angular], 1)


def _rows(matrix: Rows) -> Array:
    return jnp.stack([jnp.stack(row) for row in matrix])


def _turn(linear: Array, angular: Array, q: Array, sin: Array, versine: Array) -> Pose:
    """The exponential of a joint's screw; versine is 1 - cos q."""
    v, s = list(linear), list(angular)
    s_v, square = cross(s, v), dot(s, s)
    turn = [[0, -s[2], s[1]], [s[2], 0, -s[0]], [-s[1], s[0], 0]]
    rotation = [
        [(a == b) + sin * turn[a][b] + versine * (s[a] * s[b] - (a == b) * square) for b in range(3)] for a in range(3)
    ]
    return rotation, total(scale(q, v), scale(versine, s_v), scale(q - sin, cross(s, s_v)))
