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


class Held(NamedTuple):
    """How an axis stood still, in the samples seen so far; see ``hold``."""

    now: Still = Still()
    """The stretch that may go on."""
    long: tuple[Still, ...] = ()
    """Those before it that were long."""
    stretches: int = 0
    """All of them."""
    samples: int = 0


def hold(seen: Held, t: Array, values: Array) -> Held:
    """Take in the next samples (T,) of an axis at t (T,) s, NaN = not measured; the log may be cut anywhere."""
    measured = ~np.isnan(values)
    t, values = t[measured], values[measured]
    if not len(values):
        return seen
    starts, lengths = _runs(values)
    first, last = t[starts], t[starts + lengths - 1]
    goes_on = bool(values[0] == seen.now.value)
    if goes_on:
        first[0] = seen.now.first
        lengths[0] += seen.now.samples
    columns = (values[starts].tolist(), first.tolist(), last.tolist(), lengths.tolist())
    candidates = np.flatnonzero(last - first >= STUCK_SECONDS).tolist()
    ended = [] if goes_on else [seen.now]
    ended += [Still(*(column[i] for column in columns)) for i in candidates if i < len(starts) - 1]
    return Held(
        Still(*(column[-1] for column in columns)),
        seen.long + tuple(still for still in ended if still.long),
        seen.stretches + len(starts) - goes_on,
        seen.samples + len(values),
    )


def stuck(seen: Held) -> tuple[Still, ...]:
    """The long stretches of an axis that otherwise has noise; () if it often repeats a value, as coarse ones do."""
    long = (*seen.long, seen.now) if seen.now.long else seen.long
    rest = seen.samples - sum(still.samples for still in long)
    return long if seen.stretches - len(long) >= (1 - COARSE) * rest else ()


def stuck_seconds(t: Array, values: Array) -> float:
    """The longest time in s for which one axis (T,) at t (T,) s is stuck; 0 if it is not."""
    return max((still.last - still.first for still in stuck(hold(Held(), t, values))), default=0.0)


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


def mask(t: Array, wrench: Array, clipped: Sequence[Saturation], stuck: Sequence[Sequence[Still]]) -> Array:
    """The wrench (T, 6) at t (T,) s with NaN where an axis is at one of its limits, or stuck."""
    ends = np.array(clipped)
    useless = (wrench == ends[:, 0]) | (wrench == ends[:, 1])
    for axis, stretches in enumerate(stuck):
        for still in stretches:
            useless[(t >= still.first) & (t <= still.last), axis] = True
    return np.where(useless, np.nan, wrench)


def _runs(values: Array) -> tuple[Array, Array]:
    """First index and length of every stretch of equal values."""
    starts = np.flatnonzero(np.r_[True, values[1:] != values[:-1]]) if len(values) else np.zeros(0, int)
    return starts, np.diff(np.r_[starts, len(values)])


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
        limits = saturation(column)
        if missing:
            trouble.append(f"{label}: {100 * missing:.3g} % not measured")
        if sensor and (seconds := stuck_seconds(t, column)):
            trouble.append(f"{label}: stuck for {seconds:.3g} s")
        if sensor and not np.isnan(limits).all():
            ends = " and ".join(f"{end:.6g}" for end in limits if not np.isnan(end))
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
