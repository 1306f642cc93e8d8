"""The wrench of the tool over many samples at once: ``pipeline.predict_wrench`` with time as the last axis.

A step of a matrix product over time is one vectorised loop here, where ``vmap`` would make many 3 x 3 products. Time is
cut into pieces that stay in the processor's cache; the reverse pass works each piece out again instead of storing it.
Six-vectors are split into linear and angular parts; everything is in the base frame until the last step.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp

from ftbias_jax.screws import Arm
from ftbias_jax.types import Array

PIECE = 512
"""Samples worked out together."""


class Body(NamedTuple):
    """What the wrench depends on besides the motion."""

    arm: Arm
    gravity: Array
    """(3,) m/s^2, base frame."""
    theta: Array
    """(10,) of the tool (wrench.py)."""


def wrenches(body: Body, mean: Array, covariance: Array | None) -> tuple[Array, Array]:
    """D theta, and the diagonal of sum_j G_j P_j G_j^T (pipeline.covariance_of_joints).

    Args:
        body: arm, gravity and tool. mean: (T, 3, n) joint states. covariance: (T, 3, 3, n), or None for zeros.

    Returns:
        wrench (T, 6) N, Nm, sensor frame, and the variance that the joints' uncertainty adds to it (T, 6).
    """
    length = mean.shape[0]
    size = min(PIECE, length)
    upper = () if covariance is None else (covariance[:, 0, 0], covariance[:, 0, 2], covariance[:, 2, 2])
    columns = [mean[:, 0], mean[:, 1], mean[:, 2], *upper]
    pieces = [_cut(column, size) for column in columns]
    piece = jax.checkpoint(partial(_piece, body))
    wrench, variance = jax.lax.map(lambda columns: piece(*columns), pieces)
    return _join(wrench, length), _join(variance, length)


def _cut(x: Array, size: int) -> Array:
    """(T, n) -> (pieces, n, size)."""
    x = jnp.pad(x, ((0, -x.shape[0] % size), (0, 0)))
    return jnp.swapaxes(x.reshape(-1, size, x.shape[1]), 1, 2)


def _join(x: Array, length: int) -> Array:
    """(pieces, 6, size) -> (T, 6)."""
    return jnp.swapaxes(x, 1, 2).reshape(-1, x.shape[1])[:length]


def _piece(body: Body, q: Array, dq: Array, ddq: Array, *covariance: Array) -> tuple[Array, Array]:
    """The same for joint states (n, C): wrench and variance (6, C)."""
    arm, theta = body.arm, body.theta[:, None]
    rotation, position, linear, angular = _pose(arm, q)
    v, w, v_rate, w_rate = _twist(linear, angular, dq, ddq)
    a = v_rate + _cross(w_rate, position) + _cross(w, v + _cross(w, position))
    f, w, w_rate, g = (
        _into(rotation, x)
        for x in (a - body.gravity[:, None], w, w_rate, jnp.broadcast_to(body.gravity[:, None], a.shape))
    )
    force, torque = _inertial(theta, f, w_rate)
    momentum = _cross(w, jnp.broadcast_to(theta[1:4], w.shape))
    force, torque = force + _cross(w, momentum), torque + _cross(w, _turn(theta, w))
    wrench = jnp.concatenate([force, torque])
    if not covariance:
        return wrench, jnp.zeros_like(wrench)
    turned = jax.vmap(partial(_into, rotation))(angular)
    moved = jax.vmap(lambda v, w: _into(rotation, v + _cross(w, position)))(linear, angular)
    by_ddq = jnp.concatenate(jax.vmap(partial(_inertial, theta))(moved, turned), 1)
    falling = jax.vmap(lambda w: _cross(w, g))(turned)
    by_q = jnp.concatenate(jax.vmap(partial(_inertial, theta))(falling, jnp.zeros_like(turned)), 1)
    qq, qa, aa = (x[:, None] for x in covariance)
    return wrench, (by_q * (by_q * qq + 2 * by_ddq * qa) + by_ddq**2 * aa).sum(0)


def links(arm: Arm, q: Array) -> tuple[Array, Array]:
    """Pose of the arm's last link relative to where it is at q = 0: (n, C) -> rotation (3, 3, C), position (3, C)."""
    (R, p), _ = _links(arm, q)
    return R, p


def _links(arm: Arm, q: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """The same, and the space Jacobian's linear and angular columns (n, 3, C)."""
    sin, versine = jnp.sin(q), 2 * jnp.sin(q / 2) ** 2
    identity = jnp.eye(3, dtype=q.dtype)[:, :, None]

    def joint(
        pose: tuple[Array, Array], constants: tuple[Array, ...]
    ) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        R, p = pose
        v, s, skew, skew_squared, skew_v, skew_squared_v, q, sin, versine = constants
        rotation = identity + sin * skew[:, :, None] + versine * skew_squared[:, :, None]
        translation = q * v[:, None] + versine * skew_v[:, None] + (q - sin) * skew_squared_v[:, None]
        angular = _apply(R, s[:, None])
        linear = _apply(R, v[:, None]) + _cross(p, angular)
        product = sum(R[:, k, None] * rotation[None, k] for k in range(3))
        return (product, p + _apply(R, translation)), (linear, angular)

    start = (jnp.broadcast_to(identity, (3, 3, q.shape[1])), jnp.zeros((3, q.shape[1]), q.dtype))
    return jax.lax.scan(joint, start, (*arm[:6], q, sin, versine))


def _pose(arm: Arm, q: Array) -> tuple[Array, Array, Array, Array]:
    """Sensor rotation (3, 3, C), position (3, C), and the space Jacobian's linear and angular columns (n, 3, C)."""
    (R, p), (linear, angular) = _links(arm, q)
    position = p + _apply(R, arm.zero_position[:, None])
    return sum(R[:, k, None] * arm.zero_rotation[None, k, :, None] for k in range(3)), position, linear, angular


def _twist(linear: Array, angular: Array, dq: Array, ddq: Array) -> tuple[Array, Array, Array, Array]:
    """Spatial velocity and acceleration (3, C), linear and angular (screws.sensor_motion)."""

    def joint(carry: tuple[Array, ...], columns: tuple[Array, ...]) -> tuple[tuple[Array, ...], None]:
        v, w, v_rate, w_rate = carry
        linear, angular, dq, ddq = columns
        dv, dw = linear * dq, angular * dq
        v_rate = v_rate + linear * ddq + _cross(w, dv) + _cross(v, dw)
        return (v + dv, w + dw, v_rate, w_rate + angular * ddq + _cross(w, dw)), None

    zero = jnp.zeros_like(linear[0])
    v, w, v_rate, w_rate = jax.lax.scan(joint, (zero,) * 4, (linear, angular, dq, ddq))[0]
    return v, w, v_rate, w_rate


def _inertial(theta: Array, linear: Array, angular: Array) -> tuple[Array, Array]:
    """Force and torque (3, C) that linear and angular acceleration (3, C) cost without rotation; theta (10, 1)."""
    c = jnp.broadcast_to(theta[1:4], linear.shape)
    return theta[0] * linear - _cross(c, angular), _cross(c, linear) + _turn(theta, angular)


def _turn(theta: Array, angular: Array) -> Array:
    """Moment of inertia about the sensor origin times a vector (3, C)."""
    xx, xy, xz, yy, yz, zz = theta[4:]
    columns = [jnp.stack(column) for column in ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))]
    return sum(column * angular[k] for k, column in enumerate(columns))


def _apply(R: Array, x: Array) -> Array:
    """R x for every sample: (3, 3, C), (3, C or 1) -> (3, C)."""
    return sum(R[:, k] * x[k] for k in range(3))


def _into(R: Array, x: Array) -> Array:
    """R^T x for every sample."""
    return sum(R[k] * x[k] for k in range(3))


def _cross(a: Array, b: Array) -> Array:
    """a x b for every sample, (3, C)."""
    return jnp.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
