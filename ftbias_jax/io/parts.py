"""Logs in parts, so that long ones need not fit in memory, and what must be known of all before the first part."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io import read_log_with_repairs
from ftbias_jax.io.check import check_content, check_samples, relative_seconds
from ftbias_jax.io.health import Extremes, Held, Saturation, Still, extend, hold, limits, mask, stuck
from ftbias_jax.io.npz_archive import stored_arrays
from ftbias_jax.io.repairs import Repair, Repairs
from ftbias_jax.io.tables.arrays import ARRAYS
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import AXES, Array, Log

LONG = 1 << 20
"""Samples from which on an NPZ file is read in parts; the other formats are held in memory."""

Split = Callable[[int], Iterator[Log]]
"""Samples at once -> the log from its first sample on."""


class Facts(NamedTuple):
    """What must be known of a whole log."""

    first_q: Array
    """(n,) rad, first measured position of every joint; NaN = never."""
    wrench_t: Array
    """(W,) s, stamps at which any axis of the wrench was measured."""
    measured: Array
    """(6,) whether the axis ever was."""
    clipped: tuple[Saturation, ...]
    """Of every axis."""
    clipped_count: Array
    """(6,) samples on those limits."""
    stuck: tuple[tuple[Still, ...], ...]
    """Of every axis, when it stood still for too long."""


class OpenLog(NamedTuple):
    """A log that can be filtered; samples of clipped and stuck axes are not measured."""

    length: int
    start: float
    """s, stamp of the first sample."""
    parts: Split
    facts: Facts
    repairs: Repairs

    def whole(self) -> Log:
        """All of it in memory."""
        return next(self.parts(self.length))


def open_log(path: str | os.PathLike[str], setup: Setup, *, salvage: bool = False) -> OpenLog:
    """Open a log of any format; samples at the end of the sensor's range or of a stuck axis are left out, and counted.

    Args:
        path: as for ``read_log``.
        setup: as for ``read_log``.
        salvage: as for ``read_log``.

    Raises:
        LogError: it cannot be read, or cannot be filtered (``check_log``).
    """
    file = os.fspath(path)
    opened = _open_npz(file, setup) if Path(file).suffix.lower() == ".npz" and not setup.pose else None
    if opened is None:
        log, repairs = read_log_with_repairs(path, setup, salvage=salvage)
        length, start, split = len(log.t), log.start, _slices(log)
    else:
        (length, start, split), repairs = opened, ()
    facts = survey(split)
    check_content(~np.isnan(facts.first_q), facts.wrench_t, setup, file=file)
    stuck_count = [sum(still.samples for still in stretches) for stretches in facts.stuck]
    reasons = {"at the end of the sensor's range": facts.clipped_count, "of an axis that stands still": stuck_count}
    useless = [(why, _counted(counts)) for why, counts in reasons.items() if any(counts)]
    repairs = (*repairs, *(Repair(f"samples {why} left out: {counts}", lost=True) for why, counts in useless))

    def masked(size: int) -> Iterator[Log]:
        for part in split(size):
            good = mask(part.t, part.wrench, facts.clipped, facts.stuck) if useless else part.wrench
            yield part._replace(wrench=good)

    return OpenLog(length, start, masked, facts, repairs)


def survey(split: Split) -> Facts:
    """Read a log once for what must be known of all of it."""
    axes, helds, measured, stamps = [Extremes()] * 6, [Held()] * 6, np.zeros(6, bool), []
    first_q: Array = np.nan
    for part in split(LONG // 16):
        seen = ~np.isnan(part.q)
        first = np.where(seen.any(0), np.take_along_axis(part.q, seen.argmax(0)[None], 0)[0], np.nan)
        first_q = np.where(np.isnan(first_q), first, first_q)
        given = ~np.isnan(part.wrench)
        measured |= given.any(0)
        stamps.append(part.t[given.any(1)])
        axes = [extend(axis, values) for axis, values in zip(axes, part.wrench.T, strict=True)]
        helds = [hold(held, part.t, values) for held, values in zip(helds, part.wrench.T, strict=True)]
    clipped = tuple(map(limits, axes))
    ends = [
        (low == axis.low) * axis.low_count + (high == axis.high) * axis.high_count
        for (low, high), axis in zip(clipped, axes, strict=True)
    ]
    stills = tuple(
        tuple(still for still in stuck(held) if still.value not in axis)
        for held, axis in zip(helds, clipped, strict=True)
    )
    return Facts(first_q, np.concatenate(stamps), measured, clipped, np.array(ends), stills)


def _counted(counts: Sequence[int]) -> str:
    return ", ".join(f"{count} of {axis}" for axis, count in zip(AXES, counts, strict=True) if count)


def _slices(log: Log) -> Split:
    def split(size: int) -> Iterator[Log]:
        for first in range(0, len(log.t), size):
            t, q, dq, wrench, temperature = (x[first : first + size] for x in log[:5])
            yield Log(t, q, dq, wrench, temperature, log.start)

    return split


def _open_npz(file: str, setup: Setup) -> tuple[int, float, Split] | None:
    """Length, start and parts of a long NPZ file with one clock; None for any other."""
    stored = stored_arrays(file, {*ARRAYS})
    names = [name for name in ("q", "dq", "wrench", "temperature") if name in stored]
    one_clock = {"t", "q", "wrench"} <= stored.keys() and not {"t_joints", "t_wrench"} & stored.keys()
    if not one_clock or stored["t"].shape < (LONG,):
        return None
    t, start = relative_seconds(next(stored["t"].parts(stored["t"].shape[0])), file=file)
    for name in names:
        if stored[name].shape[:1] != t.shape:
            message = f"has shape {stored[name].shape} for {len(t)} stamps"
            raise LogError(message, file=file, field=name, remedy="give one sample per stamp")

    def split(size: int) -> Iterator[Log]:
        columns = zip(*(stored[name].parts(size) for name in names), strict=True)
        for first, values in zip(range(0, len(t), size), columns, strict=True):
            part = dict(zip(names, values, strict=True))
            stamps = t[first : first + size]
            dq = part["dq"] if "dq" in part else np.full(part["q"].shape, np.nan)
            temperature = part["temperature"] if "temperature" in part else np.full(len(stamps), np.nan)
            log = Log(stamps, part["q"], dq, part["wrench"], temperature, start)
            yield check_samples(log, setup, file=file, first=first)

    return len(t), start, split
