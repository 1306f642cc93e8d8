"""Starting values for a fit of the noise: the level that the logs themselves show, whatever the setup states.

A stated noise that is wrong by orders of magnitude decides what a log seems to show: with a drift 500 times too small
every change of the bias counts as a slow error, with one 500 times too large every slow error counts as drift, and each
view is a local maximum of the likelihood that no gradient leaves. So the sensor noise is first taken from the scatter
within blocks, and the drift from the best of several levels, each with the slow errors that the logs show beside it.
"""

from collections.abc import Collection, Sequence

import jax.numpy as jnp
import numpy as np

from ftbias_jax.calibration.judgement import WORSE
from ftbias_jax.calibration.tune import Fit
from ftbias_jax.calibration.tune_blocks import LogInBlocks, as_series, look_at_each, pooled
from ftbias_jax.calibration.tune_drift import LEAST_GAIN, Drift, score, stated_drift
from ftbias_jax.filtering.method.look import InBlocks, log_in_blocks, noise_of_blocks
from ftbias_jax.filtering.noise.joint_scatter import FLAT, HIGH, LOW, REGULAR, by_differences
from ftbias_jax.filtering.pipeline import Options
from ftbias_jax.io.log import Log
from ftbias_jax.model.params import Params
from ftbias_jax.types import AXES, Array

LEVELS = (1.0, 0.1, 10.0, 0.01, 100.0, 1e-3, 1e3)
"""Factors of the stated sigma_Q to try, the stated one first."""
FAR = 4.0
"""A stated standard deviation within this factor of what the logs show is accepted as the start of the fit."""
PRICE = LEAST_GAIN / 2
"""nats that each of the two parameters of slow errors must gain; a level other than the stated one: LEAST_GAIN."""
MOST_LOGS = 8
"""Number of logs that are used, evenly spaced; they determine a level far more closely than FAR."""
WINDOW = 128
"""Number of samples from whose differences the scatter of a reading is estimated, within about a tenth."""
QUIET = 1.3
"""Ratio to the quietest third of the windows up to which a window is as quiet."""
NOT_LESS = 1.1
"""Ratio of that scatter to a fitted noise above which the fit is wrong."""
ROUNDS = 4
"""Number of corrections of the sensor noise, because the change that one of them finds is bounded."""


def start_from_observed_level(params: Params, logs: Sequence[Log], wanted: Collection[str], options: Options) -> Params:
    """Parameters whose sensor noise and drift are at the level that the logs show; unchanged where they already are.

    Args:
        params: parameters with the likeliest noise of the joints.
        logs: the part of each log that is fitted.
        wanted: some of "density" and "wrench_std"; noise that is not fitted stays as stated.
        options: options of the pipeline.
    """
    logs = logs[:: -(-len(logs) // MOST_LOGS)]
    looked = look_at_each(params, logs, options)
    if all(log.noise.vibration is None for log in looked):
        return params  # too short to show its noise
    for level_of in (_of_all_blocks, *[_at_rest] * ROUNDS) if "wrench_std" in wanted else ():
        stated = np.asarray(params.bias.wrench_variance, float)
        level = level_of(looked, stated)
        far = (level > FAR**2) | (level < FAR**-2)
        if far.any():
            variance = jnp.asarray(np.where(far, level, 1.0) * stated, params.theta.dtype)
            params = params._replace(bias=params.bias._replace(wrench_variance=variance))
            looked = look_at_each(params, logs, options)
    return _at_best_drift(params, logs, options) if "density" in wanted else params


def no_less_than_scatter(params: Params, fit: Fit, logs: Sequence[Log]) -> tuple[Params, Fit]:
    """Fitted noise of the sensor, at least as large as the scatter of neighbouring readings in the quietest windows.

    The errors of the smoothed joints count as independent from sample to sample. Where they are large, as at a low
    rate, the fit attributes to them what is noise of the sensor, down to none at all.

    Args:
        params: parameters with the fitted noise.
        fit: of the wrench; unchanged if it has no "wrench_std".
        logs: the part of each log that was fitted.
    """
    if "wrench_std" not in fit.values:
        return params, fit
    if not (shown := [window for log in logs[:MOST_LOGS] for window in _quietest(log)]):
        return params, fit
    floor, fitted = np.median(shown, axis=0), np.asarray(fit.values["wrench_std"], float)
    raised = floor > NOT_LESS * fitted
    if not raised.any():
        return params, fit
    std = np.where(raised, floor, fitted)
    stderr = np.where(raised, (2 * WINDOW * len(shown)) ** -0.5, fit.relative_stderr["wrench_std"])
    names = ", ".join(axis for axis, is_raised in zip(AXES, raised, strict=True) if is_raised)
    variance = jnp.asarray(std**2, params.theta.dtype)
    return params._replace(bias=params.bias._replace(wrench_variance=variance)), fit._replace(
        values={**fit.values, "wrench_std": std},
        relative_stderr={**fit.relative_stderr, "wrench_std": stderr},
        determined=(*fit.determined, f"sensor.noise_std of {names}, by the scatter of neighbouring readings"),
    )


def _quietest(log: Log) -> list[Array]:
    """(6,) N, Nm: scatter of neighbouring readings in each of the quieter windows of a log, if all axes vary."""
    rows = np.isfinite(log.wrench).all(1)
    t, wrench = log.t[rows], log.wrench[rows]
    found = []
    for start in range(0, len(t) - WINDOW, WINDOW):
        own = slice(start, start + WINDOW)
        steps = np.diff(t[own])
        regular = np.abs(steps - np.median(steps)) < REGULAR * np.median(steps)
        low, high = (by_differences(t[own], wrench[own], regular, order) for order in (LOW, HIGH))
        if (high > 0).all() and (low < FLAT * high).all():  # otherwise motion
            found.append(high)
    if not found:
        return []
    sizes = (np.array(found) / np.median(found, axis=0)).mean(1)
    # A third is at rest in most logs, and noise in motion, if there is any, is louder.
    quiet = sizes < QUIET * np.median(np.sort(sizes)[: -(-len(sizes) // 3)])
    return [window for window, is_quiet in zip(found, quiet, strict=True) if is_quiet]


def _of_all_blocks(looked: Sequence[LogInBlocks], stated: Array) -> Array:
    """(6,) median scatter within blocks per stated variance; where that is far off, most blocks count as contact."""
    ratios = np.concatenate([log.blocks.scatter for log in looked]) / stated
    measured = np.where(np.isfinite(ratios) & (ratios > 0), ratios, np.nan)
    seen = np.isfinite(measured).any(0)
    return np.where(seen, np.nanmedian(np.where(seen, measured, 1.0), axis=0), 1.0)


def _at_rest(looked: Sequence[LogInBlocks], stated: Array) -> Array:
    """(6,) variance of the sensor per stated variance, median over the logs; 1 if none is long enough to show it."""
    levels = [log.noise.vibration.level for log in looked if log.noise.vibration is not None]
    return np.median(levels, axis=0) if levels else np.ones_like(stated)


def _at_best_drift(params: Params, logs: Sequence[Log], options: Options) -> Params:
    """Parameters with the best of LEVELS of sigma_Q on every axis that forecasts no worse than the stated one."""
    stated = np.asarray(params.bias.density, float)
    blocks = [log_in_blocks(params, log, options) for log in logs]
    scored = [_scored(_with_density(params, level * stated), blocks) for level in LEVELS]
    value, squares = (np.stack(x) for x in zip(*scored, strict=True))
    value[1:] -= LEAST_GAIN
    # A drift that follows slow model errors is likely, but carries the bias away from its later value.
    worse = (np.nan_to_num(squares / squares[:1], nan=1.0) > WORSE**2).any(axis=1)
    best = np.where(worse, -np.inf, value).argmax(0)
    return _with_density(params, np.array(LEVELS)[best] * stated)


def _with_density(params: Params, density: Array) -> Params:
    return params._replace(bias=params.bias._replace(density=jnp.asarray(density, params.theta.dtype)))


def _scored(params: Params, logs: Sequence[InBlocks]) -> tuple[Array, Array]:
    """Score block means with the slow errors that the logs show beside this drift.

    Returns:
        (6,) nats, less the penalty for the slow errors, and (H, 6) N^2, Nm^2 mean squared errors of forecasts.
    """
    looked = [LogInBlocks(*noise_of_blocks(params.bias, log)) for log in logs]
    std, time = params.bias.correlated_std, params.bias.correlated_time
    if std is None or time is None:
        std, time = pooled([log.noise for log in looked])
    sensor = np.asarray(params.bias.wrench_variance, float)
    drift = Drift(*(x[None] for x in stated_drift(params.bias)))
    found = score([as_series(log, sensor, params) for log in looked], (std, time), drift)
    return found.nats[0] - np.where(std > 0, 2 * PRICE, 0.0), found.squares[:, 0]
