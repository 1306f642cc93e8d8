"""Stamps of recorded streams, as integers in ns: which clock to trust, and order where it is a little wrong."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.types import Array

SECOND = 10**9
JUMP = SECOND // 10
"""ns: a stamp this far behind the one before means that the clock was set back; less, that it came late."""
PAUSE = SECOND
"""ns, between what was recorded before and after the clock was set back: the true pause is not known."""


class Clock(NamedTuple):
    """The stamps to use."""

    stamps: tuple[Array, ...]
    """(T,) int64 ns each."""
    complaint: str
    """Why not those of the headers; "" if they are."""


def choose_clock(stamps: Sequence[Array], logged: Sequence[Array]) -> Clock:
    """The headers' stamps if all streams have them on one clock, otherwise the times at which they were logged.

    Args:
        stamps: (T,) int64 ns for each stream, in the order in which they were stored; a stamp of 0 = not set.
        logged: (T,) int64 ns for each stream, in the order in which they were stored; a stamp of 0 = not set.
    """
    if any(np.mean(times == 0) > 0.5 for times in stamps):
        return Clock(tuple(logged), "the headers have no stamps")
    if not _overlap(stamps) and _overlap(logged):
        return Clock(tuple(logged), "the headers' stamps are of different clocks")
    if any(len(jumps(times[times != 0])) for times in stamps) and not any(len(jumps(times)) for times in logged):
        return Clock(tuple(logged), "the headers' clock jumps back")
    return Clock(tuple(stamps), "")


def jumps(t: Array) -> Array:
    """Indices of the (T,) stamps in ns before which the clock was set back."""
    return np.flatnonzero(t[1:] <= t[:-1] - JUMP) + 1


def continue_after_jumps(streams: Sequence[Array], file: str = "") -> tuple[tuple[Array, ...], int]:
    """Stamps that go on PAUSE after the clock was set back, and how often it was; segments stay together.

    Args:
        streams: (T,) int64 ns for each stream, in the order in which they were stored.
        file: the name in messages.

    Raises:
        LogError: the streams do not agree on how often the clock was set back.
    """
    starts = [jumps(t) for t in streams]
    counts = {len(start) for start in starts}
    if counts == {0}:
        return tuple(streams), 0
    if len(counts) > 1:
        message = f"the clock jumps back {' and '.join(str(len(start)) for start in starts)} times in the two streams"
        remedy = "cut the recording where its clock was set"
        raise LogError(message, file=file, field="t_joints, t_wrench", remedy=remedy)
    pieces = [np.split(t, start) for t, start in zip(streams, starts, strict=True)]
    moved = [[piece[0]] for piece in pieces]
    for k in range(1, counts.pop() + 1):
        end = max(done[-1].max() for done in moved)
        start = min(piece[k].min() for piece in pieces)
        for done, piece in zip(moved, pieces, strict=True):
            done.append(piece[k] + (end + PAUSE - start))
    return tuple(np.concatenate(done) for done in moved), len(starts[0])


class Tidy(NamedTuple):
    """A stream in order."""

    t: Array
    """(U,) int64 ns, strictly increasing."""
    values: Array
    """(U, k)."""
    late: int
    """Samples that were moved to their place."""
    repeated: int
    """Samples that were left out, because their stamp had a value already."""


def tidy(t: Array, values: Array) -> Tidy:
    """Sort samples by their stamps; samples of one stamp become one, each column from the first that has it.

    Args:
        t: (T,) int64 ns.
        values: (T, k), NaN = not measured.
    """
    late = int((t[1:] < np.maximum.accumulate(t)[:-1]).sum()) if len(t) else 0
    unique, place = np.unique(t, return_inverse=True)
    if len(unique) == len(t) and not late:
        return Tidy(t, values, 0, 0)
    merged = np.full((len(unique), values.shape[1]), np.nan)
    given = ~np.isnan(values)
    used = ~given
    for column, rows in enumerate(given.T):
        here = np.flatnonzero(rows)
        places, first = np.unique(place[here], return_index=True)
        merged[places, column] = values[here[first], column]
        used[here[first], column] = True
    return Tidy(unique, merged, late, int((~used).any(1).sum()))


def _overlap(streams: Sequence[Array]) -> bool:
    set_ = [t[t != 0] for t in streams]
    return all(len(t) for t in set_) and max(t.min() for t in set_) <= min(t.max() for t in set_)
