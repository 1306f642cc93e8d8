"""Detection of faults in a recorded stream: gaps, stuck axes, and saturated axes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.io.rates import find_held, jitter
from ftbias_jax.io.ros.messages import JOINT_STATE
from ftbias_jax.types import Array

GAP = 10.0
"""A gap is an interval this many times the median one, and longer than SHORTEST_GAP s."""
SHORTEST_GAP = 0.1
STUCK_SECONDS = 2.0
"""s; because of its noise, no axis of a sensor stays on one value for this long and for STUCK_SAMPLES samples."""
STUCK_SAMPLES = 100
COARSE = 0.2
"""Share of samples repeating the previous one, above which an axis is quantised or recorded too often."""
SATURATED_RUN = 5
"""Minimum consecutive samples on the largest or smallest value, if no other value is held for over a third as long."""


class Saturation(NamedTuple):
    """The values at which an axis is clipped; NaN = it is not."""

    low: float
    high: float


def sample_rate(t: Array) -> float:
    """Sample rate in Hz from the median interval of (T,) stamps in s; NaN for fewer than two."""
    return float(1 / np.median(np.diff(t))) if len(t) > 1 else float("nan")


def gaps(t: Array) -> list[tuple[float, float]]:
    """Start and length in s of every interval between (T,) stamps that is far longer than the others."""
    intervals = np.diff(t)
    if not len(intervals):
        return []
    long = np.flatnonzero(intervals > max(GAP * np.median(intervals), SHORTEST_GAP))
    return [(float(t[i]), float(intervals[i])) for i in long]


class Still(NamedTuple):
    """An interval in which an axis keeps one value to the last bit."""

    value: float = np.nan
    first: float = 0.0
    """s, stamps of its first and last sample."""
    last: float = 0.0
    samples: int = 0

    @property
    def long(self) -> bool:
        """Whether the interval is too long for a sensor with noise."""
        return self.last - self.first >= STUCK_SECONDS and self.samples >= STUCK_SAMPLES


class Axis(NamedTuple):
    """State of an axis up to now: its constant intervals, and whether it is clipped; see ``extend``."""

    samples: int = 0
    """Number of measured samples."""
    now: Still = Still()
    """The latest constant interval, which may continue."""
    long: tuple[Still, ...] = ()
    """Earlier constant intervals that were too long."""
    stretches: int = 0
    """Number of all constant intervals."""
    low: float = np.inf
    """The smallest value."""
    high: float = -np.inf
    low_run: int = 0
    """Maximum consecutive samples on the smallest value."""
    high_run: int = 0
    inner_run: int = 1
    """Maximum consecutive samples on any value between the smallest and the largest."""
    low_count: int = 0
    """Number of samples on the smallest value."""
    high_count: int = 0

    @property
    def limits(self) -> Saturation:
        """Values at which the axis is clipped: ends of its range, held far longer than any value within.

        Resting and coarsely quantised axes hold every value for long, and do not count as clipped.
        """
        least = max(SATURATED_RUN, 3 * self.inner_run) if self.low < self.high else np.inf
        return Saturation(
            self.low if self.low_run >= least else np.nan, self.high if self.high_run >= least else np.nan
        )

    @property
    def clipped(self) -> int:
        """Number of samples on the limits of the axis."""
        low, high = self.limits
        return (low == self.low) * self.low_count + (high == self.high) * self.high_count

    @property
    def stuck(self) -> tuple[Still, ...]:
        """Intervals in which the axis is stuck, though it otherwise has noise; () if it often repeats a value.

        Coarse axes repeat values often; and where an axis is clipped, it does not count as stuck.
        """
        long = (*self.long, self.now) if self.now.long else self.long
        rest = self.samples - sum(still.samples for still in long)
        if self.stretches - len(long) < (1 - COARSE) * rest:
            return ()
        return tuple(still for still in long if still.value not in self.limits)


def extend(seen: Axis, t: Array, values: Array) -> Axis:
    """Add the next samples (T,) of an axis at t (T,) s, NaN = not measured; the log may be cut anywhere."""
    measured = ~np.isnan(values)
    t, values = t[measured], values[measured]
    if not len(values):
        return seen
    starts = np.flatnonzero(np.r_[True, values[1:] != values[:-1]])
    counts = np.diff(np.r_[starts, len(values)])
    levels, runs, first, last = values[starts], counts.copy(), t[starts], t[starts + counts - 1]
    goes_on = bool(levels[0] == seen.now.value)
    if goes_on:
        first[0] = seen.now.first
        runs[0] += seen.now.samples
    places = [*np.flatnonzero(last[:-1] - first[:-1] >= STUCK_SECONDS), -1]
    stills = [Still(*(column[i].item() for column in (levels, first, last, runs))) for i in places]
    ended = [still for still in ([] if goes_on else [seen.now]) + stills[:-1] if still.long]
    if seen.samples:
        # The extreme values of earlier samples compete with the new runs.
        levels, runs = np.r_[levels, seen.low, seen.high], np.r_[runs, seen.low_run, seen.high_run]
        counts = np.r_[counts, seen.low_count, seen.high_count if seen.low < seen.high else 0]
    low, high = levels == levels.min(), levels == levels.max()
    return Axis(
        samples=seen.samples + len(values),
        now=stills[-1],
        long=(*seen.long, *ended),
        stretches=seen.stretches + len(starts) - goes_on,
        low=float(levels.min()),
        high=float(levels.max()),
        low_run=int(runs[low].max()),
        high_run=int(runs[high].max()),
        inner_run=int(runs[~low & ~high].max(initial=seen.inner_run)),
        low_count=int(counts[low].sum()),
        high_count=int(counts[high].sum()),
    )


def mask(t: Array, wrench: Array, clipped: Sequence[Saturation], stuck: Sequence[Sequence[Still]]) -> Array:
    """The wrench (T, 6) at t (T,) s with NaN where an axis is at one of its limits, or stuck."""
    ends = np.array(clipped)
    useless = (wrench == ends[:, 0]) | (wrench == ends[:, 1])
    for axis, stretches in enumerate(stuck):
        for still in stretches:
            useless[(t >= still.first) & (t <= still.last), axis] = True
    return np.where(useless, np.nan, wrench)


class StreamInfo(NamedTuple):
    """Summary of one stream of samples."""

    name: str
    """The topic, or "joints" and "wrench"."""
    kind: str
    names: tuple[str, ...]
    """Names of the joints; for a wrench, its frame if known."""
    samples: int
    first: float
    """s, recorded stamps of the first and the last sample."""
    last: float
    rate: float
    """Hz."""
    gaps: tuple[tuple[float, float], ...]
    """Start, in s after the first stamp, and length in s."""
    trouble: tuple[str, ...]
    """One line per fault: stuck, saturated or missing axes; a recorder's clock that is off."""

    def without_stamps(self) -> StreamInfo:
        """Summary of a stream whose rows were counted but have no stamps."""
        nowhere = float("nan")
        return self._replace(first=nowhere, last=nowhere, rate=nowhere, gaps=(), trouble=("it has no stamps",))


def stream_info(
    name: str,
    kind: str,
    names: Sequence[str],
    start: float,
    t: Array,
    values: Array,
    labels: Sequence[str],
    sensor: bool = False,
) -> StreamInfo:
    """Summarise samples (T, k) at t (T,) s after ``start``; only a ``sensor`` can be stuck or saturated."""
    trouble = []
    for label, column in zip(labels, values.T, strict=True):
        missing = np.isnan(column).mean() if len(column) else 1.0
        axis = extend(Axis(), t, column)
        if missing:
            trouble.append(f"{label}: {100 * missing:.3g} % not measured")
        if sensor and axis.stuck:
            trouble.append(f"{label}: stuck for {max(still.last - still.first for still in axis.stuck):.3g} s")
        if sensor and (ends := " and ".join(f"{end:.6g}" for end in axis.limits if not np.isnan(end))):
            trouble.append(f"{label}: saturated at {ends}")
    readings = values[:, : len(names)] if kind == JOINT_STATE else values
    if (repeated := find_held(readings)) is not None:
        share = f"{100 * repeated.repeats.mean():.0f} % of the samples repeat the one before"
        trouble.append(f"held: {share}, one reading for up to {repeated.samples} samples")
    if scatter := jitter(t):
        trouble.append(f"stamps scatter by {1e3 * scatter:.3g} ms about a steady clock")
    first, last = (start + t[0], start + t[-1]) if len(t) else (np.nan, np.nan)
    found = tuple((at - t[0], length) for at, length in gaps(t))
    return StreamInfo(name, kind, tuple(names), len(t), first, last, sample_rate(t), found, tuple(trouble))
