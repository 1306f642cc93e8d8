"""Removal of faulty samples: of stuck and saturated wrench axes, of repeated readings, and of joints that jump.

A log may come in parts, and is then cleaned as if it were whole.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.glitches import Glitches, find_glitches
from ftbias_jax.io.health import Axis, Saturation, Still, extend, mask
from ftbias_jax.io.log import Log, Repair, Repairs
from ftbias_jax.io.rates import LISTED, Held, Repeats, extend_repeats, held_readings, missing_readings
from ftbias_jax.io.stamps.clock import LONG_PAUSE
from ftbias_jax.types import AXES, Array

PART = 1 << 16
"""Number of samples that are examined together."""
STREAMS = {"wrench": "the wrench is", "q": "the joints are", "dq": "the velocities are"}
"""Array of a log -> beginning of the report lines about it; dq may come from an IMU."""
ASIDE = 0.3
"""s left out on both sides of a jump from which the joints do not return, because no smooth motion leads across."""
MOST_ASIDE = 0.2
"""Maximum share of a log that is left out beside jumps; an arm with more of them may really move like that."""
CLEANED = ("left out", "is used once")  # ends of report lines

Split = Callable[[int], Iterator[Log]]
"""Samples per part -> the log in parts, from its first sample on."""


class Facts(NamedTuple):
    """Facts about a whole log that are needed to clean any part of it."""

    first_q: Array
    """(n,) rad, first measured position of every joint; NaN = never."""
    wrench_t: Array
    """(W,) s, stamps at which any axis of the wrench was measured."""
    axes: tuple[Axis, ...]
    """How often each axis of the wrench was measured, and where it is clipped or stuck."""
    held: Mapping[str, tuple[Held, Array]] = MappingProxyType({})
    """Array of the log with held readings -> how they are held, and (R,) s, the stamps of the repeats; joints and rates
    may have different clocks."""
    glitches: Glitches = Glitches()
    """Single invalid readings of the joints."""
    missing: Repairs = ()
    """Readings of the wrench or the joints that are missing while the other stream continues."""


def clean(
    log: Log,
    facts: Facts | None = None,
    *,
    clipped: bool = True,
    stuck: bool = True,
    held: Collection[str] = STREAMS,
    file: str = "",
) -> Log:
    """Remove samples of clipped and stuck axes, repeats and jumps; ``repairs`` lists them whether removed or not.

    ``facts`` are those of the whole log, from ``survey``; None = not surveyed yet. ``held`` are the arrays of the log
    from which repeats and glitches are removed.
    """
    facts = facts or survey(slices(log))
    if any(repair.what.endswith(CLEANED) for repair in log.repairs):
        facts = facts._replace(missing=())  # missing samples were removed by an earlier cleaning
    known = findings(facts, clipped=False, stuck=False, held=())
    repairs = (*(repair for repair in log.repairs if repair not in known), *findings(facts, clipped, stuck, held))
    check_rest(facts, clipped, stuck, file)
    return leave_out(log, facts, clipped, stuck, held)._replace(repairs=repairs)


def leave_out(log: Log, facts: Facts, clipped: bool = True, stuck: bool = True, held: Collection[str] = STREAMS) -> Log:
    """Set samples of clipped and stuck axes, repeats and jumps of a log, or of a part of it, to NaN."""
    columns: dict[str, Any] = {}
    repeats, joints, speeds, breaks = facts.glitches
    of_joints = [("q", repeats), ("q", joints), ("dq", repeats), ("dq", joints), ("dq", speeds)]
    for name, t in (*((name, t) for name, (_, t) in facts.held.items()), *of_joints):
        if name in held and len(t):
            out = np.isin(log.t, t, assume_unique=True)
            columns[name] = np.where(out[:, None], np.nan, columns.get(name, getattr(log, name)))
    if "q" in held and len(breaks):
        out = np.searchsorted(breaks, log.t - ASIDE, "right") < np.searchsorted(breaks, log.t + ASIDE)
        for name in STREAMS:
            columns[name] = np.where(out[:, None], np.nan, columns.get(name, getattr(log, name)))
    log = log._replace(**columns)
    ends = [axis.limits if clipped and axis.clipped else Saturation(np.nan, np.nan) for axis in facts.axes]
    stretches = [axis.stuck if stuck else () for axis in facts.axes]
    if np.isnan(ends).all() and not any(stretches):
        return log
    return log._replace(wrench=mask(log.t, log.wrench, ends, stretches))


def findings(facts: Facts, clipped: bool = True, stuck: bool = True, held: Collection[str] = STREAMS) -> Repairs:
    """Faults of the wrench axes, the joint readings and the rates, one line per fault; see ``clean``."""
    found = []
    for name, (stream, t) in facts.held.items():
        used = ": each reading is used once" if name in held else ""
        what = f"held for up to {stream.samples} samples, {len(t)} of {len(stream.repeats)} repeat{used}"
        found.append(Repair(f"{STREAMS[name]} {what}"))
    repeats, joints, speeds, breaks = facts.glitches
    out = " left out" if "q" in held else ""
    if len(repeats):
        what = f"{STREAMS['q']} stale now and then while they move: {len(repeats)}{out}"
        found.append(Repair(what))
    for name, t in (("q", joints), ("dq", speeds)):
        if len(t):
            what = f"{STREAMS[name]} implausible, {_times(t)}: {len(t)} readings{out}"
            found.append(Repair(what, lost=bool(out)))
    if len(breaks):
        what = f"the joint positions are discontinuous {_times(breaks)}: samples are missing there"
        about = f", and those {ASIDE:g} s before and after are left out" if out else ""
        found.append(Repair(what + about, lost=bool(out)))
    axes = dict(zip(AXES, facts.axes, strict=True))
    if any(axis.clipped for axis in facts.axes):
        what = "samples at the end of the sensor's range" + (" left out" if clipped else "")
        counts = ", ".join(f"{axis.clipped} of {name}" for name, axis in axes.items() if axis.clipped)
        found.append(Repair(f"{what}: {counts}", lost=clipped))
    for name, axis in axes.items():
        if axis.stuck:
            count = sum(still.samples for still in axis.stuck)
            what = f"{name} stands still {_spans(axis.stuck)}: {count} samples" + (" left out" if stuck else "")
            found.append(Repair(what, lost=stuck))
    if never := [name for name, axis in axes.items() if not axis.samples]:
        found.append(Repair(f"never measured: {' '.join(never)}", lost=True))
    return (*found, *facts.missing)


def check_rest(facts: Facts, clipped: bool, stuck: bool, file: str = "") -> None:
    """Refuse a log whose wrench has no usable sample."""
    if not any(axis.samples for axis in facts.axes):
        remedy = "record the sensor's wrench"
        raise LogError("no wrench data: all values are NaN", file=file, field="wrench", remedy=remedy)
    out = [axis.clipped * clipped + sum(still.samples for still in axis.stuck) * stuck for axis in facts.axes]
    if out == [axis.samples for axis in facts.axes]:
        message = "no wrench data: every axis stands still, or is at the end of the sensor's range"
        raise LogError(message, file=file, field="wrench", remedy="check the sensor and its driver, and record again")


def survey(split: Split) -> Facts:
    """Collect the facts about a whole log in one pass, or in two if readings are held."""
    facts = _survey(split)
    if not facts.held:
        return facts
    held = facts._replace(glitches=Glitches())

    def once(size: int) -> Iterator[Log]:
        return (leave_out(part, held, clipped=False, stuck=False) for part in split(size))

    return _survey(once, "q" in facts.held)._replace(held=facts.held, missing=facts.missing)


def _survey(split: Split, joints_once: bool = False) -> Facts:
    """Collect the facts in one pass; with ``joints_once``, repeats of the joints were removed before."""
    axes = [Axis()] * 6
    repeats, stamps = dict.fromkeys(STREAMS, Repeats()), {name: [np.zeros(0)] for name in STREAMS}
    first_q: Array = np.nan
    found = [Glitches()]
    for part in split(PART):
        found.append(find_glitches(part.t, part.q, part.dq, repeats=not joints_once))
        seen = ~np.isnan(part.q)
        first = np.where(seen.any(0), np.take_along_axis(part.q, seen.argmax(0)[None], 0)[0], np.nan)
        first_q = np.where(np.isnan(first_q), first, first_q)
        for name in STREAMS:
            values = getattr(part, name)
            stamps[name].append(part.t[~np.isnan(values).all(1)])
            repeats[name] = extend_repeats(repeats[name], values)
        axes = [extend(axis, part.t, values) for axis, values in zip(axes, part.wrench.T, strict=True)]
    every_t = {name: np.concatenate(kept) for name, kept in stamps.items()}
    helds = {}
    for name, t in every_t.items():
        held = held_readings(repeats[name])
        if held is not None and held.repeats.any():
            helds[name] = held, t[held.repeats]
    wrench_t, joint_t = every_t["wrench"], every_t["q"]
    of_joints = missing_readings(STREAMS["q"], joint_t, wrench_t)  # slower joints are usual
    missing = *missing_readings(STREAMS["wrench"], wrench_t, joint_t), *(one for one in of_joints if one.lost)
    glitches = Glitches(*map(np.concatenate, zip(*found, strict=True)))
    if len(glitches.breaks) * 2 * ASIDE > MOST_ASIDE * np.ptp(wrench_t if len(wrench_t) else np.zeros(1)):
        # An arm that jumps all the time may really move like that.
        glitches = glitches._replace(breaks=np.zeros(0))
    return Facts(first_q, wrench_t, tuple(axes), helds, glitches, missing)


def slices(*logs: Log) -> Split:
    """Split logs in memory into parts, one log after the other."""

    def split(size: int) -> Iterator[Log]:
        for log in logs:
            for first in range(0, len(log.t), size):
                t, q, dq, wrench, temperature = (x[first : first + size] for x in log[:5])
                yield Log(t, q, dq, wrench, temperature, log.start, columns=log.columns, rezeroed_at=log.rezeroed_at)

    return split


def _times(t: Array) -> str:
    """Text with the first LISTED of (N,) times in s."""
    more = f" and {len(t) - LISTED} times more" if len(t) > LISTED else ""
    return f"at {', '.join(f'{at:.1f}' for at in t[:LISTED])} s{more}"


def _spans(stretches: Sequence[Still]) -> str:
    words = [f"from {still.first:.1f} s to {still.last:.1f} s" for still in stretches]
    more = len(words) - LISTED
    return " and ".join([*words[:LISTED], f"{more} more times"] if more > 0 else words)


def without_long_pauses(log: Log) -> Log:
    """Shorten every pause, or forward jump of the clock, of a log to LONG_PAUSE, for functions that judge it."""
    steps = np.diff(log.t, prepend=log.t[:1])
    if not (steps > LONG_PAUSE).any():
        return log
    t = np.cumsum(np.minimum(steps, LONG_PAUSE)) + log.t[0]
    columns = {name: column._replace(t=np.interp(column.t, log.t, t)) for name, column in log.columns.items()}
    rezeroed_at = tuple(float(at) for at in np.interp(log.rezeroed_at, log.t, t))
    return log._replace(t=t, columns=columns, rezeroed_at=rezeroed_at)
