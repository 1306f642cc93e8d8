"""Stamps of recorded streams: which clock to trust, and order where it is a little wrong."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.log import Repair, Repairs
from ftbias_jax.setup.recorded import TIME_UNITS, LogSetup
from ftbias_jax.types import Array

SECOND = 10**9
JUMP = SECOND // 10
"""ns: a stamp this far behind the one before means that the clock was set back; less, that it came late."""
ASTRAY = 1e11
"""s, three thousand years: no clock has such stamps, in whatever unit they are taken for s by mistake but ns."""
LONG_PAUSE = 3600.0
"""s: what judges a log counts a longer pause, or a jump of its clock, as this long. Its cost must not grow with it."""
PAUSE = SECOND
"""ns, between what was recorded before and after the clock was set back: the true pause is not known."""
PIECES, LEAST_SAMPLES = 20, 200
"""Of a recording, in each of which the message that waited least counts; and samples that tell a clock's rate."""
MOST_RATE = 2e4
"""ppm; no clock is so fast, but one stream was recorded for longer."""
TOGETHER = 5.0
"""Intervals between samples within which streams begin that were recorded together."""
EXACT = 2**53
"""Integers up to here are exact as floating-point numbers."""


def complaint_of_headers(stamps: Sequence[Array], logged: Sequence[Array]) -> str:
    """Why the headers' stamps are not to be used, but the times at which messages were logged; "" if they are.

    Both are (T,) int64 ns for each stream, in the order in which the messages were stored; 0 = not set.
    """
    if any(np.mean(times == 0) > 0.5 for times in stamps):
        return "the headers have no stamps"
    if not _overlap(stamps) and _overlap(logged):
        return "the headers' stamps are of different clocks"
    if any(len(jumps(times[times != 0])) for times in stamps) and not any(len(jumps(times)) for times in logged):
        return "the headers' clock jumps back"
    return ""


def jumps(t: Array) -> Array:
    """Indices of the (T,) stamps in ns before which the clock was set back."""
    return np.flatnonzero(t[1:] <= t[:-1] - JUMP) + 1


def continue_after_jumps(streams: Sequence[Array], file: str = "") -> tuple[tuple[Array, ...], int]:
    """Stamps that go on PAUSE after the clock was set back, and how often it was; segments stay together.

    The stamps of each stream are (T,) int64 ns, in the order in which they were stored.

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


def as_stamps(t: Array, *, file: str = "", field: str = "t") -> Array:
    """The stamps, (T,) or a column (T, 1), as (T,) float64 (s) or int64 (ns), in the order in which they are."""
    t = np.asarray(t)
    t = t[:, 0] if t.shape[1:] == (1,) else t
    if t.ndim != 1 or t.dtype.kind not in "fiu":
        message = f"has shape {t.shape} and type {t.dtype}"
        raise LogError(message, file=file, field=field, remedy="time is one list of numbers: s, or ns if integer")
    t = t.astype(np.float64 if t.dtype.kind == "f" else np.int64)
    bad = np.flatnonzero(~np.isfinite(t))
    if bad.size:
        message = f"NaN time: {field}[{bad[0]}] is {t[bad[0]]}"
        raise LogError(message, file=file, field=field, remedy="give every sample a finite stamp")
    return t


def stamps_of(t: Array, log: LogSetup) -> Array:
    """(T,) stamps as floating point in s or integers in ns, from the unit that the setup states.

    Whole numbers of a small unit, such as microseconds since 1970, become integers: no float holds their nanoseconds.
    """
    t = np.asarray(t)
    if log.time_unit is None or t.dtype.kind not in "fiu":
        return t
    unit = TIME_UNITS[log.time_unit]
    if t.dtype.kind == "f":
        finite = t[np.isfinite(t)]
        whole = log.time_unit != "s" and len(finite) == len(t) and (finite == np.rint(finite)).all()
        if not whole or np.abs(finite).max(initial=0) > min(EXACT, 2**63 // unit):
            return t * (unit * 1e-9)
    return t.astype(np.int64) * unit


def seconds_of_a_unit(stamps: Array) -> float:
    """s that a unit of stamps (T,) stands for: integers that last for long are ns, all others s."""
    return 1e-9 if stamps.dtype.kind == "i" and len(stamps) and np.ptp(stamps) > 1e6 else 1.0


def on_right_clock(t: Array, log: LogSetup, quantity: str) -> Array:
    """(T,) stamps of one stream, s or integers in ns: the rate of its clock taken off, then its offset added.

    [log.clocks] states the rate of the wrench's clock, [log.time_offsets] the offset of each ``quantity``.
    """
    if quantity == "wrench" and log.wrench_rate and len(t):
        ahead = (t - t[0]) * (1e-6 * log.wrench_rate)
        t = t - (np.rint(ahead).astype(np.int64) if t.dtype.kind == "i" else ahead)
    seconds = log.time_offsets.get(quantity, 0.0)
    return t + (round(seconds * 1e9) if t.dtype.kind == "i" else seconds)


def rate_against(stamps: Array, logged: Array) -> tuple[float, float]:
    """ppm by which the clock of a stream's stamps runs fast against the recorder's, and the standard error.

    A message waits before it is logged, and never less than not at all: the rate is that of the shortest waits. Both
    are (T,) int64 ns of the same messages, the stamps increasing; if these are too few, it is 0 and the error infinite.
    """
    if len(stamps) < LEAST_SAMPLES or stamps[-1] <= stamps[0]:
        return 0.0, np.inf
    t, wait = (stamps - stamps[0]) * 1e-9, (logged - stamps - (logged[0] - stamps[0])) * 1e-9
    pieces = np.array_split(np.arange(len(t)), PIECES)
    least = np.array([piece[wait[piece].argmin()] for piece in pieces])
    (slope, _), spread = np.polyfit(t[least], wait[least], 1, cov=True)
    return float(-1e6 * slope), float(1e6 * np.sqrt(spread[0, 0]))


def longer_in_words(joints: Array, wrench: Array) -> str:
    """What the ends of streams that began together say of the clock of the wrench; "" = nothing.

    The stamps of joints (J,) and wrench (W,) are in s and increase.
    """
    if min(len(joints), len(wrench)) < 2:
        return ""
    interval = max(float(np.median(np.diff(t))) for t in (joints, wrench))
    begins, ends = wrench[0] - joints[0], wrench[-1] - joints[-1]
    rate, stderr = (1e6 * x / (joints[-1] - joints[0]) for x in (ends - begins, interval))
    if abs(begins) > TOGETHER * interval or abs(rate) < TOGETHER * stderr or abs(rate) > MOST_RATE:
        return ""
    return (
        f"ends {abs(ends):.3g} s {'after' if ends > 0 else 'before'} the joints, with which it begins: if both were "
        f"recorded for as long, state wrench_rate = {rate:.0f} ± {stderr:.0f} (ppm) in [log.clocks]"
    )


def rows_at_rate(values: Array, log: LogSetup) -> Array | None:
    """(T,) s of the samples (T, ...) that have a rate instead of stamps; None where the setup states none."""
    return None if log.rate is None else np.arange(len(np.atleast_1d(values))) / log.rate


def since(t: Array, start: float) -> Array:
    """(T,) s since a stamp in s, of stamps in s if floating point or ns if integer."""
    # Integers are subtracted as integers: nanoseconds since 1970 do not fit the 53 bits of a float.
    return (t - round(start * SECOND)) / SECOND if t.dtype.kind == "i" else t - start


class Ordered(NamedTuple):
    """Samples in the order of their stamps."""

    t: Array
    """(U,) float64 s or int64 ns, strictly increasing."""
    columns: Mapping[str, Array]
    """(U, ...) each."""
    repairs: Repairs
    """What that took."""


def put_in_order(
    t: Array, columns: Mapping[str, Array], samples: str = "samples", *, file: str = "", field: str = "t"
) -> Ordered:
    """Sort samples that came a little late, and make one of those that share a stamp, as ``tidy`` does.

    Stamps (T,) are floating point in s, or integers in ns; columns (T, ...) are real numbers, NaN = not measured.
    ``samples`` says in the repairs what they are, ``file`` and ``field`` in messages where the stamps come from.
    """
    t, columns, astray = _without_astray(as_stamps(t, file=file, field=field), columns, samples, file, field)
    if (t[1:] > t[:-1]).all():
        return Ordered(t, columns, astray)
    back = np.flatnonzero(t <= np.maximum.accumulate(t) - (JUMP if t.dtype.kind == "i" else JUMP / SECOND))
    if back.size:
        late = back[0]
        latest = int(np.argmax(t[:late]))
        message = f"time does not increase: {field}[{late}] = {t[late]} after {field}[{latest}] = {t[latest]}"
        remedy = "sort the samples, or cut the log where its clock was set back"
        raise LogError(message, file=file, field=field, remedy=remedy)
    ordered = tidy(t, {name: one_a_stamp(values, len(t), name, file) for name, values in columns.items()}, samples)
    return ordered._replace(repairs=(*astray, *ordered.repairs))


def _without_astray(
    t: Array, columns: Mapping[str, Array], samples: str, file: str, field: str
) -> tuple[Array, Mapping[str, Array], Repairs]:
    """The samples whose stamps a clock can have: no more than ASTRAY from the others."""
    if t.dtype.kind != "f" or not len(t):
        return t, columns, ()
    middle = float(np.partition(t, len(t) // 2)[len(t) // 2])  # a mean of two could overflow
    if abs(middle) > ASTRAY:
        message, remedy = f"the stamps are about {middle:.3g} s", "give s, or state log.time_unit in the setup"
        raise LogError(message, file=file, field=field, remedy=remedy)
    near = np.abs(t - middle) <= ASTRAY
    if near.all():
        return t, columns, ()
    kept = {
        name: values if np.ndim(values) == 0 or len(values) != len(t) else np.asarray(values)[near]
        for name, values in columns.items()
    }
    what = f"{(~near).sum()} of the {samples} left out: their stamps are centuries from the others"
    return t[near], kept, (Repair(what, lost=True),)


def tidy(t: Array, columns: Mapping[str, Array], samples: str = "samples") -> Ordered:
    """Sort samples (T, ...) by their stamps; those of one stamp become one, each number from the first that has it."""
    late = int((t[1:] < np.maximum.accumulate(t)[:-1]).sum()) if len(t) else 0
    unique, place = np.unique(t, return_inverse=True)
    if len(unique) == len(t) and not late:
        return Ordered(t, columns, ())
    merged, left_out = {}, np.zeros(len(t), bool)
    for name, values in columns.items():
        flat = values.reshape(len(t), -1)
        kept = np.full((len(unique), flat.shape[1]), np.nan)
        for k, column in enumerate(flat.T):
            here = np.flatnonzero(~np.isnan(column))
            places, first = np.unique(place[here], return_index=True)
            kept[places, k] = column[here[first]]
            left_out[np.delete(here, first)] = True
        merged[name] = kept.reshape(-1, *values.shape[1:])
    repeated = int(left_out.sum())
    repairs = [Repair(f"{late} of the {samples} came late: put in order")] if late else []
    if repeated:
        repairs.append(Repair(f"{repeated} of the {samples} left out: their stamps are repeated", lost=True))
    return Ordered(unique, merged, tuple(repairs))


def one_a_stamp(values: Array, stamps: int, field: str, file: str) -> Array:
    """The values (T, ...) as float64, if they are real numbers and as many as the stamps."""
    values = np.asarray(values)
    if values.ndim == 0 or len(values) != stamps or values.dtype.kind not in "fiu":
        message = f"has shape {values.shape} and type {values.dtype} for {stamps} stamps"
        raise LogError(message, file=file, field=field, remedy="give one sample of real numbers per stamp")
    return values.astype(np.float64)


def _overlap(streams: Sequence[Array]) -> bool:
    set_ = [t[t != 0] for t in streams]
    return all(len(t) for t in set_) and max(t.min() for t in set_) <= min(t.max() for t in set_)
