"""Signs of trouble in a recorded stream: gaps, axes that stand still, axes at the end of their range."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ftbias_jax.types import Array, Log

GAP = 10.0
"""Intervals this many times the median one, and no shorter than SHORTEST_GAP."""
SHORTEST_GAP = 0.1
STUCK_SECONDS = 2.0
"""A sensor has noise: no axis of it stays on one value for so long, and for STUCK_SAMPLES."""
STUCK_SAMPLES = 100
SATURATED_RUN = 5
"""Samples in a row on the largest or smallest value, when no other value is held for a third as long."""


class Saturation(NamedTuple):
    """The values at which an axis is clipped; NaN = it is not."""

    low: float
    high: float


def sample_rate(t: Array) -> float:
    """Hz, by the median interval of the (T,) stamps in s; NaN for fewer than two."""
    return float(1 / np.median(np.diff(t))) if len(t) > 1 else float("nan")


def gaps(t: Array) -> list[tuple[float, float]]:
    """Start and length in s of every interval between (T,) stamps that is far longer than the others."""
    intervals = np.diff(t)
    if not len(intervals):
        return []
    long = np.flatnonzero(intervals > max(GAP * np.median(intervals), SHORTEST_GAP))
    return [(float(t[i]), float(intervals[i])) for i in long]


def stuck_seconds(t: Array, values: Array) -> float:
    """The longest time in s for which one axis keeps a value to the last bit; 0 if a sensor may do that.

    Args:
        t: (T,) s. values: (T,), NaN = not measured.
    """
    measured = ~np.isnan(values)
    t, values = t[measured], values[measured]
    starts, lengths = _runs(values)
    seconds = t[starts + lengths - 1] - t[starts]
    stuck = (seconds >= STUCK_SECONDS) & (lengths >= STUCK_SAMPLES)
    return float(seconds[stuck].max(initial=0.0))


def saturation(values: Array) -> Saturation:
    """Where an axis (T,) is clipped: values it holds at the end of its range, far longer than any within.

    Resting and coarsely quantised axes hold every value for long, and are not taken for clipped.
    """
    values = values[~np.isnan(values)]
    if not len(values) or values.min() == values.max():
        return Saturation(np.nan, np.nan)
    starts, lengths = _runs(values)
    held = values[starts]
    ends = (values.min(), values.max())
    inner = lengths[(held != ends[0]) & (held != ends[1])].max(initial=1)
    limits = [end if lengths[held == end].max() >= max(SATURATED_RUN, 3 * inner) else np.nan for end in ends]
    return Saturation(*map(float, limits))


def mask_saturated(log: Log) -> tuple[Log, Array]:
    """The log with NaN where an axis of the wrench is clipped, and the (6,) numbers of those samples."""
    limits = np.array([saturation(axis) for axis in log.wrench.T])
    clipped = (log.wrench == limits[:, 0]) | (log.wrench == limits[:, 1])
    return log._replace(wrench=np.where(clipped, np.nan, log.wrench)), clipped.sum(0)


def _runs(values: Array) -> tuple[Array, Array]:
    """First index and length of every stretch of equal values."""
    starts = np.flatnonzero(np.r_[True, values[1:] != values[:-1]]) if len(values) else np.zeros(0, int)
    return starts, np.diff(np.r_[starts, len(values)])
