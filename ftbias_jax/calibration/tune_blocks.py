"""Noise of bias and sensor for logs with errors that are correlated in time, fitted to the means of blocks.

Fast noise dominates the sample-wise likelihood, and a model that is slightly wrong there distorts the slow parameters
to compensate. In block means fast noise has averaged out: what is left is the bias and the errors that vary as slowly,
and these share one small likelihood.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from ftbias_jax.calibration import newton
from ftbias_jax.calibration.judgement import SEGMENTS
from ftbias_jax.calibration.newton import Report, Search
from ftbias_jax.calibration.noise.score import WrenchLogs
from ftbias_jax.calibration.noise.values import TIES
from ftbias_jax.calibration.tune import Fit, fit_wrench, stack
from ftbias_jax.calibration.tune_drift import HALF_A_STEP, Drift, Series, choose_drift, stated_drift
from ftbias_jax.filtering import bias_filter
from ftbias_jax.filtering.method.look import look_at
from ftbias_jax.filtering.noise.block_filter import Grid, Means, filter_series
from ftbias_jax.filtering.noise.blocks import Blocks
from ftbias_jax.filtering.noise.contact import in_contact
from ftbias_jax.filtering.noise.fit_noise import expected, prior_with
from ftbias_jax.filtering.noise.log_noise import LogNoise
from ftbias_jax.filtering.noise.scatter import HEAVY
from ftbias_jax.filtering.noise.slow_noise import coarseness, join_blocks, nats_of
from ftbias_jax.filtering.pipeline import Options
from ftbias_jax.io.log import Log
from ftbias_jax.model.params import Params
from ftbias_jax.types import AXES, Array, Sample

FOREVER = 1e6
"""s: ``drift_time`` of an axis whose drift does not revert, in a setup where the drift of other axes does."""


class LogInBlocks(NamedTuple):
    """Blocks of a log, and the noise found in them."""

    blocks: Blocks
    noise: LogNoise


def look_at_each(params: Params, logs: Sequence[Log], options: Options) -> list[LogInBlocks]:
    """Blocks and noise of every log, with its joints smoothed; arguments as for ``look.look_at``."""
    return [LogInBlocks(*look_at(params, log, options)) for log in logs]


def is_correlated(logs: Sequence[LogInBlocks]) -> bool:
    """Whether any log shows errors that are correlated in time."""
    return any(log.noise.slow is not None and log.noise.slow.std.any() for log in logs)


def tune_in_blocks(
    params: Params, logs: Sequence[LogInBlocks], tie: str, wanted: Sequence[str], report: Report = newton.quiet
) -> tuple[Params, dict[str, Fit]]:
    """Fit the correlated noise, the level of the white noise, and the drift given both.

    The correlated noise and the level are medians over the logs of what each log shows; the level is never less than
    stated, as in a filter (``vibration.taken_level``). The stated drift is kept unless another one is likelier on the
    block means and forecasts no worse (``choose_drift``): one with the maximum-likelihood sigma_Q, found by Newton's
    method, or one that reverts to zero.

    Args:
        params: parameters with the likeliest noise of the joints.
        logs: as returned by ``look_at_each``.
        tie: key of TIES for sigma_Q.
        wanted: some of "density" and "wrench_std".
        report: called with (iteration, nats).

    Returns:
        params with the noise, and the fit of sigma_Q if it was asked for.
    """
    dtype = params.theta.dtype
    std, time = pooled([log.noise for log in logs])
    bias = params.bias._replace(correlated_std=jnp.asarray(std, dtype), correlated_time=jnp.asarray(time, dtype))
    levels = [log.noise.vibration.level for log in logs if log.noise.vibration is not None]
    if "wrench_std" in wanted and levels:
        level = np.maximum(np.median(levels, axis=0), 1)
        bias = bias._replace(wrench_variance=bias.wrench_variance * jnp.asarray(level, dtype))
    sensor = np.asarray(params.bias.wrench_variance, float)
    params = params._replace(bias=bias)
    if "density" not in wanted:
        return params, {}
    series = [as_series(log, sensor, params) for log in logs]
    longest = max(len(each.t) for each in series)
    # The variance of block means is passed as the joints' share; it includes the sensor noise, set to zero here.
    silent = params._replace(bias=bias._replace(wrench_variance=jnp.zeros_like(bias.wrench_variance)))
    parts = [(silent, _as_log(each, params, longest)) for each in series]
    tuned, fit = fit_wrench(silent, parts, {"density": tie}, burn_in=0.0, search=Search(report=report))
    given = stated_drift(bias)
    drift = choose_drift(series, (std, time), given, np.asarray(tuned.bias.density, float), TIES[tie](6))
    reverts = None if np.isinf(drift.time).all() else jnp.asarray(np.minimum(drift.time, FOREVER), dtype)
    bias = bias._replace(density=jnp.asarray(drift.density, dtype), drift_time=reverts)
    return params._replace(bias=bias), {"wrench": _with_drift(fit, drift, given)}


def held_out_blocks(before: Params, tuned: Sequence[Params], logs: Sequence[LogInBlocks], share: float) -> Array:
    """(1 + len(tuned), N) nats of segments of unseen blocks: their means, each given those before, and their scatter.

    A sample-wise score has no model of slow errors and would be meaningless. The means score bias and slow errors, the
    scatter scores the noise of samples, at rest and in motion. The first row is the setup before tuning, whose blocks
    these are; blocks after the given share of each log are unseen.
    """
    return np.array(
        [np.concatenate([_unseen_nats(before, params, log, share) for log in logs]) for params in (before, *tuned)]
    )


def _unseen_nats(before: Params, params: Params, log: LogInBlocks, share: float) -> Array:
    """(N,) nats of equally long segments of the unseen part of a log."""
    bias, (blocks, noise) = params.bias, log
    sensor = np.asarray(bias.wrench_variance - before.bias.wrench_variance, float)
    shaking = bias_filter.vibration(bias, np.sqrt(blocks.motion))
    moving = 0.0 if shaking is None else np.asarray(bias_filter.white_share(bias, shaking), float)
    white = np.asarray(blocks.stated - blocks.shaking) + sensor + moving
    stated = LogInBlocks(blocks._replace(stated=white), noise._replace(vibration=None))
    t, y, variance, prior_std = as_series(stated, sensor, params)
    std = np.zeros(6) if bias.correlated_std is None else np.asarray(bias.correlated_std, float)
    time = np.ones(6) if bias.correlated_time is None else np.asarray(bias.correlated_time, float)
    rate = None if bias.drift_time is None else 1 / np.asarray(bias.drift_time, float)[None]
    grid = Grid(np.ones((1, 6)), std[None], time[None])
    found = filter_series(t, y, variance, grid, prior_std.reshape(2, 6), np.asarray(bias.density, float), rate)
    edges = np.linspace(t[0] + share * (t[-1] - t[0]), t[-1], SEGMENTS + 1)
    edges[-1] = np.inf

    def within(begin: float, end: float) -> float:
        unseen = (t > begin) & (t <= end)
        of_means = nats_of(np.where(unseen[:, None, None], found.innovation, np.nan), found.variance)
        return float(of_means.sum()) + _nats_of_scatter(stated, begin, end)

    return np.array([within(*stretch) for stretch in pairwise(edges)])


def _nats_of_scatter(log: LogInBlocks, begin: float, end: float) -> float:
    """Log-likelihood, but for a constant, of block scatter between two times: Gamma distributed about ``stated``."""
    blocks, noise = log
    touched = in_contact(blocks.t, noise.contacts, float(np.median(np.diff(blocks.t))) if len(blocks.t) > 1 else 1.0)
    dof, stated = np.asarray(blocks.count) - 2.0, np.asarray(blocks.stated)
    inside = np.asarray((blocks.t > begin) & (blocks.t <= end)) & ~touched
    used = inside[:, None] & (dof > 0) & np.isfinite(blocks.scatter) & (stated > 0)
    ratio = np.minimum(np.asarray(blocks.scatter)[used] / stated[used], HEAVY)
    return float(-(dof[used] * (np.log(stated[used]) + ratio)).sum() / 2)


def _with_drift(fit: Fit, drift: Drift, given: Drift) -> Fit:
    """The fit of sigma_Q where it was accepted; on other axes the chosen drift, its uncertainty, and the reason."""
    fitted = fit.values["density"]
    taken = np.isclose(drift.density, fitted, rtol=1e-6) & np.isinf(drift.time)
    stays = (drift.density == given.density) & (drift.time == given.time) & ~taken
    tried = np.where(stays, np.nan, HALF_A_STEP)
    words = [f"sigma_Q of {', '.join(np.array(AXES)[stays])}: no other drift forecasts better"] if stays.any() else []
    return fit._replace(
        values={**fit.values, "density": np.where(taken, fitted, drift.density)},
        relative_stderr={**fit.relative_stderr, "density": np.where(taken, fit.relative_stderr["density"], tried)},
        undetermined=words or fit.undetermined,
    )


def pooled(noises: Sequence[LogNoise]) -> tuple[Array, Array]:
    """(6,) standard deviation and correlation time: medians over the logs; 0 and 1 s where most logs are white."""
    found = [noise.slow for noise in noises if noise.slow is not None]
    std = np.array([slow.std for slow in found] + [np.zeros(6)] * (len(noises) - len(found)))
    time = np.array([slow.time for slow in found])
    there = np.array([slow.std > 0 for slow in found]).reshape(-1, 6)
    typical = [np.median(time[there[:, i], i]) if there[:, i].any() else 1.0 for i in range(6)]
    return np.median(std, axis=0), np.array(typical)


def as_series(log: LogInBlocks, sensor: Array, params: Params) -> Series:
    """Block means of a log without those in contact, minus the bias that the prior expects."""
    blocks, noise = log.blocks, log.noise
    seconds = float(np.median(np.diff(blocks.t))) if len(blocks.t) > 1 else 1.0
    touched = in_contact(blocks.t, noise.contacts, seconds)
    white = blocks.stated if noise.vibration is None else noise.vibration.variance(blocks, sensor)
    y = np.where(touched[:, None], np.nan, blocks.mean - expected(blocks.t, params.bias))
    variance = np.where(np.isfinite(y), white / np.maximum(blocks.count, 1), np.nan)
    _, t, y, variance = join_blocks(Means(seconds, blocks.t, y, variance), blocks.number)
    kept = len(blocks.t) // coarseness(len(blocks.t))  # rows after those are empty
    t, y, variance = (np.asarray(x)[:kept] for x in (t, y, variance))
    return Series(t, y, variance, np.asarray(prior_with(params.bias, noise.offset)))


def _as_log(series: Series, params: Params, length: int) -> WrenchLogs:
    """The blocks of a log, padded, as samples of a log at rest without a tool; leading axis of one log."""
    t, deviations, variance, _ = series
    dtype, still = params.theta.dtype, np.zeros((len(t), params.joint.process_density.shape[0]))
    columns = np.diff(t, prepend=t[0]), still, still, -deviations - expected(t, params.bias)
    sample = stack([Sample(*(np.asarray(x, dtype) for x in columns))], length)
    known = np.where(np.isfinite(variance), variance, 1.0)
    padded = np.pad(known, [(0, length - len(t)), (0, 0)], mode="edge")[None]
    return WrenchLogs(sample, jnp.zeros((1, length, 6), variance.dtype), jnp.asarray(padded))
