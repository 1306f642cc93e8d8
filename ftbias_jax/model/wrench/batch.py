"""The wrench of the tool over many samples together: ``pipeline.predict_wrench`` with time as the last axis.

Time is split into pieces that stay in the processor's fastest cache, and the loop over them is compiled as a whole
(compiled_loops.py); the reverse pass recomputes each piece instead of storing it.

In a piece, vectors are lists of entries, each an array over samples (C,), as in arm_batch.py, and theta is the list of
its ten numbers. The equations are those of ``pipeline.predict_wrench`` and ``tool_wrench.joint_sensitivity``.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from ftbias_jax.model.kinematics.arm_batch import ArmMotion, Columns, Moving
from ftbias_jax.model.kinematics.screws import Arm
from ftbias_jax.model.kinematics.seen_from_sensor import (
    Chain,
    Walk,
    at_last_joint,
    chain_of,
    column_of,
    joint_before,
    moved_by,
    seen_by_sensor,
    turns_of,
)
from ftbias_jax.model.wrench.tool_wrench import Model, joint_sensitivity, motion_and_wrench
from ftbias_jax.runtime.compiled_loops import compile_whole, on_cpu, one_at_a_time
from ftbias_jax.runtime.lanes import Vector, cross, scale, times, total

PIECE = 128
"""Number of samples per piece, which are computed together."""

Joints = tuple[Array, ...]
"""q, dq, ddq, and covariances if any: (T, n), or in pieces (pieces, n, C)."""
Constants = tuple[Chain, Array, Array]
"""Chain of the arm, gravity and theta."""


def wrenches(model: Model, *entries: Float[Array, "T n"]) -> tuple[Float[Array, "T 6"], Float[Array, "T 6"]]:
    """Wrench D theta (T, 6) N, Nm, sensor frame, and the variance (T, 6) that the joints' uncertainty adds to it.

    The variance is the diagonal of sum_j G_j P_j G_j^T (tool_wrench.covariance_of_joints). The entries, (T, n) each,
    are q, dq and ddq, and P_qq, P_qa and P_aa of their covariance, or none of these for zeros.
    """
    return _of_samples(model, entries)


def wrenches_in_motion(
    gravity: Float[Array, " 3"], theta: Float[Array, " 10"], motion: ArmMotion
) -> Float[Array, "T 6"]:
    """Wrench D theta (T, 6) N, Nm, sensor frame, of a motion that is already computed.

    It allows derivatives in forward mode, which the hand-written reverse pass of ``wrenches`` does not. Reverse mode
    works too, but takes long to compile.
    """
    R_sensor_base = [list(column) for column in jnp.swapaxes(motion.sensor_rotation, 0, 1)]
    moving = motion.acceleration - gravity[:, None], motion.angular_velocity, motion.angular_acceleration
    return jnp.stack(wrench_of(list(theta), Felt(*(times(R_sensor_base, list(x)) for x in moving))), 1)


class Felt(NamedTuple):
    """Specific force and angular motion at the sensor, sensor frame."""

    specific_force: Vector
    """Acceleration of the sensor origin minus gravity, m/s^2."""
    angular_velocity: Vector
    angular_acceleration: Vector


def wrench_piece(
    chain: Chain, gravity: Float[Array, " 3"], theta: Float[Array, " 10"], joints: Joints, i: Array | int
) -> tuple[Vector, Vector]:
    """Wrench and variance of piece i, six entries (C,) each, with gravity in the base frame.

    ``joints`` (pieces, n, C) are q, dq and ddq of the joints, rad, s, and P_qq, P_qa and P_aa, or none of these for
    zeros; the uncertainty of velocities is neglected, as in ``joint_sensitivity``. Pieces and rows of joints are sliced
    where they are used, because XLA would copy an earlier slice number by number.
    """
    q, dq, ddq, *covariance = joints
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
    return jax.lax.dynamic_slice(columns, (i, j, 0), (1, 1, columns.shape[2]))[0, 0]


def wrench_of(theta: Vector, felt: Felt) -> Vector:
    """Wrench D theta (tool_wrench.data_matrix)."""
    f, w, w_rate = felt
    c = theta[1:4]
    force, torque = inertial(theta, f, w_rate)
    return [*total(force, cross(w, cross(w, c))), *total(torque, cross(w, turn(theta, w)))]


def inertial(theta: Vector, linear: Vector, angular: Vector) -> tuple[Vector, Vector]:
    """Force and torque that linear and angular acceleration require at zero angular velocity."""
    c = theta[1:4]
    return total(scale(theta[0], linear), cross(angular, c)), total(cross(c, linear), turn(theta, angular))


def turn(theta: Vector, angular: Vector) -> Vector:
    """Moment of inertia about the sensor origin times a vector."""
    xx, xy, xz, yy, yz, zz = theta[4:]
    return times([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], angular)


def sensitivity(theta: Vector, column: Columns, g: Vector) -> tuple[Vector, Vector]:
    """Derivatives of the wrench with respect to q and ddq of one joint, six entries each (``joint_sensitivity``).

    They follow from the joint's column of the Jacobian: q rotates gravity relative to the sensor, ddq accelerates the
    tool's inertia; all in the sensor frame.
    """
    falling = cross(column.angular, g)
    force, torque = inertial(theta, column.linear, column.angular)
    return [*scale(theta[0], falling), *cross(theta[1:4], falling)], [*force, *torque]


def _in_pieces(lanes: int, x: Array) -> Array:
    """(T, n) -> (pieces, n, lanes)."""
    x = jnp.pad(x, ((0, -x.shape[0] % lanes), (0, 0)))
    return jnp.swapaxes(x.reshape(-1, lanes, x.shape[1]), 1, 2)


def _whole(length: int, x: Array) -> Array:
    """(pieces, n, lanes) -> (T, n)."""
    return jnp.swapaxes(x, 1, 2).reshape(-1, x.shape[1])[:length]


def _lanes(length: int) -> int:
    """Number of samples per piece."""
    return PIECE if on_cpu() else length


@jax.custom_vjp
def _of_samples(model: Model, entries: Joints) -> tuple[Array, Array]:
    """Wrench and variance (T, 6)."""
    return _forward(model, entries)[0]


def _forward(model: Model, entries: Joints) -> tuple[tuple[Array, Array], tuple[Model, Joints]]:
    constants, length = (chain_of(model.arm), model.gravity, model.theta), len(entries[0])
    pieces = jax.tree.map(partial(_in_pieces, _lanes(length)), entries)
    found: tuple[Array, Array] = jax.tree.map(partial(_whole, length), one_at_a_time(_all_wrenches)(constants, pieces))
    return found, (model, entries)


def _backward(residual: tuple[Model, Joints], bars: tuple[Array, ...]) -> tuple[Model, Joints]:
    model, entries = residual
    if len(entries) == 3:  # The variance is zero, and XLA aborts on an argument that is never read.
        bars = bars[:1]
    constants, length = (chain_of(model.arm), model.gravity, model.theta), len(entries[0])
    pieces = jax.tree.map(partial(_in_pieces, _lanes(length)), (entries, bars))
    joints: Joints = jax.tree.map(partial(_whole, length), one_at_a_time(_joint_gradients)(constants, pieces))
    # Gradients with respect to the model are rarely needed, so they are computed separately or not at all.
    gravity, theta = one_at_a_time(_tool_gradients)(constants, *pieces)
    return Model(one_at_a_time(_arm_gradients)(model, *pieces), gravity, theta), joints


_of_samples.defvjp(_forward, _backward)


@compile_whole
def _all_wrenches(constants: Constants, columns: Joints) -> tuple[Array, Array]:
    chain, gravity, theta = constants

    def one(i: Array) -> tuple[Array, Array]:
        wrench, variance = wrench_piece(chain, gravity, theta, columns, i)
        return jnp.stack(wrench), jnp.stack(variance)

    return jax.lax.map(one, jnp.arange(columns[0].shape[0]))


@compile_whole
def _joint_gradients(constants: Constants, given: tuple[Joints, tuple[Array, ...]]) -> Joints:
    """Gradients with respect to the joints' entries, in the columns of each piece."""
    chain, gravity, theta = constants

    def one(piece: tuple[Joints, tuple[Array, ...]]) -> Joints:
        columns, bars = piece

        def of_joints(columns: Joints) -> tuple[Vector, ...]:
            return wrench_piece(chain, gravity, theta, tuple(x[None] for x in columns), 0)[: len(bars)]

        return jax.vjp(of_joints, columns)[1](tuple(map(list, bars)))[0]

    return jax.lax.map(one, given)


@compile_whole
def _tool_gradients(constants: Constants, columns: Joints, bars: tuple[Array, ...]) -> tuple[Array, Array]:
    """Gradients with respect to gravity and theta."""
    chain, gravity, theta = constants

    def one(sums: tuple[Array, Array], i: Array) -> tuple[tuple[Array, Array], None]:
        pull = jax.vjp(lambda g, theta: wrench_piece(chain, g, theta, columns, i)[: len(bars)], gravity, theta)[1]
        return jax.tree.map(jnp.add, sums, pull(tuple(list(bar[i]) for bar in bars))), None

    start = jnp.zeros_like(gravity), jnp.zeros_like(theta)
    return jax.lax.scan(one, start, jnp.arange(columns[0].shape[0]))[0]


def _arm_gradients(model: Model, columns: Joints, bars: tuple[Array, ...]) -> Arm:
    """Gradients with respect to the arm's constants, by textbook equations: a chain's are infinite at parallel axes."""

    def sample(arm: Arm, joints: Joints) -> tuple[Array, ...]:
        motion, wrench = motion_and_wrench(arm, model.gravity, model.theta, *joints[:3])
        if len(joints) == 3:
            return (wrench,)
        by_q, by_ddq = joint_sensitivity(model.theta, motion.R_base_sensor, motion.jacobian, model.gravity)
        qq, qa, aa = joints[3:]
        return wrench, by_q**2 @ qq + 2 * (by_q * by_ddq) @ qa + by_ddq**2 @ aa

    def one(sums: Arm, piece: tuple[Joints, tuple[Array, ...]]) -> tuple[Arm, None]:
        joints, bars = piece
        pull = jax.vjp(lambda arm: jax.vmap(partial(sample, arm), 1, 1)(joints), model.arm)[1]
        return jax.tree.map(jnp.add, sums, pull(bars)[0]), None

    return jax.lax.scan(one, jax.tree.map(jnp.zeros_like, model.arm), (columns, bars))[0]
