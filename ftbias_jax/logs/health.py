"""Signs of trouble in a recorded stream: gaps, axes that stand still, axes at the end of their range."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.types import Array

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


class Extremes(NamedTuple):
    """What decides whether an axis is clipped, of the samples seen so far; see ``extend``."""

    low: float = np.inf
    """The smallest value."""
    high: float = -np.inf
    low_run: int = 0
    """Samples in a row on it, at most."""
    high_run: int = 0
    inner_run: int = 1
    """Samples in a row on any other value, at most."""
    low_count: int = 0
    """Samples on the smallest value."""
    high_count: int = 0
    value: float = np.nan
    """The last one."""
    run: int = 0
    """Samples in a row on it."""


def extend(seen: Extremes, values: Array) -> Extremes:
    """Take in the next samples (T,) of an axis, NaN = not measured; the same however a log is cut into parts."""
    values = values[~np.isnan(values)]
    if not len(values):
        return seen
    starts, lengths = _runs(values)
    level, count, longest = values[starts], lengths, lengths.copy()
    if seen.run:
        if level[0] == seen.value:
            longest[0] += seen.run
        # The ends of the past compete with the new runs.
        level = np.r_[level, seen.low, seen.high]
        longest = np.r_[longest, seen.low_run, seen.high_run]
        count = np.r_[count, seen.low_count, seen.high_count if seen.low < seen.high else 0]
    low, high = level == level.min(), level == level.max()
    return Extremes(
        low=float(level.min()),
        high=float(level.max()),
        low_run=int(longest[low].max()),
        high_run=int(longest[high].max()),
        inner_run=int(longest[~low & ~high].max(initial=seen.inner_run)),
        low_count=int(count[low].sum()),
        high_count=int(count[high].sum()),
        value=float(values[-1]),
        run=int(longest[len(lengths) - 1]),
    )


def limits(seen: Extremes) -> Saturation:
    """Where an axis is clipped: values it holds at the end of its range, far longer than any within.

    Resting and coarsely quantised axes hold every value for long, and are not taken for clipped.
    """
    if not seen.low < seen.high:
        return Saturation(np.nan, np.nan)
    least = max(SATURATED_RUN, 3 * seen.inner_run)
    return Saturation(seen.low if seen.low_run >= least else np.nan, seen.high if seen.high_run >= least else np.nan)


def saturation(values: Array) -> Saturation:
    """Where an axis (T,) is clipped; see ``limits``."""
    return limits(extend(Extremes(), values))


def mask(wrench: Array, clipped: Sequence[Saturation]) -> Array:
    """(T, 6) with NaN where an axis is at one of its limits."""
    ends = np.array(clipped)
    return np.where((wrench == ends[:, 0]) | (wrench == ends[:, 1]), np.nan, wrench)


def _runs(values: Array) -> tuple[Array, Array]:
    """First index and length of every stretch of equal values."""
    starts = np.flatnonzero(np.r_[True, values[1:] != values[:-1]]) if len(values) else np.zeros(0, int)
    return starts, np.diff(np.r_[starts, len(values)])
