"""Samples that no sensor in order reports: of axes that stand still, or are at an end of their range.

A log may come in parts, and is then cleaned as if it were whole.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.health import Extremes, Held, Saturation, Still, extend, hold, limits, mask, stuck
from ftbias_jax.io.log import Log, Repair, Repairs
from ftbias_jax.io.rates.held import Repeats, extend_repeats, held_readings
from ftbias_jax.types import AXES, Array

PART = 1 << 16
"""Samples looked at together."""
LISTED = 3
"""Stretches of one axis that are told one by one."""

Split = Callable[[int], Iterator[Log]]
"""Samples at once -> the log from its first sample on."""


class HeldStream(NamedTuple):
    """The samples of a stream that repeat a reading that was taken before; see ``rates.held``."""

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


def clean(log: Log, *, clipped: bool = True, stuck: bool = True, held: bool = True, file: str = "") -> Log:
    """The log without samples of clipped and stuck axes and repeats; ``repairs`` names them, left out or not.

    Args:
        log: as recorded, or as this function made it.
        clipped: leave out samples at the end of the sensor's range.
        stuck: leave out samples of axes that stand still.
        held: leave out samples that repeat a reading which is held until there is a new one.
        file: the name in messages.

    Raises:
        LogError: nothing of the wrench would be left.
    """
    facts = survey(slices(log))
    known = findings(facts, clipped=False, stuck=False, held=False)
    repairs = (*(repair for repair in log.repairs if repair not in known), *findings(facts, clipped, stuck, held))
    check_rest(facts, clipped, stuck, file)
    log = without_repeats(log, facts) if held else log
    return log._replace(wrench=cleaned_wrench(log, facts, clipped, stuck), repairs=repairs)


def without_repeats(log: Log, facts: Facts) -> Log:
    """A log, or a part of it, in which samples that repeat a held reading are not measured."""
    wrench = np.isin(log.t, facts.held_wrench.t, assume_unique=True)
    joints = np.isin(log.t, facts.held_joints.t, assume_unique=True)
    if wrench.any():
        log = log._replace(wrench=np.where(wrench[:, None], np.nan, log.wrench))
    if joints.any():
        q, dq = (np.where(joints[:, None], np.nan, x) for x in (log.q, log.dq))
        log = log._replace(q=q, dq=dq)
    return log


def cleaned_wrench(log: Log, facts: Facts, clipped: bool = True, stuck: bool = True) -> Array:
    """The wrench (T, 6) of a log or of a part of it, NaN where it is to be left out; see ``clean``."""
    if not ((clipped and facts.clipped_count.any()) or (stuck and facts.stuck_count.any())):
        return log.wrench
    nowhere = (Saturation(np.nan, np.nan),) * 6
    return mask(log.t, log.wrench, facts.clipped if clipped else nowhere, facts.stuck if stuck else ((),) * 6)


def findings(facts: Facts, clipped: bool = True, stuck: bool = True, held: bool = True) -> Repairs:
    """What is wrong with the axes of the wrench and with the rates, one line a fault; see ``clean``."""
    found = []
    for name, stream in (("wrench", facts.held_wrench), ("joints", facts.held_joints)):
        if len(stream.t):
            what = f"the {name} is held" if name == "wrench" else f"the {name} are held"
            used = ": each reading is used once" if held else ""
            found.append(
                Repair(f"{what} for up to {stream.samples} samples, {len(stream.t)} of {stream.of} repeat{used}")
            )
    if facts.clipped_count.any():
        what = "samples at the end of the sensor's range" + (" left out" if clipped else "")
        found.append(Repair(f"{what}: {_counted(facts.clipped_count)}", lost=clipped))
    for axis, stretches, count in zip(AXES, facts.stuck, facts.stuck_count, strict=True):
        if stretches:
            what = f"{axis} stands still {_spans(stretches)}: {count} samples" + (" left out" if stuck else "")
            found.append(Repair(what, lost=stuck))
    if not facts.measured.all():
        never = [axis for axis, count in zip(AXES, facts.measured, strict=True) if not count]
        found.append(Repair(f"never measured: {' '.join(never)}", lost=True))
    return tuple(found)


def check_rest(facts: Facts, clipped: bool, stuck: bool, file: str = "") -> None:
    """Refuse a log of whose wrench nothing is left.

    Raises:
        LogError: no axis has a sample left.
    """
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
    if not len(facts.held_wrench.t) and not len(facts.held_joints.t):
        return facts

    def once(size: int) -> Iterator[Log]:
        return (without_repeats(part, facts) for part in split(size))

    return _survey(once)._replace(held_wrench=facts.held_wrench, held_joints=facts.held_joints)


def _survey(split: Split) -> Facts:
    axes, helds, stamps = [Extremes()] * 6, [Held()] * 6, []
    first_q: Array = np.nan
    wrenches, joints, joint_stamps = Repeats(), Repeats(), []
    for part in split(PART):
        seen = ~np.isnan(part.q)
        first = np.where(seen.any(0), np.take_along_axis(part.q, seen.argmax(0)[None], 0)[0], np.nan)
        first_q = np.where(np.isnan(first_q), first, first_q)
        stamps.append(part.t[~np.isnan(part.wrench).all(1)])
        joint_stamps.append(part.t[seen.any(1)])
        wrenches, joints = extend_repeats(wrenches, part.wrench), extend_repeats(joints, part.q)
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
    held_wrench = _held_stream(wrenches, np.concatenate(stamps))
    held_joints = _held_stream(joints, np.concatenate(joint_stamps))
    wrench_t = np.concatenate(stamps)
    return Facts(
        *(first_q, wrench_t, measured, clipped, np.array(ends), stills, np.array(counts)), held_wrench, held_joints
    )


def _held_stream(seen: Repeats, t: Array) -> HeldStream:
    """Where a stream, measured at t (W,) s, repeats itself."""
    found = held_readings(seen)
    return NOT_HELD if found is None else HeldStream(found.samples, len(t), t[found.repeats])


def slices(log: Log) -> Split:
    """The parts of a log that is in memory."""

    def split(size: int) -> Iterator[Log]:
        for first in range(0, len(log.t), size):
            t, q, dq, wrench, temperature = (x[first : first + size] for x in log[:5])
            yield Log(t, q, dq, wrench, temperature, log.start, columns=log.columns)

    return split


def _counted(counts: Sequence[int]) -> str:
    return ", ".join(f"{count} of {axis}" for axis, count in zip(AXES, counts, strict=True) if count)


def _spans(stretches: Sequence[Still]) -> str:
    words = [f"from {still.first:.1f} s to {still.last:.1f} s" for still in stretches]
    more = len(words) - LISTED
    return " and ".join([*words[:LISTED], f"{more} more times"] if more > 0 else words)
