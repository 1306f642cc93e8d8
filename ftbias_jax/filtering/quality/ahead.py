"""Forecast of the readings after each sample of a filtered log: bias and drift continue, slow errors decay."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftbias_jax.types import Array

if TYPE_CHECKING:
    from ftbias_jax.filtering.verbs.results import FilterResult

Times = tuple[Array | None, Array | None]
SOONER = 2.0
"""Factor by which a log of a few correlation times may overestimate the correlation time, allowed for in the standard
deviation. Without it, 87 % of readings of recorded logs were in their 95 % intervals 10 s ahead."""


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
    of_drift = (_moved_by_drift(noise.drift_time, seconds) * result.drift_std) ** 2
    white = (result.innovation_std if result.reading_std is None else result.reading_std) ** 2
    if result.slow_error is None or noise.correlated_std is None or noise.correlated_time is None:
        return Forecast(mean, np.sqrt(result.bias_std**2 + of_drift + white))
    kept = np.exp(-seconds / np.asarray(noise.correlated_time, float))
    slow = np.broadcast_to(np.asarray(noise.correlated_std, float) ** 2, result.bias.shape)
    known = np.where(slow > 0, kept**SOONER, 0.0)  # without slow errors the whole uncertainty of the bias stays
    variance = ((1 - known) * result.bias_std) ** 2 + of_drift + white - known**2 * slow
    return Forecast(mean, np.sqrt(variance))


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
