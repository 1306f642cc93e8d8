"""Faults that the rate of a stream hides: readings held over several samples, missing readings, and jittering stamps.

Readings are held where a sensor or controller publishes its last value again until it has a new one. Taking each repeat
for a measurement overstates the information: r repeats of one reading make error bars too small by the square root of
r, and joints that stand still between jumps look as if they shook. A single axis of a coarse sensor repeats often, too,
and at rest all of them may. Held readings differ in that all axes repeat, and change, together: far more often than the
repeats of single axes explain within any short segment of the log.
"""

from typing import NamedTuple

import numpy as np

from ftbias_jax.io.log import Repair, Repairs
from ftbias_jax.types import Array

WINDOW = 16
"""Number of samples per segment, in which single axes repeat about equally often: at rest or in motion, not both."""
LEAST_SAMPLES = 256
LEAST_SHARE = 0.1
"""Minimum share of held samples; fewer are lost packets, which are another fault."""
UNEXPLAINED = 0.8
"""Of the samples in which all axes repeat, minimum share that the repeats of single axes do not explain. On quantised
logs of an arm that stops and goes it is 0.4 at most (``tests/io/test_rates.py``)."""
BY_CHANCE = 0.1
"""Of the same samples, share explained by single axes up to which the longest run of equal samples is one reading;
above it, long runs are several equal readings."""
COINCIDENT = 0.8
"""Samples in which any axis changes, relative to those expected of independent axes; below it, axes change together."""
APART = 0.6
"""Rate of changes right after a change, relative to the overall rate; below it, readings last for several samples."""
LEAST_CHANGES = 50
"""Minimum number of changes in a stream; an arm at rest does not show whether readings are held."""
EMPTY = np.zeros(0, bool)
REPORTED_JITTER = 0.1
"""Jitter (standard deviation in median intervals) from which it is reported; a good recorder stays below 0.01."""
_NORMAL = 1.4826
"""Standard deviation of a normal distribution in median absolute deviations."""
LONGEST = 1.0
"""s without a reading that are reported, if they are also LONG times the usual interval."""
LONG = 10.0
FEWEST = 10
"""Minimum number of readings of the other stream in that time; with fewer, both streams paused."""
LISTED = 3
"""Number of intervals that are listed one by one."""
SAME_ROWS = 0.9
"""Share of the readings whose stamp the other stream has as well, above which both are columns of one table."""
FEW = 0.9
"""Share of the rows of such a table with a reading, below which the number of readings is reported."""
REGULAR, UNSTEADY = 0.9, 0.25
"""Share of the readings that are the usual number of rows apart, within this share of it (UNSTEADY), above which they
come from a slower sensor; otherwise readings were lost."""


class Repeats(NamedTuple):
    """Repeats counted so far in a stream; see ``extend_repeats``."""

    last: Array | None = None
    """(k,) the last sample."""
    together: tuple[Array, ...] = ()
    """For each sample in which anything was measured: whether all axes repeat the previous sample."""
    waiting: Array = np.zeros((0, 1), bool)
    """(W, k) repeats of single axes in the segment that is not complete yet."""
    explained: float = 0.0
    """Expected number of samples in which all axes repeat, if they do so independently of one another."""


class Held(NamedTuple):
    """A stream whose readings are held."""

    samples: int
    """Maximum number of samples of one reading."""
    repeats: Array
    """(T,) for each sample in which anything was measured: whether it repeats an earlier reading."""


def extend_repeats(seen: Repeats, values: Array) -> Repeats:
    """Add the next samples (T, k) of a stream, NaN = not measured; the result does not depend on how a log is cut."""
    values = values[~np.isnan(values).all(1)]
    if not len(values):
        return seen
    before = np.full((1, values.shape[1]), np.inf) if seen.last is None else seen.last[None]
    chain = np.concatenate([before, values])
    single = (chain[1:] == chain[:-1]) | (np.isnan(chain[1:]) & np.isnan(chain[:-1]))
    waiting = np.concatenate([seen.waiting.reshape(-1, values.shape[1]), single])
    whole = len(waiting) // WINDOW * WINDOW
    shares = waiting[:whole].reshape(-1, WINDOW, values.shape[1]).mean(1)
    explained = seen.explained + WINDOW * float(shares.prod(1).sum())
    return Repeats(values[-1], (*seen.together, single.all(1)), waiting[whole:], explained)


def held_readings(seen: Repeats) -> Held | None:
    """How the readings of a stream are held; None if they are not."""
    together = np.concatenate(seen.together) if seen.together else EMPTY
    explained = seen.explained + len(seen.waiting) * float(seen.waiting.mean(0).prod() if len(seen.waiting) else 0)
    count, changes = int(together.sum()), int((~together).sum())
    too_few = len(together) < LEAST_SAMPLES or changes < LEAST_CHANGES
    if too_few or count < LEAST_SHARE * len(together):
        return None
    repeat_together = count - explained >= UNEXPLAINED * count
    change_together = changes <= COINCIDENT * (len(together) - explained)
    after_change = float((~together[1:])[~together[:-1]].mean())
    if not repeat_together and not (change_together and after_change <= APART * changes / len(together)):
        return None
    starts = np.flatnonzero(~together)
    lengths = np.diff(np.r_[starts, len(together)])
    # Consecutive equal readings are indistinguishable from a longer hold except by their probability by chance.
    samples = int(lengths.max()) if explained < BY_CHANCE * count else _samples_of_one(lengths)
    place = np.arange(len(together)) - np.repeat(starts, lengths)  # position in the run of equal samples
    return Held(samples, place % samples != 0)


def _samples_of_one(lengths: Array) -> int:
    """Number of samples for which one reading is held, from runs of equal samples; longer runs are equal readings."""
    shortest = int(np.quantile(lengths, 0.1, method="higher"))
    single = lengths[lengths < max(2 * shortest, 3)]
    return int(np.quantile(single, 0.99, method="higher"))


def find_held(values: Array) -> Held | None:
    """How the readings of a stream (T, k), NaN = not measured, are held; None if they are not."""
    return held_readings(extend_repeats(Repeats(), values))


def jitter(t: Array) -> float:
    """Standard deviation in s of (T,) stamps in s about a steady clock; 0 if it is negligible.

    An interval has the errors of two stamps. Medians are used, so that gaps have no influence.
    """
    intervals = np.diff(t)
    if len(intervals) < 10:
        return 0.0
    middle = float(np.median(intervals))
    std = _NORMAL * float(np.median(np.abs(intervals - middle))) / np.sqrt(2)
    return std if std > REPORTED_JITTER * middle else 0.0


def missing_readings(which: str, t: Array, other_t: Array) -> Repairs:
    """Report missing readings of a stream, one line for long gaps and one for single rows; () = nothing to report.

    ``which`` is the stream with its verb, "the wrench is"; t (W,) s are the stamps of its readings, other_t (J,) s
    those of the other stream.
    """
    if not len(t) or not len(other_t):
        return ()
    intervals = np.diff(t)
    usual = float(np.median(intervals)) if len(intervals) else 0.0
    ends = np.concatenate([[min(other_t[0], t[0])], t, [max(other_t[-1], t[-1])]])
    between = np.searchsorted(other_t, ends[1:], "left") - np.searchsorted(other_t, ends[:-1], "right")
    gaps = (np.diff(ends) > max(LONGEST, LONG * usual)) & (between >= FEWEST)
    found = []
    if gaps.any():
        spans = [f"{a:.1f} to {b:.1f} s" for a, b in zip(ends[:-1][gaps], ends[1:][gaps], strict=True)]
        spans[LISTED:] = [f"{len(spans) - LISTED} times more"] if len(spans) > LISTED else []
        of = f"{np.diff(ends)[gaps].sum():.1f} of {ends[-1] - ends[0]:.1f} s"
        found.append(Repair(f"{which} missing for {of}: {', '.join(spans)}", lost=True))
    in_gaps = int(between[gaps].sum())
    rows = len(other_t) - in_gaps
    if np.isin(t, other_t, assume_unique=True).mean() > SAME_ROWS and len(t) < FEW * rows:
        apart = between[1:-1][~gaps[1:-1]]
        usual_apart = np.median(apart) if len(apart) else 0.0
        slower = len(apart) > 0 and (np.abs(apart - usual_apart) <= UNSTEADY * usual_apart).mean() > REGULAR
        why = f"taken as a stream of {1 / intervals[~gaps[1:-1]].mean():.3g} Hz" if slower else "the others are missing"
        found.append(Repair(f"{which} measured in {len(t)} of {rows} rows: {why}", lost=not slower))
    return tuple(found)
