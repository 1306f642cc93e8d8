"""The wrench of the tool, and what the joints' uncertainty adds to its variance, for a piece of a log.

The equations are those of ``pipeline.predict_wrench`` and ``tool_wrench.joint_sensitivity``; vectors are lists of
entries, each an array over samples (C,), as in arm_batch.py, and theta is the list of its ten numbers.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ftbias_jax.model.kinematics.arm_batch import Columns, Moving
from ftbias_jax.model.kinematics.seen_from_sensor import (
    Chain,
    Walk,
    at_last_joint,
    column_of,
    joint_before,
    moved_by,
    seen_by_sensor,
    turns_of,
)
from ftbias_jax.runtime.compiled_loops import compile_whole
from ftbias_jax.runtime.lanes import Vector, cross, scale, times, total

if TYPE_CHECKING:
    from jaxtyping import Float


class Felt(NamedTuple):
    """What the sensor feels of the motion, sensor frame."""

    specific_force: Vector
    """Acceleration of the sensor origin minus gravity, m/s^2."""
    angular_velocity: Vector
    angular_acceleration: Vector


def wrench_piece(
    chain: Chain, gravity: Float[Array, " 3"], theta: Float[Array, " 10"], columns: tuple[Array, ...], i: Array | int
) -> tuple[Vector, Vector]:
    """Wrench and variance of piece i, six entries (C,) each, with gravity in the base frame.

    The columns (pieces, n, C) are q, dq and ddq of the joints, rad, s, and P_qq, P_qa and P_aa, or none of these for
    zeros; velocities are left out, as in ``joint_sensitivity``. XLA would copy a piece that was cut out before, and
    so it would the row of a joint, number by number.
    """
    q, dq, ddq, *covariance = columns
    tool, zero = list(theta), jnp.zeros_like(q[0, 0])
    turns = turns_of(chain, jax.lax.dynamic_index_in_dim(q, i, 0, keepdims=False))
    g = seen_by_sensor(chain, turns, list(gravity))

    def moved(j: Array, column: Columns, dq: Array, ddq: Array, moving: Moving) -> Moving:
        return moved_by(column, row_of(dq, i, j), row_of(ddq, i, j), moving)

    def joint(carry: tuple[Walk, Vector], j: Array) -> tuple[tuple[Walk, Vector], None]:
        (axes, p, moving), variance = carry
        column = compile_whole(column_of)(chain, j, axes[2], p)
        moving = compile_whole(moved)(j, column, dq, ddq, moving)
        if covariance:
            by_q, by_ddq = sensitivity(tool, column, g)
            qq, qa, aa = (row_of(x, i, j) for x in covariance)
            added = [b * (b * qq + a * (2 * qa)) + a * (a * aa) for a, b in zip(by_ddq, by_q, strict=True)]
            variance = total(variance, added)
        axes, p = joint_before(chain, j, row_of(q, i, j), turns, axes, p)
        return (Walk(axes, p, moving), variance), None

    start = at_last_joint(chain, zero), [zero] * 6
    ((_, _, moving), variance), _ = jax.lax.scan(joint, start, jnp.arange(q.shape[1]), reverse=True)
    (v, w), (v_rate, w_rate) = moving
    specific = [a + b - c for a, b, c in zip(v_rate, cross(w, v), g, strict=True)]
    return wrench_of(tool, Felt(specific, w, w_rate)), variance


def row_of(columns: Float[Array, "pieces n C"], i: Array | int, j: Array | int) -> Float[Array, " C"]:
    """Row j of piece i."""
    row: Array = jax.lax.dynamic_slice(columns, (i, j, 0), (1, 1, columns.shape[2]))[0, 0]
    return row


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


def sensitivity(theta: Vector, column: Columns, g: Vector) -> tuple[Vector, Vector]:
    """Wrench per q and per ddq of one joint, six entries each, by its column of the Jacobian (``joint_sensitivity``).

    By q because gravity changes as the sensor turns, by ddq because the tool has inertia; all in the sensor frame.
    """
    falling = cross(column.angular, g)
    force, torque = inertial(theta, column.linear, column.angular)
    return [*scale(theta[0], falling), *cross(theta[1:4], falling)], [*force, *torque]
