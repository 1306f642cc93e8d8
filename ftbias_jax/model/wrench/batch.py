"""The wrench of the tool over many samples at once: ``pipeline.predict_wrench`` with time as the last axis.

Time is cut into pieces that stay in the processor's fastest cache, and the loop over them is compiled as a whole
(compiled_loops.py); the reverse pass works each piece out again instead of storing it.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
from jax import Array

from ftbias_jax.model.kinematics.arm_batch import ArmMotion
from ftbias_jax.model.kinematics.screws import Arm
from ftbias_jax.model.kinematics.seen_from_sensor import Chain, chain_of
from ftbias_jax.model.wrench.piece import Felt, wrench_of, wrench_piece
from ftbias_jax.model.wrench.tool_wrench import Model, joint_sensitivity, motion_and_wrench
from ftbias_jax.runtime.compiled_loops import compile_whole, on_cpu, one_at_a_time
from ftbias_jax.runtime.lanes import Vector, times

if TYPE_CHECKING:
    from jaxtyping import Float


PIECE = 128
"""Samples worked out together."""

Columns = tuple[Array, ...]
"""q, dq, ddq, and covariances if any: (T, n), or in pieces (pieces, n, C)."""
Constants = tuple[Chain, Array, Array]
"""Arm, gravity and theta."""


def wrenches(model: Model, *entries: Float[Array, "T n"]) -> tuple[Float[Array, "T 6"], Float[Array, "T 6"]]:
    """D theta (T, 6) N, Nm, sensor frame, and the variance (T, 6) that the joints' uncertainty adds to it.

    The latter is the diagonal of sum_j G_j P_j G_j^T (tool_wrench.covariance_of_joints). The entries, (T, n) each, are
    q, dq and ddq, and of their covariance P_qq, P_qa and P_aa, or none of these for zeros.
    """
    return _of_samples(model, entries)


def wrenches_in_motion(
    gravity: Float[Array, " 3"], theta: Float[Array, " 10"], motion: ArmMotion
) -> Float[Array, "T 6"]:
    """D theta (T, 6) as above, of a motion that was worked out before.

    For derivatives in forward mode, which the hand-written reverse pass does not allow. Reverse mode works too, but
    takes long to compile.
    """
    R_sensor_base = [list(column) for column in jnp.swapaxes(motion.sensor_rotation, 0, 1)]
    moving = motion.acceleration - gravity[:, None], motion.angular_velocity, motion.angular_acceleration
    return jnp.stack(wrench_of(list(theta), Felt(*(times(R_sensor_base, list(x)) for x in moving))), 1)


def _in_pieces(lanes: int, x: Array) -> Array:
    """(T, n) -> (pieces, n, lanes)."""
    x = jnp.pad(x, ((0, -x.shape[0] % lanes), (0, 0)))
    return jnp.swapaxes(x.reshape(-1, lanes, x.shape[1]), 1, 2)


def _whole(length: int, x: Array) -> Array:
    """(pieces, n, lanes) -> (T, n)."""
    return jnp.swapaxes(x, 1, 2).reshape(-1, x.shape[1])[:length]


def _lanes(length: int) -> int:
    """Of a piece."""
    return PIECE if on_cpu() else length


@jax.custom_vjp
def _of_samples(model: Model, entries: Columns) -> tuple[Array, Array]:
    """Wrench and variance (T, 6)."""
    return _forward(model, entries)[0]


def _forward(model: Model, entries: Columns) -> tuple[tuple[Array, Array], tuple[Model, Columns]]:
    constants, length = (chain_of(model.arm), model.gravity, model.theta), len(entries[0])
    pieces = jax.tree.map(partial(_in_pieces, _lanes(length)), entries)
    found: tuple[Array, Array] = jax.tree.map(partial(_whole, length), one_at_a_time(_all_wrenches)(constants, pieces))
    return found, (model, entries)


def _backward(residual: tuple[Model, Columns], bars: tuple[Array, ...]) -> tuple[Model, Columns]:
    model, entries = residual
    if len(entries) == 3:  # the variance is zero: XLA aborts on an argument that is never read
        bars = bars[:1]
    constants, length = (chain_of(model.arm), model.gravity, model.theta), len(entries[0])
    pieces = jax.tree.map(partial(_in_pieces, _lanes(length)), (entries, bars))
    joints: Columns = jax.tree.map(partial(_whole, length), one_at_a_time(_joint_slopes)(constants, pieces))
    # Few ask for the slopes in the model: they are worked out apart, or not at all.
    gravity, theta = one_at_a_time(_tool_slopes)(constants, *pieces)
    return Model(one_at_a_time(_arm_slopes)(model, *pieces), gravity, theta), joints


_of_samples.defvjp(_forward, _backward)


@compile_whole
def _all_wrenches(constants: Constants, columns: Columns) -> tuple[Array, Array]:
    chain, gravity, theta = constants

    def one(i: Array) -> tuple[Array, Array]:
        wrench, variance = wrench_piece(chain, gravity, theta, columns, i)
        return jnp.stack(wrench), jnp.stack(variance)

    found: tuple[Array, Array] = jax.lax.map(one, jnp.arange(columns[0].shape[0]))
    return found


@compile_whole
def _joint_slopes(constants: Constants, given: tuple[Columns, tuple[Array, ...]]) -> Columns:
    """Slopes in what the joints do, in the columns of each piece."""
    chain, gravity, theta = constants

    def one(piece: tuple[Columns, tuple[Array, ...]]) -> Columns:
        columns, bars = piece

        def of_joints(columns: Columns) -> tuple[Vector, ...]:
            return wrench_piece(chain, gravity, theta, tuple(x[None] for x in columns), 0)[: len(bars)]

        found: Columns = jax.vjp(of_joints, columns)[1](tuple(map(list, bars)))[0]
        return found

    found: Columns = jax.lax.map(one, given)
    return found


@compile_whole
def _tool_slopes(constants: Constants, columns: Columns, bars: tuple[Array, ...]) -> tuple[Array, Array]:
    """Slopes in gravity and theta."""
    chain, gravity, theta = constants

    def one(sums: tuple[Array, Array], i: Array) -> tuple[tuple[Array, Array], None]:
        pull = jax.vjp(lambda g, theta: wrench_piece(chain, g, theta, columns, i)[: len(bars)], gravity, theta)[1]
        return jax.tree.map(jnp.add, sums, pull(tuple(list(bar[i]) for bar in bars))), None

    start = jnp.zeros_like(gravity), jnp.zeros_like(theta)
    found: tuple[Array, Array] = jax.lax.scan(one, start, jnp.arange(columns[0].shape[0]))[0]
    return found


def _arm_slopes(model: Model, columns: Columns, bars: tuple[Array, ...]) -> Arm:
    """Slopes in the arm's constants, of the textbook's equations: those of a chain are infinite at parallel axes."""

    def sample(arm: Arm, joints: Columns) -> tuple[Array, ...]:
        motion, wrench = motion_and_wrench(arm, model.gravity, model.theta, *joints[:3])
        if len(joints) == 3:
            return (wrench,)
        by_q, by_ddq = joint_sensitivity(model.theta, motion.R_base_sensor, motion.jacobian, model.gravity)
        qq, qa, aa = joints[3:]
        return wrench, by_q**2 @ qq + 2 * (by_q * by_ddq) @ qa + by_ddq**2 @ aa

    def one(sums: Arm, piece: tuple[Columns, tuple[Array, ...]]) -> tuple[Arm, None]:
        joints, bars = piece
        pull = jax.vjp(lambda arm: jax.vmap(partial(sample, arm), 1, 1)(joints), model.arm)[1]
        return jax.tree.map(jnp.add, sums, pull(bars)[0]), None

    found: Arm = jax.lax.scan(one, jax.tree.map(jnp.zeros_like, model.arm), (columns, bars))[0]
    return found
