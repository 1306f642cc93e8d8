"""Filter a recorded log of any length with bounded memory, and sum up what came out."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax import joint_filter, pipeline
from ftbias_jax.pipeline import DEFAULT_OPTIONS, Info, Options, Params, State
from ftbias_jax.setup import Setup
from ftbias_jax.types import Array, Log, Sample

CHUNK = 1 << 14
"""Samples filtered at once: one compiled program for every long log, and memory that does not grow with the log."""


class Filtered(NamedTuple):
    """Result of filtering a log, at the stamps where any wrench axis was measured. Signs as in the report.

    numpy arrays with leading axis T; the fields are those of the output file, with the same names.
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
    """Parameters from a setup; a joint process noise the setup leaves open (NaN) is the likeliest one for this log."""
    params = pipeline.params_from_setup(setup, samples.q.dtype)
    stated = np.isfinite(setup.joints.process_noise_density)
    if stated.all():
        return params
    part = jax.tree.map(lambda x: x[:CHUNK], samples)
    part = pipeline.pad(part, _bucket(part.dt.shape[0]))
    likeliest = joint_filter.likeliest_density(params.joint, part.dt, part.q, part.dq, options.joint_model)
    density = jnp.where(stated, params.joint.process_density, likeliest)
    return params._replace(joint=params.joint._replace(process_density=density))


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
    dtype = params.theta.dtype
    samples = pipeline.samples_from_log(log, dtype)
    length = samples.dt.shape[0]
    chunk = _bucket(length)
    state, parts = pipeline.init(params, samples), []
    for start in range(0, length, chunk):
        part = jax.tree.map(lambda x, start=start: x[start : start + chunk], samples)
        count = part.dt.shape[0]
        state, kept = pipeline.run(params, state, pipeline.pad(part, chunk), options, _emit)
        rows = np.isfinite(log.wrench[start : start + chunk]).any(1)
        parts.append({name: np.asarray(x)[:count][rows] for name, x in kept.items() if x.ndim > 1 or name == "nis"})
        parts[-1]["log_likelihood"] = np.asarray(kept["log_likelihood"][:count].sum())
        progress(start + count)
    rows = np.isfinite(log.wrench).any(1)
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0] if name != "log_likelihood"}
    return Filtered(
        t=log.t[rows] + log.start,
        wrench_unbiased=log.wrench[rows] + columns["bias"],
        log_likelihood=np.sum([part["log_likelihood"] for part in parts]),
        **columns,
    )


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


def _bucket(length: int) -> int:
    """Length to pad to: a power of two up to CHUNK, so that logs of similar length share one compiled program."""
    return min(CHUNK, 1 << (length - 1).bit_length())


def _over_time(reduce: Callable[..., Array], x: Array) -> Array:
    """(T, 6) -> (6,), NaN for an axis that was never measured, without numpy's warning about it."""
    measured = np.isfinite(x).any(0)
    result = np.full(x.shape[1], np.nan)
    result[measured] = reduce(x[:, measured], axis=0)
    return result


def _emit(state: State, info: Info) -> dict[str, Array]:
    std = partial(jnp.diagonal, axis1=-2, axis2=-1)
    bias_std = jnp.sqrt(std(state.bias.covariance))
    return {
        "bias": state.bias.mean[:6],
        "drift": state.bias.mean[6:],
        "bias_std": bias_std[:6],
        "drift_std": bias_std[6:],
        "q": state.joint.mean[:, 0],
        "dq": state.joint.mean[:, 1],
        "ddq": state.joint.mean[:, 2],
        "ddq_std": jnp.sqrt(std(state.joint.covariance)[:, 2]),
        "wrench_tool": info.wrench_tool,
        "innovation": info.wrench.value,
        "nis": info.wrench.nis,
        "log_likelihood": info.log_likelihood,
    }
