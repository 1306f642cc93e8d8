"""Held readings: a sensor or controller that publishes its last value again until it has a new one.

Whoever takes each repeat for a measurement believes too much: r repeats of one reading make error bars too small by the
square root of r, and joints that stand still between jumps look as if they shook. One axis of a coarse sensor repeats
often, too, and at rest all of them may. What holding alone does is that all axes repeat, and change, together: far more
often than single axes explain, within any short stretch of the log.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ftbias_jax.types import Array

WINDOW = 16
"""Samples of a stretch in which single axes repeat about equally often: at rest or in motion, not both."""
LEAST_SAMPLES = 256
LEAST_SHARE = 0.1
"""Of samples that are held; fewer are lost packets, which are another fault."""
UNEXPLAINED = 0.8
"""Share of the samples in which all axes repeat that the repeats of single axes must not explain. On quantised logs of
an arm that stops and goes it is 0.4 at most (``tests/io/rates/test_held.py``)."""
COINCIDENT = 0.8
"""Samples in which any axis changes, of those expected if axes changed independently: below it they change together."""
APART = 0.6
"""How often a change follows a change, against how often anything changes: below it readings last for samples."""
LEAST_CHANGES = 50
"""Of the stream: an arm at rest says nothing."""
EMPTY = np.zeros(0, bool)


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
    samples = _samples_of_one(lengths)
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
