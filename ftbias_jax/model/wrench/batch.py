"""The wrench of the tool over many samples at once: ``pipeline.predict_wrench`` with time as the last axis.

Time is cut into pieces that stay in the processor's fastest cache, and the loop over them is compiled as a whole
(compiled_loops.py); the reverse pass works each piece out again instead of storing it.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
from jax import Array

from ftbias_jax.model.kinematics.arm_batch import ArmMotion, sensor_pose
from ftbias_jax.model.kinematics.seen_from_sensor import Chain, chain_of
from ftbias_jax.model.wrench.adjoint import PoseSlopes, Slopes, slopes_of_piece
from ftbias_jax.model.wrench.joint_slopes import slopes_of_joints
from ftbias_jax.model.wrench.piece import felt_of, wrench_of, wrench_piece
from ftbias_jax.model.wrench.tool_wrench import Model
from ftbias_jax.runtime.compiled_loops import compile_whole, on_cpu, one_at_a_time
from ftbias_jax.runtime.lanes import Vector
from ftbias_jax.runtime.side_by_side import samples_as_lanes

if TYPE_CHECKING:
    from jaxtyping import Float


PIECE = 128
"""Samples worked out together."""

Columns = tuple[Array, ...]
"""q, dq, ddq, and covariances if any: (T, n), or in pieces (pieces, n, C)."""
Constants = tuple[Chain, Array, Array]
"""Arm, gravity and theta."""


def wrenches(model: Model, *entries: Float[Array, "T n"]) -> tuple[Float[Array, "T 6"], Float[Array, "T 6"]]:
    """D theta, and the diagonal of sum_j G_j P_j G_j^T (tool_wrench.covariance_of_joints).

    Args:
        model: arm, gravity and tool.
        *entries: (T, n) q, dq and ddq, and of their covariance P_qq, P_qa and P_aa, or none of these for zeros.

    Returns:
        wrench (T, 6) N, Nm, sensor frame, and the variance that the joints' uncertainty adds to it (T, 6).
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
    rates = (list(x) for x in (motion.acceleration, motion.angular_velocity, motion.angular_acceleration))
    return jnp.stack(wrench_of(list(theta), felt_of(list(gravity), R_sensor_base, *rates)), 1)


def _in_pieces(lanes: int, x: Array) -> Array:
    """(T, n) -> (pieces, n, lanes)."""
    x = jnp.pad(x, ((0, -x.shape[0] % lanes), (0, 0)))
    return jnp.swapaxes(x.reshape(-1, lanes, x.shape[1]), 1, 2)


def _lanes(length: int) -> int:
    """Of a piece."""
    return PIECE if on_cpu() else length


@jax.custom_vjp
def _of_samples(model: Model, entries: Columns) -> tuple[Array, Array]:
    """Wrench and variance (T, 6)."""
    return _forward(model, entries)[0]


def _forward(model: Model, entries: Columns) -> tuple[tuple[Array, Array], tuple[Model, Columns]]:
    constants = chain_of(model.arm), model.gravity, model.theta
    found: tuple[Array, Array] = samples_as_lanes(_all_wrenches, _lanes(len(entries[0])))(constants, entries)
    return found, (model, entries)


def _backward(residual: tuple[Model, Columns], bars: tuple[Array, ...]) -> tuple[Model, Columns]:
    model, entries = residual
    if len(entries) == 3:  # the variance is zero: XLA aborts on an argument that is never read
        bars = bars[:1]
    constants, lanes = (chain_of(model.arm), model.gravity, model.theta), _lanes(len(entries[0]))
    joints: Columns = samples_as_lanes(_joint_slopes, lanes)(constants, (entries, bars))
    # Few ask for the slopes in the model: they are worked out apart, or not at all.
    columns, bars = jax.tree.map(partial(_in_pieces, lanes), (entries, bars))
    gravity, theta, pose = one_at_a_time(_model_slopes)(model, columns, bars)
    arm = one_at_a_time(_arm_slopes)(model, columns[0], pose)
    gravity, theta = (jnp.stack([entry.sum() for entry in entries]) for entries in (gravity, theta))
    return Model(arm, gravity, theta), joints


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
    (chain, gravity, theta), (columns, bars) = constants, given

    def one(i: Array) -> Columns:
        return slopes_of_joints(chain, gravity, theta, columns, bars, i)

    found: Columns = jax.lax.map(one, jnp.arange(columns[0].shape[0]))
    return found


@compile_whole
def _model_slopes(model: Model, columns: Columns, bars: tuple[Array, ...]) -> tuple[Vector, Vector, PoseSlopes]:
    found: tuple[Vector, Vector, PoseSlopes]
    found = jax.lax.map(lambda piece: _slopes(model, *piece), (columns, bars))
    return found


def _slopes(model: Model, columns: Columns, bars: tuple[Array, ...]) -> Slopes:
    return slopes_of_piece(model, columns, *(list(bar) for bar in bars))


def _arm_slopes(model: Model, q: Array, bars: PoseSlopes) -> Any:
    """Slopes in the arm's constants; few ask for them."""

    def one(sums: Any, piece: tuple[Array, PoseSlopes]) -> tuple[Any, None]:
        q, bar = piece
        (slopes,) = jax.vjp(lambda arm: sensor_pose(arm, q), model.arm)[1](tuple(bar))
        return jax.tree.map(jnp.add, sums, slopes), None

    return jax.lax.scan(one, jax.tree.map(jnp.zeros_like, model.arm), (q, bars))[0]
