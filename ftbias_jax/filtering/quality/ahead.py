"""What later readings should be, by the state of a filter: the one definition of a forecast's mean."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ftbias_jax.types import Array

if TYPE_CHECKING:
    from ftbias_jax.model.params import BiasNoise


def expected_ahead(
    bias: Array, drift: Array, slow_error: Array | None, noise: BiasNoise, seconds: float | Array
) -> Array:
    """What wrench_tool - reading should be later: (T, 6) N, Nm.

    Args:
        bias: (T, 6) N, Nm.
        drift: (T, 6) N/s, Nm/s.
        slow_error: (T, 6) N, Nm; None = none was told from the bias.
        noise: that the filter took.
        seconds: how far ahead, () or (T, 1).
    """
    return expected_with(bias, drift, slow_error, noise.drift_time, noise.correlated_time, seconds)


def expected_with(
    bias: Array,
    drift: Array,
    slow_error: Array | None,
    drift_time: Array | None,
    correlated_time: Array | None,
    seconds: float | Array,
) -> Array:
    """The same for times in which drift and slow error are forgotten, s, in any shape that broadcasts; None = never."""
    mean = bias + moved_by_drift(drift_time, seconds) * drift
    if slow_error is None or correlated_time is None:
        return mean
    return mean + np.exp(-seconds / np.asarray(correlated_time, float)) * slow_error


def moved_by_drift(drift_time: Array | None, seconds: float | Array) -> float | Array:
    """s by which a drift moves the bias: fewer than have passed, where it reverts to zero.

    Args:
        drift_time: s in which it does; inf, or None for all, = never.
        seconds: that pass.
    """
    if drift_time is None:
        return seconds
    times = np.asarray(drift_time, float)
    reverting = np.where(np.isinf(times), 1.0, times)
    moved: Array = np.where(np.isinf(times), seconds, -reverting * np.expm1(-seconds / reverting))
    return moved
