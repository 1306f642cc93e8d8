"""Samples that no sensor in order reports: of axes that stand still, or are at an end of their range.

A log may come in parts, and is then cleaned as if it were whole.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.clock import LONG_PAUSE
from ftbias_jax.io.health import Extremes, Held, Saturation, Still, extend, hold, limits, mask, stuck
from ftbias_jax.io.log import Log, Repair, Repairs
from ftbias_jax.io.rates import LISTED, Repeats, extend_repeats, held_readings, missing_readings
from ftbias_jax.types import AXES, Array

PART = 1 << 16
"""Samples looked at together."""
CLEANED = ("left out", "is used once")  # ends of lines

Split = Callable[[int], Iterator[Log]]
"""Samples at once -> the log from its first sample on."""


class HeldStream(NamedTuple):
    """The samples of a stream that repeat a reading taken before (``rates.held``)."""

    samples: int = 1
    """For how many samples one reading is held, at most."""
    of: int = 0
    """Samples of the whole stream."""
    t: Array = np.zeros(0)
    """(R,) s, stamps of the repeats."""


NOT_HELD = HeldStream()


class Facts(NamedTuple):
    """What must be known of a whole log."""

    first_q: Array
    """(n,) rad, first measured position of every joint; NaN = never."""
    wrench_t: Array
    """(W,) s, stamps at which any axis of the wrench was measured."""
    measured: Array
    """(6,) samples of each axis."""
    clipped: tuple[Saturation, ...]
    """Of every axis."""
    clipped_count: Array
    """(6,) samples on those limits."""
    stuck: tuple[tuple[Still, ...], ...]
    """Of every axis, when it stood still for too long."""
    stuck_count: Array
    """(6,) samples of those stretches."""
    held_wrench: HeldStream = NOT_HELD
    """Readings that the sensor published more than once."""
    held_joints: HeldStream = NOT_HELD
    held_rates: HeldStream = NOT_HELD
    """Of the joints' velocities, or what an IMU says, which may have a clock of their own."""
    missing: Repairs = ()
    """Readings of the wrench or the joints that are missing while the others go on."""


def clean(log: Log, *, clipped: bool = True, stuck: bool = True, held: bool = True, file: str = "") -> Log:
    """The log without samples of clipped and stuck axes and repeats; ``repairs`` names them, left out or not."""
    return cleaned(log, survey(slices(log)), clipped=clipped, stuck=stuck, held=held, file=file)


def cleaned(
    log: Log, facts: Facts, *, clipped: bool = True, stuck: bool = True, held: bool = True, file: str = ""
) -> Log:
    """The same of a log of which is known what must be; ``facts``: by ``survey``."""
    if any(repair.what.endswith(CLEANED) for repair in log.repairs):
        facts = facts._replace(missing=())  # what is, was taken out here
    known = findings(facts, clipped=False, stuck=False, held=False)
    repairs = (*(repair for repair in log.repairs if repair not in known), *findings(facts, clipped, stuck, held))
    check_rest(facts, clipped, stuck, file)
    log = without_repeats(log, facts) if held else log
    return log._replace(wrench=cleaned_wrench(log, facts, clipped, stuck), repairs=repairs)


def without_repeats(log: Log, facts: Facts) -> Log:
    """A log, or a part of it, in which samples that repeat a held reading are not measured."""
    return log._replace(
        wrench=_without(facts.held_wrench, log.t, log.wrench),
        q=_without(facts.held_joints, log.t, log.q),
        dq=_without(facts.held_rates, log.t, log.dq),
    )


def _without(stream: HeldStream, t: Array, values: Array) -> Array:
    """The samples (T, k) at t (T,) s of a stream, NaN where they repeat."""
    repeats = np.isin(t, stream.t, assume_unique=True)
    return np.where(repeats[:, None], np.nan, values) if repeats.any() else values


def cleaned_wrench(log: Log, facts: Facts, clipped: bool = True, stuck: bool = True) -> Array:
    """The wrench (T, 6) of a log or of a part of it, NaN where it is to be left out; see ``clean``."""
    if not ((clipped and facts.clipped_count.any()) or (stuck and facts.stuck_count.any())):
        return log.wrench
    nowhere = (Saturation(np.nan, np.nan),) * 6
    return mask(log.t, log.wrench, facts.clipped if clipped else nowhere, facts.stuck if stuck else ((),) * 6)


def findings(facts: Facts, clipped: bool = True, stuck: bool = True, held: bool = True) -> Repairs:
    """What is wrong with the axes of the wrench and with the rates, one line a fault; see ``clean``."""
    found = []
    streams = {
        "the wrench is": facts.held_wrench,
        "the joints are": facts.held_joints,
        "the velocities are": facts.held_rates,
    }
    for which, stream in streams.items():
        if len(stream.t):
            used = ": each reading is used once" if held else ""
            repeats = f"{len(stream.t)} of {stream.of} repeat{used}"
            found.append(Repair(f"{which} held for up to {stream.samples} samples, {repeats}"))
    if facts.clipped_count.any():
        what = "samples at the end of the sensor's range" + (" left out" if clipped else "")
        counts = ", ".join(f"{count} of {axis}" for axis, count in zip(AXES, facts.clipped_count, strict=True) if count)
        found.append(Repair(f"{what}: {counts}", lost=clipped))
    for axis, stretches, count in zip(AXES, facts.stuck, facts.stuck_count, strict=True):
        if stretches:
            what = f"{axis} stands still {_spans(stretches)}: {count} samples" + (" left out" if stuck else "")
            found.append(Repair(what, lost=stuck))
    if not facts.measured.all():
        never = [axis for axis, count in zip(AXES, facts.measured, strict=True) if not count]
        found.append(Repair(f"never measured: {' '.join(never)}", lost=True))
    return (*found, *facts.missing)


def check_rest(facts: Facts, clipped: bool, stuck: bool, file: str = "") -> None:
    """Refuse a log of whose wrench nothing is left."""
    if not facts.measured.any():
        remedy = "record the sensor's wrench"
        raise LogError("no wrench data: all values are NaN", file=file, field="wrench", remedy=remedy)
    left = facts.measured - clipped * facts.clipped_count - stuck * facts.stuck_count
    if not left.any():
        message = "no wrench data: every axis stands still, or is at the end of the sensor's range"
        raise LogError(message, file=file, field="wrench", remedy="check the sensor and its driver, and record again")


def survey(split: Split) -> Facts:
    """Read a log for what must be known of all of it: once, and again if readings are held."""
    facts = _survey(split)
    if not any(len(stream.t) for stream in (facts.held_wrench, facts.held_joints, facts.held_rates)):
        return facts

    def once(size: int) -> Iterator[Log]:
        return (without_repeats(part, facts) for part in split(size))

    again = _survey(once)
    return facts._replace(**{name: getattr(again, name) for name in Facts._fields[:7]})


def _survey(split: Split) -> Facts:
    axes, helds, stamps = [Extremes()] * 6, [Held()] * 6, []
    first_q: Array = np.nan
    repeats, joint_t, rate_t = [Repeats()] * 3, [], []
    for part in split(PART):
        seen = ~np.isnan(part.q)
        first = np.where(seen.any(0), np.take_along_axis(part.q, seen.argmax(0)[None], 0)[0], np.nan)
        first_q = np.where(np.isnan(first_q), first, first_q)
        stamps.append(part.t[~np.isnan(part.wrench).all(1)])
        joint_t.append(part.t[seen.any(1)])
        rate_t.append(part.t[~np.isnan(part.dq).all(1)])
        readings = (part.wrench, part.q, part.dq)
        repeats = [extend_repeats(one, values) for one, values in zip(repeats, readings, strict=True)]
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
    counts = [sum(still.samples for still in stretches) for stretches in stills]
    measured = np.array([held.samples for held in helds])
    every_t = [np.concatenate(kept) for kept in (stamps, joint_t, rate_t)]
    wrench, joints, rates = (_held_stream(one, t) for one, t in zip(repeats, every_t, strict=True))
    of_joints = missing_readings("the joints are", every_t[1], every_t[0])  # that they are slower is usual
    missing = *missing_readings("the wrench is", *every_t[:2]), *(one for one in of_joints if one.lost)
    return Facts(
        first_q, every_t[0], measured, clipped, np.array(ends), stills, np.array(counts), wrench, joints, rates, missing
    )


def _held_stream(seen: Repeats, t: Array) -> HeldStream:
    """Where a stream, measured at t (W,) s, repeats itself."""
    found = held_readings(seen)
    return NOT_HELD if found is None else HeldStream(found.samples, len(t), t[found.repeats])


def slices(*logs: Log) -> Split:
    """The parts of logs that are in memory, one log after the other."""

    def split(size: int) -> Iterator[Log]:
        for log in logs:
            for first in range(0, len(log.t), size):
                t, q, dq, wrench, temperature = (x[first : first + size] for x in log[:5])
                yield Log(t, q, dq, wrench, temperature, log.start, columns=log.columns, rezeroed_at=log.rezeroed_at)

    return split


def _spans(stretches: Sequence[Still]) -> str:
    words = [f"from {still.first:.1f} s to {still.last:.1f} s" for still in stretches]
    more = len(words) - LISTED
    return " and ".join([*words[:LISTED], f"{more} more times"] if more > 0 else words)


def without_long_pauses(log: Log) -> Log:
    """The log with every pause, or jump of its clock forward, no longer than LONG_PAUSE, for what judges it."""
    steps = np.diff(log.t, prepend=log.t[:1])
    if not (steps > LONG_PAUSE).any():
        return log
    t = np.cumsum(np.minimum(steps, LONG_PAUSE)) + log.t[0]
    columns = {name: column._replace(t=np.interp(column.t, log.t, t)) for name, column in log.columns.items()}
    rezeroed_at = tuple(float(at) for at in np.interp(log.rezeroed_at, log.t, t))
    return log._replace(t=t, columns=columns, rezeroed_at=rezeroed_at)
