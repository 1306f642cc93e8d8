"""Readings of one stream that are missing while the other goes on."""

from __future__ import annotations

import numpy as np

from ftbias_jax.io.log import Repair, Repairs
from ftbias_jax.types import Array

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
REGULAR = 0.9
"""Share of readings equally many rows apart, from which on they are those of a slower sensor; else some were lost."""


def missing_readings(which: str, t: Array, other_t: Array) -> Repairs:
    """What of a stream is missing, a line each for long stretches and for single rows; () = nothing worth a word.

    Args:
        which: the stream, with its verb: "the wrench is".
        t: (W,) s of its readings.
        other_t: (J,) s of those of the other stream.
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
        slower = len(apart) > 0 and (apart == np.median(apart)).mean() > REGULAR
        why = f"taken as a stream of {1 / intervals[~gaps[1:-1]].mean():.3g} Hz" if slower else "the others are missing"
        found.append(Repair(f"{which} measured in {len(t)} of {rows} rows: {why}", lost=not slower))
    return tuple(found)
