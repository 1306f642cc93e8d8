"""The adjoint of the wrench in what the setup states of tool, gravity and arm, by hand; few ask for it.

A line that makes y adds its share of y_bar, the slope dL/dy, to the slopes of what it read:

    y = M v      v_bar += M^T y_bar,     M_bar += y_bar v^T
    y = a × b    a_bar += b × y_bar,     b_bar += y_bar × a     because a × b . c = b × c . a = c × a . b
    y = s v      v_bar += s y_bar,       s_bar += v . y_bar

What is felt in sensor axes is R^T u, for u = a - g, w and w', so u_bar = R felt_bar and g_bar = -a_bar. The
acceleration of the point p of the last link and the sums over the joints,

    a = v' + w' × p + w × (v + w × p)
    v' += ddq V + dq (w × V + v × W),   w' += ddq W + dq w × W,   v += dq V,   w += dq W,

give ``_moving_slopes`` and ``_column_slopes`` line by line, the joints from the last to the first. The variance, of
which a joint adds b^2 qq + 2 a b qa + a^2 aa, is differentiated in the same way (``_variance_slopes``). Slopes in what
the joints do are in joint_slopes.py. From the pose at given q on JAX does the rest (batch.py).

Nothing needs to be stored: all this reads only the columns, the sensor's pose and the velocity before each joint, which
one short loop over the joints gives again from q, dq and ddq, for a piece that stays in the processor's cache.
"""

from __future__ import annotations

from functools import reduce
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ftbias_jax.model.kinematics.arm_batch import Columns, Moving, Twist, acceleration_at, motion, sensor_pose
from ftbias_jax.model.wrench.piece import Felt, sensitivity, turned_by, wrench_of
from ftbias_jax.model.wrench.tool_wrench import Model
from ftbias_jax.runtime.lanes import Rows, Vector, cross, plus, scale, times, total, transpose


class PoseSlopes(NamedTuple):
    """Slopes in what ``arm_batch.sensor_pose`` returns."""

    rotation: Rows
    position: Vector
    columns: Columns


class Slopes(NamedTuple):
    """Slopes in the model, for a piece."""

    gravity: Vector
    """Entries (C,)."""
    theta: Vector
    """Entries (C,)."""
    pose: PoseSlopes
    """In the pose at given q, which the arm's constants have to answer for."""


class Variance(NamedTuple):
    """What the slopes of the variance add to others."""

    theta: Vector
    gravity: Vector
    """In gravity as seen by the sensor."""
    pose: PoseSlopes


def slopes_of_piece(
    model: Model, joints: tuple[Array, ...], wrench_bar: Vector, variance_bar: Vector | None = None
) -> Slopes:
    """Slopes of a piece.

    Args:
        model: arm, gravity and tool.
        joints: q, dq and ddq, and P_qq, P_qa and P_aa or none of these, (n, C) each.
        wrench_bar: slopes in the wrench, six entries (C,).
        variance_bar: slopes in the variance, six entries (C,), if there are covariances.
    """
    q, dq, ddq, *covariance = joints
    zero = jnp.zeros_like(q[0])
    theta, gravity = [zero + x for x in model.theta], [zero + x for x in model.gravity]
    R, p, columns = sensor_pose(model.arm, q)
    moving, before = motion(columns, dq, ddq)
    specific = [a - g for a, g in zip(acceleration_at(p, moving), gravity, strict=True)]
    base = Felt(specific, moving.velocity.angular, moving.acceleration.angular)
    back = transpose(R)
    felt_bar: Felt
    theta_bar, felt_bar = jax.vjp(wrench_of, theta, Felt(*(times(back, x) for x in base)))[1](wrench_bar)
    base_bar = Felt(*(times(R, x) for x in felt_bar))
    moving_bar, p_bar = _moving_slopes(p, moving, base_bar)
    gravity_bar = [-x for x in base_bar.specific_force]
    rotation_bar = reduce(plus, [_outer(x, bar) for x, bar in zip(base, felt_bar, strict=True)])
    none = [jnp.zeros_like(q)] * 3
    columns_bar = Columns(none, none)
    if variance_bar is not None:
        added = _variance_slopes(theta, (R, p, columns), times(back, gravity), tuple(covariance), variance_bar)
        falling_bar = times(R, added.gravity)
        theta_bar, gravity_bar = total(theta_bar, added.theta), total(gravity_bar, falling_bar)
        p_bar = total(p_bar, added.pose.position)
        rotation_bar = plus(plus(rotation_bar, added.pose.rotation), _outer(gravity, added.gravity))
        columns_bar = added.pose.columns
    columns_bar = _column_slopes((columns, dq, ddq, before), moving_bar, columns_bar)
    return Slopes(gravity_bar, theta_bar, PoseSlopes(rotation_bar, p_bar, columns_bar))


def _moving_slopes(p: Vector, moving: Moving, bar: Felt) -> tuple[Moving, Vector]:
    """Slopes in the spatial motion of the last link and in the sensor's position."""
    (v, w), (_, w_rate) = moving
    a_bar = bar.specific_force
    v_bar = cross(a_bar, w)
    w_bar = total(bar.angular_velocity, cross(total(v, cross(w, p)), a_bar), cross(p, v_bar))
    w_rate_bar = total(bar.angular_acceleration, cross(p, a_bar))
    p_bar = total(cross(a_bar, w_rate), cross(v_bar, w))
    return Moving(Twist(v_bar, w_bar), Twist(a_bar, w_rate_bar)), p_bar


def _variance_slopes(
    theta: Vector, pose: tuple[Rows, Vector, Columns], g: Vector, covariance: tuple[Array, ...], bar: Vector
) -> Variance:
    """In three loops over the joints, for XLA works shared terms of one loop out again for every result."""
    R, p, columns = pose
    back, zero = transpose(R), jnp.zeros_like(bar[0])

    def see(_: None, column: Columns) -> tuple[None, Any]:
        turned = turned_by(back, p, g, column)
        return None, (turned, sensitivity(theta, turned))

    def weigh(theta_bar: Vector, own: Any) -> tuple[Vector, Any]:
        turned, (by_q, by_ddq), (qq, qa, aa) = own
        q_bar = [2 * z * (b * qq + a * qa) for z, a, b in zip(bar, by_ddq, by_q, strict=True)]
        ddq_bar = [2 * z * (b * qa + a * aa) for z, a, b in zip(bar, by_ddq, by_q, strict=True)]
        more, turned_bar = jax.vjp(sensitivity, theta, turned)[1]((q_bar, ddq_bar))
        return total(theta_bar, more), turned_bar

    def answer(sums: tuple[Vector, Vector, Rows], own: Any) -> tuple[Any, Columns]:
        g_bar, p_bar, rotation_bar = sums
        (V, W), turned, turned_bar = own
        linear_bar, falling_bar = turned_bar.linear, turned_bar.falling
        angular_bar = total(turned_bar.angular, cross(g, falling_bar))
        V_bar, turning_bar = times(R, linear_bar), times(R, angular_bar)
        at_sensor = total(V, cross(W, p))
        sums = (
            total(g_bar, cross(falling_bar, turned.angular)),
            total(p_bar, cross(V_bar, W)),
            plus(rotation_bar, plus(_outer(W, angular_bar), _outer(at_sensor, linear_bar))),
        )
        return sums, Columns(V_bar, total(turning_bar, cross(p, V_bar)))

    _, (turned, by) = jax.lax.scan(see, None, columns)
    theta_bar, turned_bar = jax.lax.scan(weigh, [zero] * 10, (turned, by, covariance))
    nothing = ([zero] * 3, [zero] * 3, [[zero] * 3] * 3)
    (g_bar, p_bar, rotation_bar), columns_bar = jax.lax.scan(answer, nothing, (columns, turned, turned_bar))
    return Variance(theta_bar, g_bar, PoseSlopes(rotation_bar, p_bar, columns_bar))


def _column_slopes(joints: tuple[Columns, Array, Array, Twist], bar: Moving, columns_bar: Columns) -> Columns:
    """All slopes in the columns, from the last joint to the first.

    Args:
        joints: columns of the Jacobian, dq, ddq, and the velocity before each joint.
        bar: slopes in the last link's motion.
        columns_bar: slopes in the columns so far.
    """
    a_bar, w_rate_bar = bar.acceleration

    def joint(velocity_bar: Twist, own: Any) -> tuple[Twist, Columns]:
        v_bar, w_bar = velocity_bar
        ((V, W), dq, ddq, (v, w)), (V_bar, W_bar) = own
        by_dq = total(v_bar, cross(a_bar, w)), total(w_bar, cross(a_bar, v), cross(w_rate_bar, w))
        V_bar = total(V_bar, scale(dq, by_dq[0]), scale(ddq, a_bar))
        W_bar = total(W_bar, scale(dq, by_dq[1]), scale(ddq, w_rate_bar))
        before = Twist(
            total(v_bar, scale(dq, cross(W, a_bar))),
            total(w_bar, scale(dq, total(cross(V, a_bar), cross(W, w_rate_bar)))),
        )
        return before, Columns(V_bar, W_bar)

    found: Columns = jax.lax.scan(joint, bar.velocity, (joints, columns_bar), reverse=True)[1]
    return found


def _outer(a: Vector, b: Vector) -> Rows:
    """a b^T."""
    return [[x * y for y in b] for x in a]
