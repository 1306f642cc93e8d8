"""The wrench of the tool over many samples at once: ``pipeline.predict_wrench`` with time as the last axis.

A step of a matrix product over time is one vectorised loop here, where ``vmap`` would make many 3 x 3 products. Time is
cut into pieces that stay in the processor's cache; the reverse pass works each piece out again instead of storing it.
Six-vectors are split into linear and angular parts; everything is in the base frame until the last step.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.custom_batching
import jax.numpy as jnp

from ftbias_jax.screws import Arm
from ftbias_jax.types import Array

PIECE = 64
"""Samples worked out together."""


class Body(NamedTuple):
    """What the wrench depends on besides the motion."""

    arm: Arm
    gravity: Array
    """(3,) m/s^2, base frame."""
    theta: Array
    """(10,) of the tool (wrench.py)."""


class Geometry(NamedTuple):
    """Pose of the sensor, and the columns of the space Jacobian; base frame."""

    rotation: Array
    """(3, 3, C)."""
    position: Array
    """(3, C) m."""
    linear: Array
    """(n, 3, C)."""
    angular: Array
    """(n, 3, C)."""


def wrenches(body: Body, mean: Array, covariance: Array | None) -> tuple[Array, Array]:
    """D theta, and the diagonal of sum_j G_j P_j G_j^T (pipeline.covariance_of_joints).

    Args:
        body: arm, gravity and tool. mean: (T, 3, n) joint states. covariance: (T, 3, 3, n), or None for zeros.

    Returns:
        wrench (T, 6) N, Nm, sensor frame, and the variance that the joints' uncertainty adds to it (T, 6).
    """
    length = mean.shape[0]
    size = min(PIECE, length) if _on_cpu() else length
    upper = () if covariance is None else (covariance[:, 0, 0], covariance[:, 0, 2], covariance[:, 2, 2])
    columns = [mean[:, 0], mean[:, 1], mean[:, 2], *upper]
    pieces = [_cut(column, size) for column in columns]
    wrench, variance = _pieces(body, *pieces)
    return _join(wrench, length), _join(variance, length)


def wrenches_forward(body: Body, mean: Array) -> Array:
    """D theta (T, 6) as above, for derivatives in forward mode, which the hand-written reverse pass does not allow."""
    length = mean.shape[0]
    pieces = [_cut(mean[:, i], min(PIECE, length)) for i in range(3)]

    def piece(columns: list[Array]) -> Array:
        q, dq, ddq = columns
        return _dynamics(body, _pose(body.arm, q), dq, ddq)[0]

    return _join(jax.lax.map(piece, pieces), length)


def _cut(x: Array, size: int) -> Array:
    """(T, n) -> (pieces, n, size)."""
    x = jnp.pad(x, ((0, -x.shape[0] % size), (0, 0)))
    return jnp.swapaxes(x.reshape(-1, size, x.shape[1]), 1, 2)


def _join(x: Array, length: int) -> Array:
    """(pieces, 6, size) -> (T, 6)."""
    return jnp.swapaxes(x, 1, 2).reshape(-1, x.shape[1])[:length]


@jax.custom_vjp
def _pieces(body: Body, *columns: Array) -> tuple[Array, Array]:
    """Wrench and variance (pieces, 6, C) for columns (pieces, n, C): q, dq, ddq, and covariances if any."""
    return _pieces_fwd(body, *columns)[0]


def _pieces_fwd(body: Body, *columns: Array) -> tuple[tuple[Array, Array], tuple[Body, tuple[Array, ...]]]:
    return _one_log_at_a_time(_all_pieces)(body, columns), (body, columns)


def _pieces_bwd(residual: tuple[Body, tuple[Array, ...]], cotangent: tuple[Array, Array]) -> tuple[Body | Array, ...]:
    body_bars, *column_bars = _one_log_at_a_time(_all_slopes)(*residual, cotangent)
    return jax.tree.map(lambda x: x.sum(0), body_bars), *column_bars


_pieces.defvjp(_pieces_fwd, _pieces_bwd)


def _all_pieces(body: Body, columns: tuple[Array, ...]) -> tuple[Array, Array]:
    def one(columns: tuple[Array, ...]) -> tuple[Array, Array]:
        return _dynamics(body, _pose(body.arm, columns[0]), *columns[1:])

    found: tuple[Array, Array] = jax.lax.map(one, columns)
    return found


def _all_slopes(body: Body, columns: tuple[Array, ...], cotangent: tuple[Array, Array]) -> tuple[Body | Array, ...]:
    found: tuple[Body | Array, ...] = jax.lax.map(lambda piece: _slopes(body, *piece), (columns, cotangent))
    return found


def _one_log_at_a_time(function: Callable[..., Any]) -> Callable[..., Any]:
    """Under ``vmap`` the pieces of all logs together would not fit the processor's cache; an accelerator wants them."""
    looped: Callable[..., Any] = jax.custom_batching.sequential_vmap(function) if _on_cpu() else function
    return looped


def _on_cpu() -> bool:
    return jax.default_backend() == "cpu"


def _slopes(body: Body, columns: tuple[Array, ...], cotangent: tuple[Array, Array]) -> tuple[Body | Array, ...]:
    """Slopes by hand: twice the work of the wrench, where autodiff of so many small arrays takes ten times.

    Each line is the adjoint of a line of ``_dynamics``; ``x_bar`` is the slope in x. a x b . c = b x c . a = c x a . b.
    """
    q, dq, ddq, *covariance = columns
    geometry = _pose(body.arm, q)
    R, p, V, W = geometry
    theta, gravity = body.theta[:, None], jnp.broadcast_to(body.gravity[:, None], p.shape)
    mass, first_moment = theta[0, 0], jnp.broadcast_to(theta[1:4], p.shape)
    m = _moving(geometry, dq, ddq)
    f, w, w_rate, g = (_into(R, x) for x in (m.acceleration - gravity, m.w, m.w_rate, gravity))
    force, torque = cotangent[0][:3], cotangent[0][3:]

    f_bar = mass * force + _cross(torque, first_moment)
    spin, turned_back = _cross(force, w), _cross(torque, w)
    w_bar = _cross(_cross(w, first_moment), force) + _cross(first_moment, spin)
    w_bar = w_bar + _cross(_turn(theta, w[None])[0], torque) + _turn(theta, turned_back[None])[0]
    w_rate_bar = _cross(first_moment, force) + _turn(theta, torque[None])[0]
    moment_bar = _cross(force, w_rate) + _cross(spin, w) + _cross(f, torque)
    mass_bar = f * force
    inertia_bar = _outer(torque, w_rate) + _outer(turned_back, w)

    V_bar, W_bar, position_bar, g_bar = jnp.zeros_like(V), jnp.zeros_like(W), jnp.zeros_like(p), jnp.zeros_like(g)
    covariance_bar: tuple[Array, ...] = ()
    if covariance:
        turned, at_sensor, moved, falling, by_ddq, by_q = _sensitivity(theta, geometry, g)
        qq, qa, aa = (x[:, None] for x in covariance)
        bar = cotangent[1][None]
        covariance_bar = tuple((bar * y).sum(1) for y in (by_q**2, 2 * by_q * by_ddq, by_ddq**2))
        ddq_force, ddq_torque = jnp.split(_hold(2 * bar * (by_q * qa + by_ddq * aa)), 2, 1)
        q_force, q_torque = jnp.split(_hold(2 * bar * (by_q * qq + by_ddq * qa)), 2, 1)
        c = jnp.broadcast_to(first_moment[None], turned.shape)
        moved_bar = mass * ddq_force + _cross3(ddq_torque, c)
        falling_bar = mass * q_force + _cross3(q_torque, c)
        t_bar = _cross3(jnp.broadcast_to(g[None], turned.shape), falling_bar)
        t_bar = t_bar + _cross3(c, ddq_force) + _turn(theta, ddq_torque)
        moved_bar, falling_bar, t_bar = _hold(moved_bar), _hold(falling_bar), _hold(t_bar)
        g_bar = _cross3(falling_bar, turned).sum(0)
        mass_bar = mass_bar + (moved * ddq_force + falling * q_force).sum(0)
        crosses = _cross3(ddq_force, turned) + _cross3(moved, ddq_torque) + _cross3(falling, q_torque)
        moment_bar = moment_bar + crosses.sum(0)
        inertia_bar = inertia_bar + jnp.einsum("nac,nbc->ab", ddq_torque, turned)
        V_bar, turned_bar = _apply3(R, moved_bar), _apply3(R, t_bar)
        V_bar, turned_bar = _hold(V_bar), _hold(turned_bar)
        W_bar = turned_bar + _cross3(jnp.broadcast_to(p[None], W.shape), V_bar)
        position_bar = _cross3(V_bar, W).sum(0)
        torque_of_turn = (_cross3(turned_bar, W) + _cross3(V_bar, at_sensor)).sum(0)
        rotation_bar = sum(y[:, :, None] * z[:, None] for y, z in ((W, t_bar), (at_sensor, moved_bar))).sum(0)
    else:
        torque_of_turn, rotation_bar = jnp.zeros_like(p), jnp.zeros_like(R)

    pairs = ((m.acceleration - gravity, f_bar), (m.w, w_bar), (m.w_rate, w_rate_bar), (gravity, g_bar))
    rotation_bar = rotation_bar + sum(y[:, None] * z[None] for y, z in pairs)
    a_bar, w_bar, w_rate_bar, g_bar = (_apply(R, z) for _, z in pairs)
    base = ((a_bar, m.acceleration - gravity), (w_bar, m.w), (w_rate_bar, m.w_rate), (g_bar, gravity))
    torque_of_turn = torque_of_turn + sum(_cross(y, z) for y, z in base)

    a_bar, w_bar, w_rate_bar, g_bar, torque_of_turn, position_bar = _hold(
        jnp.stack([a_bar, w_bar, w_rate_bar, g_bar, torque_of_turn, position_bar])
    )
    v_bar = _cross(a_bar, m.w)
    position_bar = position_bar + _cross(a_bar, m.w_rate) + _cross(v_bar, m.w)
    w_bar = w_bar + _cross(m.v + _cross(m.w, p), a_bar) + _cross(p, v_bar)
    w_rate_bar = w_rate_bar + _cross(p, a_bar)
    a3, w3 = (jnp.broadcast_to(x[None], V.shape) for x in (a_bar, w_rate_bar))
    dv_bar = _cross3(a3, m.w_before) + v_bar[None] + _after(_cross3(m.dw, a3))
    dw_bar = _cross3(w3, m.w_before) + _cross3(a3, m.v_before) + w_bar[None]
    dw_bar = dw_bar + _after(_cross3(m.dw, w3) + _cross3(m.dv, a3))
    dv_bar, dw_bar = _hold(dv_bar), _hold(dw_bar)
    dq_bar, ddq_bar = (V * dv_bar + W * dw_bar).sum(1), (V * a3 + W * w3).sum(1)
    V_bar, W_bar = V_bar + dq[:, None] * dv_bar + ddq[:, None] * a3, W_bar + dq[:, None] * dw_bar + ddq[:, None] * w3

    V_bar, W_bar = _hold(V_bar), _hold(W_bar)
    # A joint moves everything behind it by its twist: d J_k / d q_j = ad(J_j) J_k for j < k.
    turn = _after(_cross3(V, V_bar) + _cross3(W, W_bar)) + (torque_of_turn + _cross(p, position_bar))[None]
    push = _after(_cross3(W, V_bar)) + position_bar[None]
    q_bar = (W * turn + V * push).sum(1)

    geometry_bar = Geometry(rotation_bar, position_bar, V_bar, W_bar)
    (arm_bar,) = jax.vjp(lambda arm: _pose(arm, q), body.arm)[1](geometry_bar)
    xx, xy, xz, yy, yz, zz = (inertia_bar[i, j] for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)))
    inertia = (xx, xy + inertia_bar[1, 0], xz + inertia_bar[2, 0], yy, yz + inertia_bar[2, 1], zz)
    theta_bar = jnp.concatenate([mass_bar.sum()[None], moment_bar.sum(1), jnp.stack(inertia)])
    return Body(arm_bar, (g_bar - a_bar).sum(1), theta_bar), q_bar, dq_bar, ddq_bar, *covariance_bar


class Moving(NamedTuple):
    """How the sensor moves, base frame; (3, C), or (n, 3, C) for every joint."""

    dv: Array
    dw: Array
    v_before: Array
    w_before: Array
    v: Array
    w: Array
    w_rate: Array
    acceleration: Array
    """Of the sensor origin."""


def _moving(geometry: Geometry, dq: Array, ddq: Array) -> Moving:
    """Spatial velocity and acceleration as sums over the joints (screws.sensor_motion)."""
    _, p, V, W = geometry
    dv, dw = V * dq[:, None], W * dq[:, None]
    v_before, w_before = _before(dv), _before(dw)
    v, w = dv.sum(0), dw.sum(0)
    v_rate = (V * ddq[:, None] + _cross3(w_before, dv) + _cross3(v_before, dw)).sum(0)
    w_rate = (W * ddq[:, None] + _cross3(w_before, dw)).sum(0)
    acceleration = v_rate + _cross(w_rate, p) + _cross(w, v + _cross(w, p))
    return Moving(dv, dw, v_before, w_before, v, w, w_rate, acceleration)


def _sensitivity(theta: Array, geometry: Geometry, g: Array) -> tuple[Array, ...]:
    """Columns of the sensor Jacobian and the wrench per ddq and q that they make (wrench.joint_sensitivity)."""
    R, p, V, W = geometry
    at_sensor = V + _cross3(W, jnp.broadcast_to(p[None], W.shape))
    at_sensor = _hold(at_sensor)
    turned, moved = _hold(_into3(R, W)), _hold(_into3(R, at_sensor))
    falling = _hold(_cross3(turned, jnp.broadcast_to(g[None], turned.shape)))
    by_ddq = jnp.concatenate(_inertial(theta, moved, turned), 1)
    by_q = jnp.concatenate(_inertial(theta, falling, jnp.zeros_like(turned)), 1)
    return turned, at_sensor, moved, falling, _hold(by_ddq), _hold(by_q)


def _dynamics(body: Body, geometry: Geometry, dq: Array, ddq: Array, *covariance: Array) -> tuple[Array, Array]:
    """Wrench and variance (6, C) of an arm in a known pose."""
    R = geometry.rotation
    theta, gravity = body.theta[:, None], jnp.broadcast_to(body.gravity[:, None], geometry.position.shape)
    moving = _moving(geometry, dq, ddq)
    f, w, w_rate, g = (_into(R, x) for x in (moving.acceleration - gravity, moving.w, moving.w_rate, gravity))
    force, torque = (x[0] for x in _inertial(theta, f[None], w_rate[None]))
    first_moment = jnp.broadcast_to(theta[1:4], w.shape)
    force, torque = force + _cross(w, _cross(w, first_moment)), torque + _cross(w, _turn(theta, w[None])[0])
    wrench = jnp.concatenate([force, torque])
    if not covariance:
        return wrench, jnp.zeros_like(wrench)
    by_ddq, by_q = _sensitivity(theta, geometry, g)[-2:]
    qq, qa, aa = (x[:, None] for x in covariance)
    return wrench, (by_q * (by_q * qq + 2 * by_ddq * qa) + by_ddq**2 * aa).sum(0)


def links(arm: Arm, q: Array) -> tuple[Array, Array]:
    """Pose of the last link relative to where it is at q = 0: (n, C) rad -> rotation (3, 3, C), position (3, C) m."""
    return _links(arm, q)[0]


def _pose(arm: Arm, q: Array) -> Geometry:
    """Pose and Jacobian of every sample, q (n, C)."""
    (R, p), (linear, angular) = _links(arm, q)
    position = p + _apply(R, arm.zero_position[:, None])
    rotation = sum(R[:, k, None] * arm.zero_rotation[None, k, :, None] for k in range(3))
    return Geometry(rotation, position, linear, angular)


def _links(arm: Arm, q: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Pose of the last link as in ``links``, and the Jacobian's linear and angular columns (n, 3, C)."""
    sin, versine = jnp.sin(q), 2 * jnp.sin(q / 2) ** 2
    identity = jnp.eye(3, dtype=q.dtype)[:, :, None]

    def joint(
        pose: tuple[Array, Array], constants: tuple[Array, ...]
    ) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        R, p = pose
        v, s, skew, skew_squared, skew_v, skew_squared_v, q, sin, versine = constants
        rotation = identity + sin[None, None] * skew[:, :, None] + versine[None, None] * skew_squared[:, :, None]
        translation = q[None] * v[:, None] + versine[None] * skew_v[:, None] + (q - sin)[None] * skew_squared_v[:, None]
        angular = _apply(R, s[:, None])
        linear = _apply(R, v[:, None]) + _cross(p, angular)
        product = sum(R[:, k, None] * rotation[None, k] for k in range(3))
        return (product, p + _apply(R, translation)), (linear, angular)

    start = (jnp.broadcast_to(identity, (3, 3, q.shape[1])), jnp.zeros((3, q.shape[1]), q.dtype))
    found: tuple[tuple[Array, Array], tuple[Array, Array]] = jax.lax.scan(joint, start, (*arm[:6], q, sin, versine))
    return found


def _inertial(theta: Array, linear: Array, angular: Array) -> tuple[Array, Array]:
    """Force and torque (n, 3, C) that linear and angular acceleration cost without rotation; theta (10, 1)."""
    c = jnp.broadcast_to(theta[None, 1:4], linear.shape)
    return theta[0, 0] * linear - _cross3(c, angular), _cross3(c, linear) + _turn(theta, angular)


def _turn(theta: Array, angular: Array) -> Array:
    """Moment of inertia about the sensor origin times vectors (n, 3, C)."""
    xx, xy, xz, yy, yz, zz = theta[4:]
    columns = [jnp.stack(column)[None] for column in ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))]
    return sum(column * angular[:, k, None] for k, column in enumerate(columns))


def _hold(x: Array) -> Array:
    """x, worked out once: XLA works sums and products out again for all that uses them, a matrix product never."""
    return jnp.tensordot(jnp.eye(x.shape[0], dtype=x.dtype), x, 1)


def _apply(R: Array, x: Array) -> Array:
    """R x for every sample: (3, 3, C), (3, C or 1) -> (3, C)."""
    return sum(R[:, k] * x[k][None] for k in range(3))


def _into(R: Array, x: Array) -> Array:
    """R^T x for every sample."""
    return sum(R[k] * x[k][None] for k in range(3))


def _into3(R: Array, x: Array) -> Array:
    """R^T x for columns (n, 3, C)."""
    return sum(R[None, k] * x[:, k, None] for k in range(3))


def _apply3(R: Array, x: Array) -> Array:
    """R x for columns (n, 3, C)."""
    return sum(R[None, :, k] * x[:, k, None] for k in range(3))


def _outer(a: Array, b: Array) -> Array:
    """sum over the samples of a b^T, (3, 3)."""
    return jnp.einsum("ac,bc->ab", a, b)


def _before(x: Array) -> Array:
    """(n, 3, C) -> at every joint the sum over those before it; a product of matrices, which is quicker than a sum."""
    n = x.shape[0]
    return jnp.tensordot(jnp.tri(n, k=-1, dtype=x.dtype), x, 1)


def _after(x: Array) -> Array:
    """The sum over the joints behind."""
    n = x.shape[0]
    return jnp.tensordot(jnp.tri(n, k=-1, dtype=x.dtype).T, x, 1)


def _cross(a: Array, b: Array) -> Array:
    """a x b for every sample, (3, C)."""
    return jnp.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _cross3(a: Array, b: Array) -> Array:
    """a x b for columns (n, 3, C)."""
    return jnp.swapaxes(_cross(jnp.swapaxes(a, 0, 1), jnp.swapaxes(b, 0, 1)), 0, 1)
