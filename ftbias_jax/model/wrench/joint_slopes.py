"""The adjoint of piece.py in what the joints do, by hand: slopes in q, dq, ddq and their covariance.

Everything is in sensor axes, where the motion is a sum over the joints: with (V, W) the column of joint j and (v, w)
the velocity that the joints behind it give the sensor, U = dq V and u = dq W,

    v' += ddq V + U x w + u x v,    w' += ddq W + u x w,    v += U,    w += u,    a = v' + w x v.

A line y = s x t adds t x y_bar to the slope of s, and y_bar x s to that of t. So one walk from the sensor to the base
works out the columns and the velocity, and a second one back the slopes. Turning joint j by a small angle turns gravity
and the columns of all joints before it back by its screw: the slope in q_j is minus the screw times the moment and the
force of their slopes, like the torque of a joint in statics. The variance, of which a joint adds
b^2 qq + 2 a b qa + a^2 aa, is differentiated on the way back.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ftbias_jax.model.kinematics.arm_batch import Columns, Twist
from ftbias_jax.model.kinematics.seen_from_sensor import (
    Chain,
    at_last_joint,
    column_of,
    joint_before,
    seen_by_sensor,
    turns_of,
)
from ftbias_jax.model.wrench.piece import falling, row_of, sensitivity, turn
from ftbias_jax.runtime.compiled_loops import compile_whole
from ftbias_jax.runtime.lanes import Vector, cross, dot, scale, total


class Back(NamedTuple):
    """What the way back knows before joint j: slopes in what the joints from the base to it have to answer for."""

    velocity: Twist
    """Velocity of the joints behind."""
    velocity_bar: Twist
    moment: Vector
    force: Vector
    gravity: Vector


def slopes_of_joints(
    chain: Chain, gravity: Array, theta: Array, columns: tuple[Array, ...], bars: tuple[Array, ...], i: Array
) -> tuple[Array, ...]:
    """Slopes in the columns of piece i, (n, C) each; arguments are those of ``wrench_piece``.

    The bars (pieces, 6, C) are slopes in the wrench, and in the variance if there are covariances.
    """
    q, dq, ddq, *covariance = columns
    tool, zero = list(theta), jnp.zeros_like(q[0, 0])
    turns = turns_of(chain, jax.lax.dynamic_index_in_dim(q, i, 0, keepdims=False))
    g = seen_by_sensor(chain, turns, list(gravity))
    wrench_bar, *variance_bar = ([row_of(bar, i, a) for a in range(6)] for bar in bars)

    def out(carry: Any, j: Array) -> tuple[Any, Columns]:
        axes, p, (v, w) = carry
        column = column_of(chain, j, axes[2], p)
        speed = row_of(dq, i, j)
        axes, p = joint_before(chain, j, row_of(q, i, j), turns, axes, p)
        velocity = Twist(total(v, scale(speed, column.linear)), total(w, scale(speed, column.angular)))
        return (axes, p, velocity), column

    start = at_last_joint(chain, zero)
    joints = jnp.arange(q.shape[1])
    (_, _, velocity), seen = jax.lax.scan(
        out, (start.axes, start.position, start.moving.velocity), joints, reverse=True
    )
    (v, w), (f_bar, w_bar, w_rate_bar) = velocity, _felt_slopes(tool, velocity.angular, wrench_bar)
    velocity_bar = Twist(cross(f_bar, w), total(w_bar, cross(v, f_bar)))

    def back(carry: Back, j: Array) -> tuple[Back, tuple[Array, ...]]:
        column = Columns(*([x[j] for x in part] for part in seen))
        moved = compile_whole(_motion_slopes)(
            j, i, dq, ddq, column, carry.velocity, carry.velocity_bar, f_bar, w_rate_bar
        )
        (U_bar, u_bar), (V_bar, W_bar), velocity, after = moved
        V, W = column
        q_bar = -dot(W, carry.moment) - dot(V, carry.force)
        found = [q_bar, dot(V, U_bar) + dot(W, u_bar), dot(V, f_bar) + dot(W, w_rate_bar)]
        g_bar = carry.gravity
        if covariance:
            rows = tuple(row_of(x, i, j) for x in covariance)
            (V_more, W_more, g_more), more = compile_whole(_variance_slopes)(tool, column, g, rows, *variance_bar)
            V_bar, W_bar, g_bar = total(V_bar, V_more), total(W_bar, W_more), total(g_bar, g_more)
            found = [*found, *more]
        moment = total(carry.moment, cross(V, V_bar), cross(W, W_bar))
        return Back(velocity, after, moment, total(carry.force, cross(W, V_bar)), g_bar), tuple(found)

    none = [zero] * 3
    first = Back(velocity, velocity_bar, none, none, [-x for x in f_bar])
    last, (q_bar, *rest) = jax.lax.scan(back, first, joints)
    fall = cross(g, last.gravity)
    q_bar = q_bar - dot(seen.angular, [x[None] for x in fall])
    return (q_bar, *rest)


def _felt_slopes(theta: Vector, w: Vector, bar: Vector) -> tuple[Vector, Vector, Vector]:
    """Of ``wrench_of``: in the specific force, the angular velocity and the angular acceleration."""
    c, force, torque = theta[1:4], bar[:3], bar[3:]
    f_bar = total(scale(theta[0], force), cross(torque, c))
    rate_bar = total(cross(c, force), turn(theta, torque))
    of_force = total(cross(cross(w, c), force), cross(c, cross(force, w)))  # w x (w x c)
    of_torque = total(cross(turn(theta, w), torque), turn(theta, cross(torque, w)))  # w x I w
    return f_bar, total(of_force, of_torque), rate_bar


def _motion_slopes(
    j: Array,
    i: Array,
    dq: Array,
    ddq: Array,
    column: Columns,
    velocity: Twist,
    bar: Twist,
    v_rate_bar: Vector,
    w_rate_bar: Vector,
) -> tuple[Twist, Columns, Twist, Twist]:
    """Slopes in (U, u), in the column, the velocity without this joint, and the slopes in that velocity."""
    V, W = column
    speed, rate = row_of(dq, i, j), row_of(ddq, i, j)
    U, u = scale(speed, V), scale(speed, W)
    v, w = ([x - y for x, y in zip(a, b, strict=True)] for a, b in zip(velocity, (U, u), strict=True))
    U_bar = total(bar.linear, cross(w, v_rate_bar))
    u_bar = total(bar.angular, cross(v, v_rate_bar), cross(w, w_rate_bar))
    V_bar = total(scale(speed, U_bar), scale(rate, v_rate_bar))
    W_bar = total(scale(speed, u_bar), scale(rate, w_rate_bar))
    v_bar = total(bar.linear, cross(v_rate_bar, u))
    w_bar = total(bar.angular, cross(v_rate_bar, U), cross(w_rate_bar, u))
    return Twist(U_bar, u_bar), Columns(V_bar, W_bar), Twist(v, w), Twist(v_bar, w_bar)


def _variance_slopes(
    theta: Vector, column: Columns, g: Vector, covariance: tuple[Array, ...], bar: Vector
) -> tuple[tuple[Vector, Vector, Vector], list[Array]]:
    """What one joint adds to the slopes in its column, in gravity, and in its covariance."""
    W = column.angular
    qq, qa, aa = covariance
    by_q, by_ddq = compile_whole(_sensitivity)(theta, column, g)
    q_weighed, ddq_weighed = ([2 * z * x for z, x in zip(bar, y, strict=True)] for y in (by_q, by_ddq))
    q_bar = [b * qq + a * qa for a, b in zip(ddq_weighed, q_weighed, strict=True)]
    ddq_bar = [b * qa + a * aa for a, b in zip(ddq_weighed, q_weighed, strict=True)]
    m, c = theta[0], theta[1:4]
    falling_bar = total(scale(m, q_bar[:3]), cross(q_bar[3:], c))
    V_bar = total(scale(m, ddq_bar[:3]), cross(ddq_bar[3:], c))
    W_bar = total(cross(c, ddq_bar[:3]), turn(theta, ddq_bar[3:]), cross(g, falling_bar))
    slopes = [dot(q_weighed, by_q) / 2, dot(q_weighed, by_ddq), dot(ddq_weighed, by_ddq) / 2]
    return (V_bar, W_bar, cross(falling_bar, W)), slopes


def _sensitivity(theta: Vector, column: Columns, g: Vector) -> tuple[Vector, Vector]:
    return sensitivity(theta, falling(column, g))
