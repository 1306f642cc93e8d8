"""The passes over the joints of a log: their process noise, their states, and the wrench that the tool must cause."""

from typing import Any

import jax
import jax.numpy as jnp

from ftbias_jax.filtering.fast.kalman_step import Packed
from ftbias_jax.filtering.fast.scan import States, filter_sums
from ftbias_jax.filtering.fast.stages import joint_inputs, joint_states, predict_wrenches, signals_of
from ftbias_jax.filtering.method.work import Joints, Work
from ftbias_jax.filtering.params_for_log import MOST_SAMPLES, guard_against_lag, max_likelihood_density
from ftbias_jax.filtering.process_models import JOINT_MODELS
from ftbias_jax.filtering.smoother import smooth_back
from ftbias_jax.model.effects import compose
from ftbias_jax.runtime.compiled_loops import over_pieces
from ftbias_jax.runtime.lanes import upper
from ftbias_jax.types import Array, Gaussian, Sample


def fit_joint_noise(work: Work) -> Work:
    """Fit the joints' process noise by maximum likelihood to the first samples of the log."""
    params, (dt, q, dq, *_) = work.params, jax.tree.map(lambda x: x[:MOST_SAMPLES], work.samples)
    measured = jax.lax.stop_gradient((params.joint, dt, q, dq))
    density = max_likelihood_density(*measured, model=work.options.joint_model)
    return work._replace(params=params._replace(joint=params.joint._replace(process_density=density)))


def guard_joints(work: Work) -> Work:
    """Guard the joints' process noise against the lag of a filter."""
    return work._replace(params=guard_against_lag(work.params))


def filter_joints(work: Work) -> Work:
    """Filter the joints from the past alone, as on the robot, and compute the wrench that the tool must cause."""

    def forward(joint: Gaussian, piece: tuple[Sample, Array]) -> tuple[Gaussian, Any]:
        after, states, nats = _forward(work, joint, *piece)
        return after, (_kept(work, states, piece[0]), nats)

    last, (kept, nats) = over_pieces(forward, work.start.joint, (work.samples, _counted(work)), work.length)
    return work._replace(joints=_joints(work, kept, nats), end=work.start._replace(joint=last))


def smooth_joints(work: Work) -> Work:
    """Smooth the joints from past and future; smoothing has no lag, so the process noise is not guarded."""
    model, samples = JOINT_MODELS[work.options.joint_model], work.samples
    seen = work.length if work.seen is None else work.seen
    inputs = joint_inputs(work.params.joint, work.start.joint, samples)
    density, restart = inputs.density, list(inputs.restart_variance[:2])

    def forward(joint: Gaussian, piece: tuple[Sample, Array]) -> tuple[Gaussian, Any]:
        after, states, nats = _forward(work, joint, *piece)
        return after, (states, nats)

    def backward(after: Packed, piece: tuple[Sample, Array, States]) -> tuple[Packed, Any]:
        samples, gaps, states = piece
        gaps_and_states = (gaps[:, None], None, (states.mean, states.triangle))
        smoothed = States(*smooth_back(model, density, restart, after, gaps_and_states))
        return jax.tree.map(lambda x: x[0], tuple(smoothed)), _kept(work, smoothed, samples)

    last, (filtered, nats) = over_pieces(forward, work.start.joint, (samples, _counted(work)), seen)
    gaps = jnp.append(samples.dt[1:], 0)  # no time passes after the last sample
    rows = upper([list(row) for row in jnp.moveaxis(last.covariance, 0, -1)])
    _, kept = over_pieces(backward, (list(last.mean.T), rows), (samples, gaps, filtered), seen, reverse=True)
    at_end = States(*jax.tree.map(lambda x: x[work.length - 1][None], tuple(filtered))).stacked()
    after: Gaussian = jax.tree.map(lambda x: x[0], joint_states(at_end))
    return work._replace(joints=_joints(work, kept, nats), end=work.start._replace(joint=after))


def _counted(work: Work) -> Array:
    """Whether (T,) each sample counts."""
    return jnp.arange(len(work.samples.dt)) < work.length


def _forward(work: Work, joint: Gaussian, samples: Sample, counted: Array) -> tuple[Gaussian, States, Array]:
    """Filter the joints over a piece: their state after it, their states, and (1,) nats."""
    inputs = joint_inputs(work.params.joint, joint, samples)
    found = filter_sums(JOINT_MODELS[work.options.joint_model], True, inputs, counted.astype(samples.dt.dtype))
    assert found.states is not None
    return Gaussian(found.mean.T, jnp.moveaxis(found.covariance, -1, 0)), found.states, found.nats.sum()[None]


def _kept(work: Work, states: States, samples: Sample) -> Any:
    """Wrench and result of a piece; all joint states if effects, which may need the whole log, make the wrench."""
    if work.params.effects is not None:
        return states
    mean: Any = tuple(states.mean)
    return mean, jnp.sqrt(states.triangle[5]), *predict_wrenches(work.params, states, samples, work.options)


def _joints(work: Work, kept: Any, nats: Array) -> Joints:
    if work.params.effects is None:
        mean, ddq_std, wrench_tool, variance = kept
        return Joints(mean, ddq_std, wrench_tool, variance, jnp.zeros_like(wrench_tool), nats.sum())
    mean = tuple(kept.mean)
    known = compose.bias(signals_of(work.params, jnp.stack(mean, 2), work.samples), work.params.effects)
    wrench_tool, variance = predict_wrenches(work.params, kept, work.samples, work.options)
    return Joints(mean, jnp.sqrt(kept.triangle[5]), wrench_tool, variance, known, nats.sum())
