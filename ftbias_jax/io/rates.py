"""What the rate of a stream hides: readings that are held over several samples or missing, and stamps that scatter.

Held readings are those of a sensor or controller that publishes its last value again until it has a new one. Whoever
takes each repeat for a measurement believes too much: r repeats of one reading make error bars too small by the square
root of r, and joints that stand still between jumps look as if they shook. One axis of a coarse sensor repeats often,
too, and at rest all of them may. What holding alone does is that all axes repeat, and change, together: far more often
than single axes explain, within any short stretch of the log.
"""

from typing import NamedTuple

import numpy as np

from ftbias_jax.io.log import Repair, Repairs
from ftbias_jax.types import Array

WINDOW = 16
"""Samples of a stretch in which single axes repeat about equally often: at rest or in motion, not both."""
LEAST_SAMPLES = 256
LEAST_SHARE = 0.1
"""Of samples that are held; fewer are lost packets, which are another fault."""
UNEXPLAINED = 0.8
"""Share of the samples in which all axes repeat that the repeats of single axes must not explain. On quantised logs of
an arm that stops and goes it is 0.4 at most (``tests/io/test_rates.py``)."""
BY_CHANCE = 0.1
"""Share of them up to which every one is a repeat; where single axes explain more, a long run is of equal readings."""
COINCIDENT = 0.8
"""Samples in which any axis changes, of those expected if axes changed independently: below it they change together."""
APART = 0.6
"""How often a change follows a change, against how often anything changes: below it readings last for samples."""
LEAST_CHANGES = 50
"""Of the stream: an arm at rest says nothing."""
EMPTY = np.zeros(0, bool)
TOLD = 0.1
"""Standard deviation in median intervals from which on jitter is told; a good recorder stays below a hundredth."""
_NORMAL = 1.4826
"""Standard deviation of a normal distribution in median absolute deviations."""
LONGEST = 1.0
"""s without a reading that are told, where that is also LONG times the usual interval."""
LONG = 10.0
FEWEST = 10
"""Readings of the other stream in that time; fewer are a pause of both."""
LISTED = 3
"""Stretches that are told one by one."""
SAME_ROWS = 0.9
"""Share of the readings whose stamp the other stream has too, from which on both are columns of one table."""
FEW = 0.9
"""Share of the rows of such a table below which it is told that only so many have a reading."""
REGULAR, UNSTEADY = 0.9, 0.25
"""Share of readings as many rows apart as usual, to a share of that, from which on they are those of a slower sensor;
else some were lost."""


class Repeats(NamedTuple):
    """What was seen of a stream so far; see ``extend_repeats``."""

    last: Array | None = None
    """(k,) the last sample."""
    together: tuple[Array, ...] = ()
    """Of the samples in which anything was measured: whether all axes repeat the sample before."""
    waiting: Array = np.zeros((0, 1), bool)
    """(W, k) repeats of single axes in the stretch that has begun."""
    explained: float = 0.0
    """Samples in which all axes would repeat, if they did so independently of one another."""


class Held(NamedTuple):
    """A stream whose readings are held."""

    samples: int
    """Of one reading, at most."""
    repeats: Array
    """(T,) of the samples in which anything was measured: those that repeat a reading that was taken before."""


def extend_repeats(seen: Repeats, values: Array) -> Repeats:
    """Take in the next samples (T, k) of a stream, NaN = not measured; the same however a log is cut into parts."""
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
    """Whether the readings of a stream are held; None if not."""
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
    # Equal readings one after the other cannot be told from a longer hold, but by how often chance makes them equal.
    samples = int(lengths.max()) if explained < BY_CHANCE * count else _samples_of_one(lengths)
    place = np.arange(len(together)) - np.repeat(starts, lengths)  # in the run of equal readings
    return Held(samples, place % samples != 0)


def _samples_of_one(lengths: Array) -> int:
    """For how many samples one reading is held, from the runs of equal samples: longer runs are equal readings."""
    shortest = int(np.quantile(lengths, 0.1, method="higher"))
    single = lengths[lengths < max(2 * shortest, 3)]
    return int(np.quantile(single, 0.99, method="higher"))


def find_held(values: Array) -> Held | None:
    """Whether the readings of a stream (T, k), NaN = not measured, are held; None if not."""
    return held_readings(extend_repeats(Repeats(), values))


def jitter(t: Array) -> float:
    """Standard deviation in s by which (T,) stamps in s are off a steady clock; 0 if that is no matter.

    The interval between two stamps has the errors of both. By the median, so that gaps count for nothing.
    """
    intervals = np.diff(t)
    if len(intervals) < 10:
        return 0.0
    middle = float(np.median(intervals))
    std = _NORMAL * float(np.median(np.abs(intervals - middle))) / np.sqrt(2)
    return std if std > TOLD * middle else 0.0


def missing_readings(which: str, t: Array, other_t: Array) -> Repairs:
    """What of a stream is missing, a line each for long stretches and for single rows; () = nothing worth a word.

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
