"""Filter a recorded log of any length with bounded memory."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.filtering import pipeline, smoother
from ftbias_jax.filtering.fast import stages
from ftbias_jax.filtering.joint_noise import likeliest_density
from ftbias_jax.filtering.pipeline import DEFAULT_OPTIONS, Info, Options, State, predict_wrench
from ftbias_jax.filtering.result import Filtered, join, keep
from ftbias_jax.filtering.samples import arrays_from_log, first_position, pad, without_unsettled
from ftbias_jax.io.log import Log
from ftbias_jax.model.effects import compose
from ftbias_jax.model.effects.types import Model
from ftbias_jax.model.params import Params, params_from_setup
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array, Sample

if TYPE_CHECKING:
    from jaxtyping import Float

CHUNK = 1 << 14
"""Samples filtered at once: one compiled program for every long log, and memory that does not grow with the log."""

LAG_GUARD = 8.0
"""To filter, the joints' process noise is taken this much above what the setup states or the log makes likeliest. The
likelihood trades noise of the acceleration against its lag at par, but the bias filter averages noise out and keeps the
lag, which moves with the motion. On simulated logs the bias errors are smallest and the error bars hold around 8
(experiments/joint_noise)."""


def params_for_log(setup: Setup, samples: Sample, options: Options = DEFAULT_OPTIONS) -> Params:
    """Parameters to filter a log with: those of ``likeliest_params``, with the joints' process noise guarded."""
    return guard_against_lag(likeliest_params(setup, samples, options))


def guard_against_lag(params: Params) -> Params:
    """The joints' process noise LAG_GUARD times as large: for filtering, not for smoothing, which has no lag."""
    return params._replace(joint=params.joint._replace(process_density=LAG_GUARD * params.joint.process_density))


def likeliest_params(setup: Setup, samples: Sample, options: Options = DEFAULT_OPTIONS) -> Params:
    """Parameters from a setup; a joint process noise the setup leaves open is the likeliest of the log."""
    params = params_from_setup(setup, samples.q.dtype)
    if setup.sensor.rezeroed:
        params = zeroed_at_first(params, samples)
    if setup.joints.process_noise_density is not None:
        return params
    part = jax.tree.map(lambda x: x[:CHUNK], samples)
    part = pad(part, _bucket(part.dt.shape[0]))
    likeliest = likeliest_density(params.joint, part.dt, part.q, part.dq, model=options.joint_model)
    return params._replace(joint=params.joint._replace(process_density=likeliest))


def zeroed_at_first(params: Params, samples: Sample) -> Params:
    """The bias expected of a sensor that was set to zero in the first pose, at rest: what the tool makes it read there.

    Args:
        params: with the bias that the setup expects beside that.
        samples: of the log, from its beginning.
    """
    q = jnp.asarray(first_position(samples.q))
    still = jnp.zeros_like(q)
    _, weight = predict_wrench(params, jnp.stack([q, still, still], 1))
    mean = params.bias.prior_mean.at[:6].add(weight)
    return params._replace(bias=params.bias._replace(prior_mean=mean))


def filter_with_params(
    params: Params,
    log: Log,
    options: Options = DEFAULT_OPTIONS,
    progress: Callable[[int], None] = lambda done: None,
) -> Filtered:
    """Filter a log in chunks that carry the state; equal to one ``pipeline.run`` over the whole log.

    Args:
        params: what is believed of robot, tool and noise.
        log: one merged timeline, (T, ...).
        options: as for ``pipeline.run``.
        progress: called with the number of samples done so far.
    """
    # Effects with a memory need the whole log at once.
    size = CHUNK if params.effects is None else len(log.t)
    parts = (log._replace(**rows_of(log, i, size)) for i in range(0, len(log.t), size))
    first_q = first_position(log.q)
    results = []
    for i, result in enumerate(filter_parts(params, first_q, parts, options), 1):
        results.append(result)
        progress(min(i * size, len(log.t)))
    return join(results)


def filter_parts(
    params: Params, first_q: Float[Array, " n"], parts: Iterable[Log], options: Options = DEFAULT_OPTIONS
) -> Iterator[Filtered]:
    """Filter a log that comes in parts; ``result.join`` makes them one result.

    Args:
        params: what is believed of robot, tool and noise; known effects need the whole log as one part.
        first_q: (n,) rad, the first measured position of every joint.
        parts: in the order of time, CHUNK samples each but the last.
        options: as for ``pipeline.run``.

    Yields:
        the result of every part; its log_likelihood is that of the part.
    """
    dtype = params.theta.dtype
    state, before, length = start_at(params, first_q), None, 0
    for log in parts:
        log = without_useless(log, params)
        samples = without_unsettled(arrays_from_log(log, dtype, before), log.t, params)
        if params.effects is None:
            samples = samples._replace(temperature=None, columns=None)
        length = max(length, padded_length(len(log.t)))  # a short last part runs the program of the others
        state, kept = _run(params, state, pad(samples, length), options)
        yield _filtered(log, {name: np.asarray(x)[: len(log.t)] for name, x in kept.items()})
        before = log.t[-1]


def start_at(params: Params, first_q: Array) -> State:
    """The state before the first sample: ``pipeline.init`` as one program for logs of any length.

    Args:
        params: of the pipeline.
        first_q: (n,) rad, the first measured position of every joint.
    """
    nothing: Any = None
    q = np.asarray(first_q, params.theta.dtype)[None]
    start: State = pipeline.init(params, Sample(nothing, q, nothing, nothing))
    return start


def rows_of(log: Log, first: int, count: int) -> dict[str, Array]:
    """The arrays (T, ...) of a log, in s, rad, N, Nm, from sample ``first`` on, ``count`` samples or fewer."""
    return {name: getattr(log, name)[first : first + count] for name in ("t", "q", "dq", "wrench", "temperature")}


def _filtered(log: Log, kept: dict[str, Array]) -> Filtered:
    """The result of one part, at the stamps of its wrench."""
    rows = np.isfinite(log.wrench).any(1)
    log_likelihood = np.float64(kept.pop("log_likelihood").sum(dtype=np.float64))
    columns = {name: x[rows] for name, x in kept.items()}
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
        log_likelihood=log_likelihood,
        innovation_std=columns["innovation_std"],
    )


def smooth_with_params(
    params: Params, log: Log, options: Options = DEFAULT_OPTIONS, at: Array | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Bias and drift given the whole log, past and future.

    Args:
        params: of the pipeline; best those of ``likeliest_params``, because smoothed joints have no lag.
        log: one merged timeline, (T, ...); all of it is held in memory, about 2 kB a sample.
        options: of the pipeline.
        at: (T,) which samples to report; None = those whose wrench was measured.

    Returns:
        means and standard deviations (T, 2, 6) of (bias, drift), at the stamps of ``filter_with_params``.
    """
    log = without_useless(log, params)
    samples = without_unsettled(arrays_from_log(log, params.theta.dtype), log.t, params)
    length = samples.dt.shape[0]
    padded = pad(samples, padded_length(length))
    state = pipeline.init(params, padded)
    if options.gate is not None:  # smoothed is what passed the gate
        _, used = pipeline.run(params, state, padded, options, _used)
        padded = padded._replace(wrench=jnp.where(used, padded.wrench, jnp.nan))
        options = options._replace(gate=None)
    _, mean, std = smoother.smooth_log(params, state, padded, options)
    rows = np.isfinite(log.wrench).any(1) if at is None else at
    return np.asarray(mean)[:length][rows], np.asarray(std)[:length][rows]


@partial(jax.jit, static_argnames="options")
def _run(params: Params, state: State, samples: Sample, options: Options) -> tuple[State, dict[str, Array]]:
    """Filter, and count to the bias what known effects add to it, such as warming up."""
    state, kept = pipeline.run(params, state, samples, options, keep)
    if params.effects is not None:
        known = compose.bias(stages.signals_of(params, kept["joint"], samples), params.effects)
        kept["bias"] = kept["bias"].at[:, 0].add(known)
        kept["wrench_tool"] += known
    return state, kept


def without_useless(log: Log, params: Params) -> Log:
    """The log without samples that the known effects make useless: saturated ones, spikes, repetitions."""
    if params.effects is None:
        return log
    model = Model(params.arm, params.gravity, params.theta)
    return log._replace(wrench=np.asarray(compose.correct_record(jnp.asarray(log.wrench), model, params.effects)))


def padded_length(length: int) -> int:
    """Length to pad a log to that is filtered at once."""
    return _bucket(length) * -(-length // _bucket(length))


def _bucket(length: int) -> int:
    """Length to pad to: a power of two up to CHUNK, so that logs of similar length share one compiled program."""
    return min(CHUNK, 1 << (length - 1).bit_length())


def _used(state: State, info: Info) -> Array:
    return jnp.isfinite(info.wrench.value)
