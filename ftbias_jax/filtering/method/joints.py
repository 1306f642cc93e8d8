"""The joints of a log, filtered or smoothed, and the wrench that the tool must cause."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp

from ftbias_jax.filtering.fast.kalman_step import Packed
from ftbias_jax.filtering.fast.rts import smooth_back
from ftbias_jax.filtering.fast.scan import States, filter_sums
from ftbias_jax.filtering.fast.stages import joint_inputs, joint_states, predict_wrenches, signals_of
from ftbias_jax.filtering.process_models import JOINT_MODELS
from ftbias_jax.filtering.step import Options, State
from ftbias_jax.model.effects import compose
from ftbias_jax.model.params import Params
from ftbias_jax.runtime.lanes import upper
from ftbias_jax.runtime.pieces import over_pieces
from ftbias_jax.types import Array, Gaussian, Sample

if TYPE_CHECKING:
    from jaxtyping import Float


class Joints(NamedTuple):
    """Position, velocity and acceleration of the joints at every sample, and what follows from them."""

    mean: tuple[Float[Array, "T n"], Float[Array, "T n"], Float[Array, "T n"]]
    """rad, rad/s, rad/s^2."""
    ddq_std: Float[Array, "T n"]
    """rad/s^2."""
    wrench_tool: Float[Array, "T 6"]
    """N, Nm; with the known effects, if there are any."""
    variance: Float[Array, "T 6"]
    """N^2, Nm^2, diagonal of R as the setup states it."""
    known_bias: Float[Array, "T 6"] | None
    """N, Nm, what known effects add to the bias; None = there are none."""
    log_likelihood: Float[Array, ""]
    """nats of the joints' measurements."""


def filter_joints(
    params: Params, state: State, samples: Sample, length: Array, options: Options
) -> tuple[State, Joints]:
    """The joints from the past alone, as a filter on the robot knows them; arguments as for ``smooth_joints``."""

    def forward(joint: Gaussian, piece: tuple[Sample, Array]) -> tuple[Gaussian, Any]:
        after, states, nats = _forward(params, state._replace(joint=joint), *piece, options)
        return after, (_kept(params, states, piece[0], options), nats)

    counted = jnp.arange(len(samples.dt)) < length
    last, (kept, nats) = over_pieces(forward, state.joint, (samples, counted), length)
    return state._replace(joint=last), _joints(params, samples, kept, nats, options)


def smooth_joints(
    params: Params,
    state: State,
    samples: Sample,
    length: Array,
    options: Options,
    seen: Array | None = None,
) -> tuple[State, Joints]:
    """The joints given past and future.

    Args:
        params: with the likeliest process noise of the joints: smoothing needs no guard against lag.
        state: before the first sample.
        samples: leaves (T, ...).
        length: samples at the start that count; after them comes padding, or what the next part begins with.
        options: of the pipeline.
        seen: samples that are not padding; None = as many as count.

    Returns:
        the filtered state after ``length`` samples, and the joints.
    """
    model = JOINT_MODELS[options.joint_model]
    seen = length if seen is None else seen
    inputs = joint_inputs(params, state, samples)
    density, restart = inputs.density, list(inputs.restart_variance[:2])

    def forward(joint: Gaussian, piece: tuple[Sample, Array]) -> tuple[Gaussian, Any]:
        after, states, nats = _forward(params, state._replace(joint=joint), *piece, options)
        return after, (states, nats)

    def backward(after: Packed, piece: tuple[Sample, Array, States]) -> tuple[Packed, Any]:
        samples, gaps, states = piece
        gaps_and_states = (gaps[:, None], None, (states.mean, states.triangle))
        smoothed = States(*smooth_back(model, density, restart, after, gaps_and_states))
        return jax.tree.map(lambda x: x[0], tuple(smoothed)), _kept(params, smoothed, samples, options)

    counted = jnp.arange(len(samples.dt)) < length
    last, (filtered, nats) = over_pieces(forward, state.joint, (samples, counted), seen)
    gaps = jnp.append(samples.dt[1:], 0)  # after the last sample nothing happens
    _, kept = over_pieces(backward, _packed(last), (samples, gaps, filtered), seen, reverse=True)
    after = _unpacked(jax.tree.map(lambda x: x[length - 1], filtered))
    return state._replace(joint=after), _joints(params, samples, kept, nats, options)


def _forward(
    params: Params, state: State, samples: Sample, counted: Array, options: Options
) -> tuple[Gaussian, States, Array]:
    """The filters of the joints over a piece: their state after it, their states, and (1,) nats."""
    weight = counted.astype(samples.dt.dtype)
    found = filter_sums(JOINT_MODELS[options.joint_model], True, joint_inputs(params, state, samples), weight)
    assert found.states is not None
    after = Gaussian(found.mean.T, jnp.moveaxis(found.covariance, -1, 0))
    return after, found.states, found.nats.sum()[None]


def _kept(params: Params, states: States, samples: Sample, options: Options) -> Any:
    """What is kept of a piece: the wrench and what the result holds of the states; all of these where effects, which
    may need the whole log, make the wrench of them."""
    if params.effects is not None:
        return states
    mean: Any = tuple(states.mean)
    return mean, jnp.sqrt(states.triangle[5]), *predict_wrenches(params, states, samples, options)


def _joints(params: Params, samples: Sample, kept: Any, nats: Array, options: Options) -> Joints:
    if params.effects is None:
        mean, ddq_std, wrench_tool, variance = kept
        return Joints(mean, ddq_std, wrench_tool, variance, None, nats.sum())
    mean = tuple(kept.mean)
    known = compose.bias(signals_of(params, jnp.stack(mean, 2), samples), params.effects)
    wrench_tool, variance = predict_wrenches(params, kept, samples, options)
    return Joints(mean, jnp.sqrt(kept.triangle[5]), wrench_tool, variance, known, nats.sum())


def _packed(joint: Gaussian) -> Packed:
    """The state of the joints with its entries apart."""
    covariance = jnp.moveaxis(joint.covariance, 0, -1)
    return list(joint.mean.T), upper([list(row) for row in covariance])


def _unpacked(states: States) -> Gaussian:
    """The inverse of ``_packed`` for a single sample."""
    whole = States(*jax.tree.map(lambda x: x[None], tuple(states))).stacked()
    one: Gaussian = jax.tree.map(lambda x: x[0], joint_states(whole))
    return one
