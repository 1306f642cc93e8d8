"""The adjoint of piece.py by hand: about twice the work of the wrench, and quick to compile.

Gradients of the likelihood run it (batch.py). ``x_bar`` is the slope dL/dx, and a line of piece.py that makes y adds
its share of y_bar to the slopes of what it read:

    y = M v      v_bar += M^T y_bar,     M_bar += y_bar v^T
    y = a × b    a_bar += b × y_bar,     b_bar += y_bar × a     because a × b . c = b × c . a = c × a . b
    y = s v      v_bar += s y_bar,       s_bar += v . y_bar

What is felt in sensor axes is R^T u, for u = a - g, w and w', so u_bar = R felt_bar and g_bar = -a_bar. A small turn
e of the sensor changes it by -R^T (e × u): its slope is the moment sum u_bar × u (``spin``). The acceleration of the
point p of the last link and the sums over the joints,

    a = v' + w' × p + w × (v + w × p)
    v' += ddq V + dq (w × V + v × W),   w' += ddq W + dq w × W,   v += dq V,   w += dq W,

give ``_moving_slopes`` and ``_joint_slopes`` line by line, the joints from the last to the first. Turning joint j by a
small angle moves all that it carries by its screw (V_j, W_j): the point p by V_j + W_j × p, and a column (V, W) of the
Jacobian by (W_j × V + V_j × W, W_j × W). So the slope in q_j is the screw times the moment and the force of all slopes
behind the joint (``load``), like the torque of a joint in statics. The variance, of which a joint adds
b^2 qq + 2 a b qa + a^2 aa, is differentiated in the same way (``_variance_slopes``).

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
from ftbias_jax.runtime.lanes import Rows, Vector, cross, dot, plus, scale, times, total, transpose


class PoseSlopes(NamedTuple):
    """Slopes in what ``arm_batch.sensor_pose`` returns."""

    rotation: Rows
    position: Vector
    columns: Columns


class Slopes(NamedTuple):
    """Slopes in what a piece was given."""

    joints: tuple[Array, ...]
    """In q, dq, ddq, and the covariances if there are any, (n, C) each."""
    gravity: Vector
    """Entries (C,)."""
    theta: Vector
    """Entries (C,)."""
    pose: PoseSlopes
    """In the pose at given q, which the arm's constants have to answer for."""


class Variance(NamedTuple):
    """What the slopes of the variance add to others."""

    covariance: tuple[Array, ...]
    theta: Vector
    gravity: Vector
    """In gravity as seen by the sensor."""
    spin: Vector
    """Moment on the sensor: slope in a rotation of it, base frame."""
    pose: PoseSlopes


def slopes_of_piece(model: Model, joints: tuple[Array, ...], wrench_bar: Vector, variance_bar: Vector) -> Slopes:
    """Slopes of a piece; model and joints as ``wrench_piece`` takes them, bars of the six entries (C,)."""
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
    spin = total(*(cross(bar, x) for bar, x in zip(base_bar, base, strict=True)))
    rotation_bar = reduce(plus, [_outer(x, bar) for x, bar in zip(base, felt_bar, strict=True)])
    none = [jnp.zeros_like(q)] * 3
    columns_bar = Columns(none, none)
    covariance_bar: tuple[Array, ...] = ()
    if covariance:
        added = _variance_slopes(theta, (R, p, columns), times(back, gravity), tuple(covariance), variance_bar)
        falling_bar = times(R, added.gravity)
        theta_bar, gravity_bar = total(theta_bar, added.theta), total(gravity_bar, falling_bar)
        spin, p_bar = total(spin, added.spin, cross(falling_bar, gravity)), total(p_bar, added.pose.position)
        rotation_bar = plus(plus(rotation_bar, added.pose.rotation), _outer(gravity, added.gravity))
        columns_bar, covariance_bar = added.pose.columns, added.covariance
    load = total(spin, cross(p, p_bar)), p_bar
    joint_bars, columns_bar = _joint_slopes((columns, dq, ddq, before), moving_bar, columns_bar, load)
    pose = PoseSlopes(rotation_bar, p_bar, columns_bar)
    return Slopes((*joint_bars, *covariance_bar), gravity_bar, theta_bar, pose)


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
        qq_bar, aa_bar = (dot(bar, [x**2 for x in y]) for y in (by_q, by_ddq))
        qa_bar = 2 * dot(bar, [a * b for a, b in zip(by_ddq, by_q, strict=True)])
        return total(theta_bar, more), (turned_bar, (qq_bar, qa_bar, aa_bar))

    def answer(sums: tuple[Vector, Vector, Vector, Rows], own: Any) -> tuple[Any, Columns]:
        g_bar, spin, p_bar, rotation_bar = sums
        (V, W), turned, turned_bar = own
        linear_bar, falling_bar = turned_bar.linear, turned_bar.falling
        angular_bar = total(turned_bar.angular, cross(g, falling_bar))
        V_bar, turning_bar = times(R, linear_bar), times(R, angular_bar)
        at_sensor = total(V, cross(W, p))
        sums = (
            total(g_bar, cross(falling_bar, turned.angular)),
            total(spin, cross(turning_bar, W), cross(V_bar, at_sensor)),
            total(p_bar, cross(V_bar, W)),
            plus(rotation_bar, plus(_outer(W, angular_bar), _outer(at_sensor, linear_bar))),
        )
        return sums, Columns(V_bar, total(turning_bar, cross(p, V_bar)))

    _, (turned, by) = jax.lax.scan(see, None, columns)
    theta_bar, (turned_bar, covariance_bar) = jax.lax.scan(weigh, [zero] * 10, (turned, by, covariance))
    nothing = ([zero] * 3, [zero] * 3, [zero] * 3, [[zero] * 3] * 3)
    (g_bar, spin, p_bar, rotation_bar), columns_bar = jax.lax.scan(answer, nothing, (columns, turned, turned_bar))
    return Variance(covariance_bar, theta_bar, g_bar, spin, PoseSlopes(rotation_bar, p_bar, columns_bar))


def _joint_slopes(
    joints: tuple[Columns, Array, Array, Twist], bar: Moving, columns_bar: Columns, load: tuple[Vector, Vector]
) -> tuple[tuple[Array, ...], Columns]:
    """From the last joint to the first.

    Args:
        joints: columns of the Jacobian, dq, ddq, and the velocity before each joint.
        bar: slopes in the last link's motion.
        columns_bar: slopes in the columns so far.
        load: moment and force of the slopes behind the last one.

    Returns:
        slopes in q, dq and ddq (n, C), and all slopes in the columns.
    """
    a_bar, w_rate_bar = bar.acceleration

    def joint(carry: tuple[Twist, tuple[Vector, Vector]], own: Any) -> tuple[Any, Any]:
        (v_bar, w_bar), (moment, force) = carry
        ((V, W), dq, ddq, (v, w)), (V_bar, W_bar) = own
        by_dq = total(v_bar, cross(a_bar, w)), total(w_bar, cross(a_bar, v), cross(w_rate_bar, w))
        V_bar = total(V_bar, scale(dq, by_dq[0]), scale(ddq, a_bar))
        W_bar = total(W_bar, scale(dq, by_dq[1]), scale(ddq, w_rate_bar))
        q_bar = dot(W, moment) + dot(V, force)
        bars = (q_bar, dot(V, by_dq[0]) + dot(W, by_dq[1]), dot(V, a_bar) + dot(W, w_rate_bar))
        before = Twist(
            total(v_bar, scale(dq, cross(W, a_bar))),
            total(w_bar, scale(dq, total(cross(V, a_bar), cross(W, w_rate_bar)))),
        )
        load = total(moment, cross(V, V_bar), cross(W, W_bar)), total(force, cross(W, V_bar))
        return (before, load), (bars, Columns(V_bar, W_bar))

    _, found = jax.lax.scan(joint, (bar.velocity, load), (joints, columns_bar), reverse=True)
    slopes: tuple[tuple[Array, ...], Columns] = found
    return slopes


def _outer(a: Vector, b: Vector) -> Rows:
    """a b^T."""
    return [[x * y for y in b] for x in a]
