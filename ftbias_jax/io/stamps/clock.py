"""Stamps of recorded streams: choice of the clock, and sorting of samples that are slightly out of order."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.log import Repair, Repairs
from ftbias_jax.setup.recorded import TIME_UNITS, LogSetup
from ftbias_jax.types import Array

SECOND = 10**9
JUMP = SECOND // 10
"""ns: a stamp this far before the previous one means that the clock was set back; one less far before it is late."""
ASTRAY = 1e11
"""s, three thousand years: no clock has such stamps, even if their unit, other than ns, is taken for s by mistake."""
LONG_PAUSE = 3600.0
"""s: functions that judge a log limit pauses and clock jumps to this, so that their cost does not grow with them."""
PAUSE = SECOND
"""ns between the samples before and after the clock was set back, because the true pause is unknown."""
PIECES, LEAST_SAMPLES = 20, 200
"""Number of pieces of a recording, each contributing its message with the shortest delay; and minimum number of samples
from which a clock's rate is estimated."""
MOST_RATE = 2e4
"""ppm; no clock is off by more, so one stream was then recorded for longer."""
QUARTZ = 500.0
"""ppm; clocks of computers differ by less, a sensor that counts its own samples may be off by more."""
TOGETHER = 5.0
"""Sampling intervals within which streams begin if they were recorded together."""
ROUNDED = 0.05
"""Share of a sampling interval from which rounding of stamps is told."""
EXACT = 2**53
"""Integers up to here are exact as floating-point numbers."""


def complaint_of_headers(stamps: Sequence[Array], logged: Sequence[Array]) -> str:
    """Reason to use the times at which messages were logged instead of the headers' stamps; "" = no reason.

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
    """Stamps that continue PAUSE after each time the clock was set back, and the number of these times.

    The streams stay aligned within each segment. The stamps of each are (T,) int64 ns in stored order.

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
    """The stamps, (T,) or a column (T, 1), as (T,) float64 (s) or int64 (ns), in the given order."""
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

    Whole numbers of a small unit, such as microseconds since 1970, become integers: no float can hold them in ns.
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
    """Length in s of one unit of stamps (T,): integers that span more than 1e6 are in ns, all others in s."""
    return 1e-9 if stamps.dtype.kind == "i" and len(stamps) and np.ptp(stamps) > 1e6 else 1.0


def on_right_clock(t: Array, log: LogSetup, quantity: str) -> Array:
    """(T,) stamps of one stream, s or integers in ns, corrected for the rate and then the offset of its clock."""
    if quantity == "wrench" and log.wrench_rate and len(t):
        ahead = (t - t[0]) * (1e-6 * log.wrench_rate)
        t = t - (np.rint(ahead).astype(np.int64) if t.dtype.kind == "i" else ahead)
    seconds = log.time_offsets.get(quantity, 0.0)
    return t + (round(seconds * 1e9) if t.dtype.kind == "i" else seconds)


def rate_against(stamps: Array, logged: Array) -> tuple[float, float]:
    """Rate in ppm by which the clock of a stream's stamps runs fast against the recorder's, and its standard error.

    The delay until a message is logged is never negative, so the rate is fitted to the shortest delays. Both arguments
    are (T,) int64 ns of the same messages, the stamps increasing; if too few, the rate is 0, its error infinite.
    """
    if len(stamps) < LEAST_SAMPLES or stamps[-1] <= stamps[0]:
        return 0.0, np.inf
    t, wait = (stamps - stamps[0]) * 1e-9, (logged - stamps - (logged[0] - stamps[0])) * 1e-9
    pieces = np.array_split(np.arange(len(t)), PIECES)
    least = np.array([piece[wait[piece].argmin()] for piece in pieces])
    (slope, _), spread = np.polyfit(t[least], wait[least], 1, cov=True)
    return float(-1e6 * slope), float(1e6 * np.sqrt(spread[0, 0]))


def longer_in_words(joints: Array, wrench: Array) -> str:
    """What the different ends of streams that began together mean for the clock of the wrench; "" = nothing.

    The stamps of joints (J,) and wrench (W,) are in s and increase.
    """
    if min(len(joints), len(wrench)) < 2:
        return ""
    interval = max(float(np.median(np.diff(t))) for t in (joints, wrench))
    begins, ends = wrench[0] - joints[0], wrench[-1] - joints[-1]
    rate, stderr = (1e6 * x / (joints[-1] - joints[0]) for x in (ends - begins, interval))
    if abs(begins) > TOGETHER * interval or abs(rate) < TOGETHER * stderr or abs(rate) > MOST_RATE:
        return ""
    side = "after" if ends > 0 else "before"
    stopped = "it was stopped then, or, " if abs(rate) > QUARTZ else ""
    return (
        f"ends {abs(ends):.3g} s {side} the joints, with which it begins: {stopped}if both were recorded for as long, "
        f"state wrench_rate = {rate:.0f} ± {stderr:.0f} (ppm) in [log.clocks]"
    )


def rows_at_rate(values: Array, log: LogSetup) -> Array | None:
    """(T,) stamps in s of samples (T, ...) that have a rate instead of stamps; None if the setup states no rate."""
    return None if log.rate is None else np.arange(len(np.atleast_1d(values))) / log.rate


def since(t: Array, start: float) -> Array:
    """(T,) s since ``start``, a stamp in s, for stamps t (T,) in s if floating point or ns if integer."""
    # Integers are subtracted as integers: nanoseconds since 1970 do not fit the 53 bits of a float.
    return (t - round(start * SECOND)) / SECOND if t.dtype.kind == "i" else t - start


class Ordered(NamedTuple):
    """Samples sorted by stamp."""

    t: Array
    """(U,) float64 s or int64 ns, strictly increasing."""
    columns: Mapping[str, Array]
    """(U, ...) values by name."""
    repairs: Repairs
    """Repairs made in sorting."""


def put_in_order(
    t: Array, columns: Mapping[str, Array], samples: str = "samples", *, file: str = "", field: str = "t"
) -> Ordered:
    """Sort samples that arrived slightly late, and merge those that share a stamp, as ``tidy`` does.

    Stamps (T,) are floating point in s, or integers in ns; columns (T, ...) are real numbers, NaN = not measured.
    Repairs call the samples ``samples``; messages name ``file`` and ``field`` as the source of the stamps.
    """
    t, columns, astray = _without_astray(as_stamps(t, file=file, field=field), columns, samples, file, field)
    astray = (*astray, *_single_precision(t))
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


def _single_precision(t: Array) -> Repairs:
    """Remark on floating-point stamps (T,) in s that were stored in single precision, if they are rounded coarsely."""
    if t.dtype.kind != "f" or len(t) < 2 or (t != t.astype(np.float32)).any():
        return ()
    step, interval = float(np.spacing(np.float32(np.abs(t).max()))), float(np.ptp(t)) / (len(t) - 1)
    if step < ROUNDED * interval:
        return ()
    what = f"the stamps are single-precision numbers, rounded to {1e3 * step:.2g} ms"
    why = f"samples are {1e3 * interval:.2g} ms apart, and delays, jitter and lost samples may be that alone"
    return (Repair(f"{what}: {why}; store double precision, or seconds since the start", lost=True),)


def _without_astray(
    t: Array, columns: Mapping[str, Array], samples: str, file: str, field: str
) -> tuple[Array, Mapping[str, Array], Repairs]:
    """Drop samples whose stamps no clock can have: more than ASTRAY from the median."""
    if t.dtype.kind != "f" or not len(t):
        return t, columns, ()
    middle = float(np.partition(t, len(t) // 2)[len(t) // 2])  # the mean of the two middle ones could overflow
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
    """Sort samples (T, ...) by stamp and merge those of one stamp, taking each number from the first that has it."""
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
    """Values (T, ...) as float64, if they are real numbers and there is one sample per stamp."""
    values = np.asarray(values)
    if values.ndim == 0 or len(values) != stamps or values.dtype.kind not in "fiu":
        message = f"has shape {values.shape} and type {values.dtype} for {stamps} stamps"
        raise LogError(message, file=file, field=field, remedy="give one sample of real numbers per stamp")
    return values.astype(np.float64)


def _overlap(streams: Sequence[Array]) -> bool:
    set_ = [t[t != 0] for t in streams]
    return all(len(t) for t in set_) and max(t.min() for t in set_) <= min(t.max() for t in set_)
