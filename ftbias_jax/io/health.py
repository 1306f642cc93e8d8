"""Signs of trouble in a recorded stream: gaps, axes that stand still, axes at the end of their range."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.io.rates import find_held, jitter
from ftbias_jax.io.ros.messages import JOINT_STATE
from ftbias_jax.types import Array

GAP = 10.0
"""Intervals this many times the median one, and no shorter than SHORTEST_GAP."""
SHORTEST_GAP = 0.1
STUCK_SECONDS = 2.0
"""A sensor has noise: no axis of it stays on one value for so long, and for STUCK_SAMPLES."""
STUCK_SAMPLES = 100
COARSE = 0.2
"""Share of samples that repeat the one before, from which on an axis is quantised, or recorded too often."""
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


class Still(NamedTuple):
    """A stretch in which an axis keeps a value to the last bit."""

    value: float = np.nan
    first: float = 0.0
    """s, stamps of its first and last sample."""
    last: float = 0.0
    samples: int = 0

    @property
    def long(self) -> bool:
        """Whether no sensor with noise stands still for so long."""
        return self.last - self.first >= STUCK_SECONDS and self.samples >= STUCK_SAMPLES


class Axis(NamedTuple):
    """What was seen of an axis so far: how it stood still, and whether it is clipped; see ``extend``."""

    samples: int = 0
    """That were measured."""
    now: Still = Still()
    """The stretch that may go on."""
    long: tuple[Still, ...] = ()
    """Those before it that were long."""
    stretches: int = 0
    """All of them."""
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

    @property
    def limits(self) -> Saturation:
        """Where it is clipped: values that it holds at the end of its range, far longer than any within.

        Resting and coarsely quantised axes hold every value for long, and are not taken for clipped.
        """
        least = max(SATURATED_RUN, 3 * self.inner_run) if self.low < self.high else np.inf
        return Saturation(
            self.low if self.low_run >= least else np.nan, self.high if self.high_run >= least else np.nan
        )

    @property
    def clipped(self) -> int:
        """Samples on its limits."""
        low, high = self.limits
        return (low == self.low) * self.low_count + (high == self.high) * self.high_count

    @property
    def stuck(self) -> tuple[Still, ...]:
        """When it stood still for too long, though it otherwise has noise; () if it often repeats a value.

        Coarse ones do that; and where it is clipped, it is not stuck.
        """
        long = (*self.long, self.now) if self.now.long else self.long
        rest = self.samples - sum(still.samples for still in long)
        if self.stretches - len(long) < (1 - COARSE) * rest:
            return ()
        return tuple(still for still in long if still.value not in self.limits)


def extend(seen: Axis, t: Array, values: Array) -> Axis:
    """Take in the next samples (T,) of an axis at t (T,) s, NaN = not measured; the log may be cut anywhere."""
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
        # The ends of the past compete with the new runs.
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
    """One stream of samples."""

    name: str
    """The topic, or "joints" and "wrench"."""
    kind: str
    names: tuple[str, ...]
    """Of the joints; of a wrench, its frame if known."""
    samples: int
    first: float
    """s, as stamped."""
    last: float
    rate: float
    """Hz."""
    gaps: tuple[tuple[float, float], ...]
    """Start, in s after the first stamp, and length in s."""
    trouble: tuple[str, ...]
    """A line each: stuck, saturated or missing axes; a recorder's clock that is off."""

    def without_stamps(self) -> StreamInfo:
        """Of rows that were only counted."""
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
    """What there is to say about samples (T, k) at t (T,) s after ``start``; only a sensor may not stand still."""
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
