"""Filter a recorded log of any length with bounded memory, and sum up what came out."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax import joint_filter, pipeline, smooth, staged
from ftbias_jax.effects import chain
from ftbias_jax.effects.types import Model
from ftbias_jax.pipeline import DEFAULT_OPTIONS, Info, Options, Params, State
from ftbias_jax.setup_types import Setup
from ftbias_jax.staged import Staged
from ftbias_jax.types import Array, Gaussian, Log, Sample

CHUNK = 1 << 14
"""Samples filtered at once: one compiled program for every long log, and memory that does not grow with the log."""

LAG_GUARD = 8.0
"""To filter, the joints' process noise is taken this much above what the setup states or the log makes likeliest. The
likelihood trades noise of the acceleration against its lag at par, but the bias filter averages noise out and keeps the
lag, which moves with the motion. On simulated logs the bias errors are smallest and the error bars hold around 8
(experiments/joint_noise)."""


class Filtered(NamedTuple):
    """Result of filtering a log, at the stamps where any wrench axis was measured. Signs as in the report.

    numpy arrays with leading axis T; the fields are those of the output file, with the same names. Effects that the
    setup knows of are in wrench_tool, those of the bias (warming up, temperature) in bias.
    """

    t: Array
    bias: Array
    drift: Array
    bias_std: Array
    drift_std: Array
    wrench_unbiased: Array
    q: Array
    dq: Array
    ddq: Array
    ddq_std: Array
    wrench_tool: Array
    innovation: Array
    nis: Array
    log_likelihood: Array
    innovation_std: Array


class Summary(NamedTuple):
    """How well the tool model and the bias explain a log; (6,) N, Nm unless stated."""

    raw_std: Array
    """Standard deviation of the wrench as read."""
    residual_std: Array
    """Standard deviation of corrected wrench minus tool model; a fast bias process makes it small by itself."""
    one_second_rms: Array
    """Error of predicting the reading from the state one second earlier, which a bias process cannot make small."""
    mean_nis: float
    """Mean normalised innovation squared per measured axis; 1 for a right model."""


def params_for_log(setup: Setup, samples: Sample, options: Options = DEFAULT_OPTIONS) -> Params:
    """Parameters to filter a log with: those of ``likeliest_params``, with the joints' process noise guarded."""
    return guard_against_lag(likeliest_params(setup, samples, options))


def guard_against_lag(params: Params) -> Params:
    """The joints' process noise LAG_GUARD times as large: for filtering, not for smoothing, which has no lag."""
    return params._replace(joint=params.joint._replace(process_density=LAG_GUARD * params.joint.process_density))


def likeliest_params(setup: Setup, samples: Sample, options: Options = DEFAULT_OPTIONS) -> Params:
    """Parameters from a setup; a joint process noise the setup leaves open is the likeliest of the log."""
    params = pipeline.params_from_setup(setup, samples.q.dtype)
    if setup.joints.process_noise_density is not None:
        return params
    part = jax.tree.map(lambda x: x[:CHUNK], samples)
    part = pipeline.pad(part, _bucket(part.dt.shape[0]))
    likeliest = joint_filter.likeliest_density(params.joint, part.dt, part.q, part.dq, options.joint_model)
    return params._replace(joint=params.joint._replace(process_density=likeliest))


def filter_log(
    params: Params,
    log: Log,
    options: Options = DEFAULT_OPTIONS,
    progress: Callable[[int], None] = lambda done: None,
) -> Filtered:
    """Filter a log in chunks that carry the state; equal to one ``pipeline.run`` over the whole log.

    Args:
        params, options: of the pipeline. log: one merged timeline, (T, ...). progress: told the samples done so far.
    """
    log = without_useless(log, params)
    samples = pipeline.samples_from_log(log, params.theta.dtype)
    length = samples.dt.shape[0]
    # Effects with a memory need the whole log at once.
    chunk = _bucket(length) if params.effects is None else _whole(length)
    rows = np.isfinite(log.wrench).any(1)
    state, log_likelihood = pipeline.init(params, samples), 0.0
    parts = []
    for start in range(0, length, chunk):
        part = jax.tree.map(lambda x, start=start: x[start : start + chunk], samples)
        count = part.dt.shape[0]
        state, kept = _run(params, state, pipeline.pad(part, chunk), options)
        log_likelihood += float(kept.pop("log_likelihood").sum())
        parts.append({name: np.asarray(x)[:count][rows[start : start + count]] for name, x in kept.items()})
        progress(start + count)
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    if params.effects is not None:
        known = _known_bias(params, samples)[rows]
        columns["bias"] = columns["bias"] + np.stack([known, np.zeros_like(known)], 1)
        columns["wrench_tool"] = columns["wrench_tool"] + known
    bias, drift = np.moveaxis(columns["bias"], 1, 0)
    bias_std, drift_std = np.moveaxis(columns["bias_std"], 1, 0)
    q, dq, ddq = np.moveaxis(columns["joint"], 2, 0)
    return Filtered(
        t=log.t[rows] + log.start,
        bias=bias,
        drift=drift,
        bias_std=bias_std,
        drift_std=drift_std,
        wrench_unbiased=log.wrench[rows] + bias,
        q=q,
        dq=dq,
        ddq=ddq,
        ddq_std=columns["ddq_std"],
        wrench_tool=columns["wrench_tool"],
        innovation=columns["innovation"],
        nis=columns["nis"],
        log_likelihood=np.float64(log_likelihood),
        innovation_std=columns["innovation_std"],
    )


def smooth_log(
    params: Params, log: Log, options: Options = DEFAULT_OPTIONS, progress: Callable[[int], None] = lambda done: None
) -> tuple[np.ndarray, np.ndarray]:
    """Bias and drift given the whole log, past and future.

    Args:
        as for ``filter_log``, but best with ``likeliest_params``; the whole log is held in memory, about 2 kB a sample.

    Returns:
        means and standard deviations (T, 2, 6) of (bias, drift), at the stamps of ``filter_log``.
    """
    log = without_useless(log, params)
    samples = pipeline.samples_from_log(log, params.theta.dtype)
    length = samples.dt.shape[0]
    padded = pipeline.pad(samples, _whole(length))
    state = pipeline.init(params, padded)
    if staged.applies(options):
        _, mean, std = smooth.smooth_log(params, state, padded, options)
    else:
        _, states = pipeline.run(params, state, padded, options, _keep_bias)
        smoothed = smooth.smooth_bias(params, states, padded.dt)
        mean = smoothed.mean.reshape(-1, 2, 6)
        std = jnp.sqrt(jnp.diagonal(smoothed.covariance, axis1=1, axis2=2)).reshape(-1, 2, 6)
    progress(length)
    rows = np.isfinite(log.wrench).any(1)
    return np.asarray(mean)[:length][rows], np.asarray(std)[:length][rows]


def summarise(filtered: Filtered) -> Summary:
    """Residuals of a filtered log; one-second-ahead errors use the newest state at least one second old."""
    raw = filtered.wrench_unbiased - filtered.bias
    residual = filtered.wrench_unbiased - filtered.wrench_tool
    past = np.searchsorted(filtered.t, filtered.t - 1.0, side="right") - 1
    ahead = past >= 0
    past = past[ahead]
    elapsed = (filtered.t[ahead] - filtered.t[past])[:, None]
    predicted = filtered.wrench_tool[ahead] - filtered.bias[past] - elapsed * filtered.drift[past]
    axes = np.isfinite(raw).sum()
    return Summary(
        _over_time(np.nanstd, raw),
        _over_time(np.nanstd, residual),
        np.sqrt(_over_time(np.nanmean, (raw[ahead] - predicted) ** 2)),
        float(filtered.nis.sum() / axes),
    )


@partial(jax.jit, static_argnames="options")
def _run(params: Params, state: State, samples: Sample, options: Options) -> tuple[State, dict[str, Array]]:
    """Filter by the fastest route that is exact for these parameters."""
    if staged.applies(options):
        state, track = staged.run(params, state, samples, options)
        return state, _keep_staged(track, samples.wrench)
    state, kept = pipeline.run(params, state, samples, options, _keep)
    return state, kept


def without_useless(log: Log, params: Params) -> Log:
    """The log without samples that the known effects make useless: saturated ones, spikes, repetitions."""
    if params.effects is None:
        return log
    model = Model(params.arm, params.gravity, params.theta)
    return log._replace(wrench=np.asarray(chain.correct_record(jnp.asarray(log.wrench), model, params.effects)))


def _known_bias(params: Params, samples: Sample) -> np.ndarray:
    """(T, 6) the part of the bias that known effects make, such as warming up."""
    assert params.effects is not None
    joints = jnp.zeros((*samples.q.shape, 3), samples.q.dtype)  # effects of the bias do not look at the motion
    return np.asarray(chain.bias(staged.signals_of(params, joints, samples), params.effects))


def _whole(length: int) -> int:
    """Length to pad a log to that is filtered at once."""
    return _bucket(length) * -(-length // _bucket(length))


def _bucket(length: int) -> int:
    """Length to pad to: a power of two up to CHUNK, so that logs of similar length share one compiled program."""
    return min(CHUNK, 1 << (length - 1).bit_length())


def _over_time(reduce: Callable[..., Array], x: Array) -> Array:
    """(T, 6) -> (6,), NaN for an axis that was never measured, without numpy's warning about it."""
    measured = np.isfinite(x).any(0)
    result = np.full(x.shape[1], np.nan)
    result[measured] = reduce(x[:, measured], axis=0)
    return result


def _keep_bias(state: State, info: Info) -> Gaussian:
    return state.bias


def _keep(state: State, info: Info) -> dict[str, Array]:
    """What the output needs of one step."""
    std = partial(jnp.diagonal, axis1=-2, axis2=-1)
    return {
        "joint": state.joint.mean,
        "ddq_std": jnp.sqrt(std(state.joint.covariance)[:, 2]),
        "bias": state.bias.mean.reshape(2, 6),
        "bias_std": jnp.sqrt(std(state.bias.covariance)).reshape(2, 6),
        "wrench_tool": info.wrench_tool,
        "innovation": info.wrench.value,
        "innovation_std": jnp.sqrt(std(info.wrench.covariance)),
        "nis": info.wrench.nis,
        "log_likelihood": info.log_likelihood,
    }


def _keep_staged(track: Staged, wrench: Array) -> dict[str, Array]:
    """The same of a staged run, which reports an innovation of 0 where nothing was measured."""
    variances = [jnp.diagonal(track.covariance, axis1=1, axis2=2) for track in (track.joint, track.wrench)]
    return {
        "joint": jnp.swapaxes(track.joint.mean, 1, 2),
        "ddq_std": jnp.sqrt(variances[0][:, :, 2]),
        "bias": track.wrench.mean,
        "bias_std": jnp.sqrt(jnp.swapaxes(variances[1], 1, 2)),
        "wrench_tool": track.wrench_tool,
        "innovation": jnp.where(jnp.isfinite(wrench), track.wrench.innovation[:, 0], jnp.nan),
        "innovation_std": jnp.sqrt(track.wrench.innovation_variance[:, 0]),
        "nis": track.wrench.nis.sum(1),
        "log_likelihood": track.joint.log_likelihood.sum(1) + track.wrench.log_likelihood.sum(1),
    }
