"""Forecast of the readings after each sample of a filtered log: bias and drift continue, slow errors decay."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftbias_jax.types import Array

if TYPE_CHECKING:
    from ftbias_jax.filtering.verbs.results import FilterResult

Times = tuple[Array | None, Array | None]
SOONER = 1.5
"""Factor by which a log of a few correlation times may overestimate the correlation time, allowed for in the standard
deviation. With 1, 92 % of readings of recorded logs are in their 95 % intervals 10 s ahead, with 1.5 94 %."""
CORRELATION = 0.5**0.5
"""Correlation of the errors of bias and drift in the steady state of a filter with a random drift, whatever its noise;
a result holds only their standard deviations."""
SERIES = 1e-2
"""Share of the decay time below which the closed form would lose all digits, and a series replaces it."""


class Forecast(NamedTuple):
    """Expected wrench_tool - reading some seconds after each sample, in free motion."""

    mean: Array
    """(T, 6) N, Nm."""
    std: Array
    """(T, 6) N, Nm: standard deviation of a single reading about the mean, with all its noise."""


def forecast(result: FilterResult, seconds: float) -> Forecast:
    """Forecast the bias with its drift, plus the share exp(-seconds / correlation time) of the present slow error.

    A reading determines the sum of bias and slow error to within white noise, but hardly their split: their errors are
    opposite and equally large. So the uncertainty of the bias matters only as far as the slow error has decayed.
    """
    noise = result.params.bias
    times = (noise.drift_time, noise.correlated_time)
    mean = expected_ahead(result.bias, result.drift, result.slow_error, times, seconds)
    moved = _moved_by_drift(noise.drift_time, seconds) * result.drift_std
    process = np.asarray(noise.density, float) ** 2 * _square_moved(noise.drift_time, seconds)
    white = (result.innovation_std if result.reading_std is None else result.reading_std) ** 2
    if result.slow_error is None or noise.correlated_std is None or noise.correlated_time is None:
        return Forecast(mean, np.sqrt(_variance_of_sum(result.bias_std, moved) + process + white))
    kept = np.exp(-seconds / np.asarray(noise.correlated_time, float))
    slow = np.broadcast_to(np.asarray(noise.correlated_std, float) ** 2, result.bias.shape)
    known = np.where(slow > 0, kept**SOONER, 0.0)  # without slow errors the whole uncertainty of the bias stays
    variance = _variance_of_sum((1 - known) * result.bias_std, moved) + process + white - known**2 * slow
    return Forecast(mean, np.sqrt(variance))


def _variance_of_sum(of_bias: Array, of_drift: Array) -> Array:
    """Variance of the sum of the errors that bias and drift cause later."""
    return of_bias**2 + 2 * CORRELATION * of_bias * of_drift + of_drift**2


def expected_ahead(bias: Array, drift: Array, slow_error: Array | None, times: Times, seconds: float | Array) -> Array:
    """Expected wrench_tool - reading at a later time: (T, 6) N, Nm.

    Args:
        bias: (T, 6) N, Nm.
        drift: (T, 6) N/s, Nm/s.
        slow_error: (T, 6) N, Nm; None = none was separated from the bias.
        times: decay times of the filter's drift and slow error, s, in any shape that broadcasts; None = no decay.
        seconds: how far ahead, () or (T, 1).
    """
    drift_time, correlated_time = times
    mean = bias + _moved_by_drift(drift_time, seconds) * drift
    if slow_error is None or correlated_time is None:
        return mean
    return mean + np.exp(-seconds / np.asarray(correlated_time, float)) * slow_error


def _moved_by_drift(drift_time: Array | None, seconds: float | Array) -> float | Array:
    """Time, s, for which a drift moves the bias: less than elapsed where it reverts to zero; a time of inf = never."""
    if drift_time is None:
        return seconds
    times = np.asarray(drift_time, float)
    reverting = np.where(np.isinf(times), 1.0, times)
    return np.where(np.isinf(times), seconds, -reverting * np.expm1(-seconds / reverting))


def _square_moved(drift_time: Array | None, seconds: float) -> float | Array:
    """s^3: variance of the bias later, for a drift whose process noise has a density of one: the integral over the time
    since each of its impulses of the square of ``_moved_by_drift``."""
    cube = seconds**3 / 3
    if drift_time is None:
        return cube
    times = np.asarray(drift_time, float)
    slow = seconds < SERIES * times
    time = np.where(slow, 1.0, times)
    closed = time**2 * (seconds + 2 * time * np.expm1(-seconds / time) - time / 2 * np.expm1(-2 * seconds / time))
    return np.where(slow, cube * (1 - 0.75 * seconds / times), closed)
