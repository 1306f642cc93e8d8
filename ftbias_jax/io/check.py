"""Checks that every log must pass, whatever its format; the one place where signs and stamps are changed.

Streams with separate stamps are merged on one timeline, without interpolation.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.log import Column, Log, Repairs
from ftbias_jax.io.pose import in_sensor_axes, pose_entries
from ftbias_jax.io.stamps.clock import as_stamps, on_right_clock, one_a_stamp, put_in_order, since, tidy
from ftbias_jax.io.stamps.interpolated import readings_only
from ftbias_jax.io.stamps.steady import on_steady_clocks
from ftbias_jax.setup.recorded import FORCE_UNITS, LENGTH_UNITS, TORQUE_UNITS, LogSetup
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

LARGEST = 1e20
"""Largest magnitude of joints and wrenches in any unit; a larger value is an error, and its square is unusable."""
LOWEST_RATE, HIGHEST_RATE = 1.5, 5e4
"""Hz, plausible rates: 1000 Hz looks like 1 Hz if ms are taken for s, 50 Hz like 50 kHz if us are taken for ns."""
PACKET = 64
"""Number of readings that may arrive in one packet; the time between two of these does not show the rate."""
Part = tuple[Array, Mapping[str, Array]]
"""Stamps of a stream in order, float64 s or int64 ns, and its arrays by their names in ``Log``."""
EXTRA_PREFIX = "="
"""Prefix of an array that holds a further column for effects to use; the setup's name of the column follows."""
QUANTITIES = {"q": "position", "dq": "velocity", "wrench": "wrench", "temperature": "temperature"}
"""Array of a log -> its key in [log.time_offsets]."""


def check_log(
    t: Array,
    q: Array,
    wrench: Array,
    dq: Array | None = None,
    temperature: Array | None = None,
    *,
    setup: Setup,
    file: str = "",
    repairs: Repairs = (),
) -> Log:
    """Make a log that can be filtered from arrays as they were recorded.

    Args:
        t: (T,) stamps: floating point in s, or integers in ns; any origin.
        q: (T, n) rad.
        wrench: (T, 6) N, Nm, as the sensor reports it.
        dq: (T, n) rad/s, or None. With a sensor_pose, q and dq are ``pose`` and ``rates`` of ``pose_entries``.
        temperature: (T,) deg C, or None. NaN = not measured.
        setup: gives the joints and the sign convention of the sensor.
        file: file name for error messages.
        repairs: repairs made before this check.

    Returns:
        float64 arrays sorted by stamp (``put_in_order``): t relative to the first stamp (``start``), the wrench exerted
        on the tool, NaN for quantities that are None.
    """
    given = {"q": q, "dq": dq, "wrench": wrench, "temperature": temperature}
    recorded = {name: values for name, values in given.items() if values is not None}
    t, ordered, ordering = put_in_order(t, recorded, file=file)
    parts, restored = on_steady_clocks(t, ordered, file)
    columns = merge_parts(parts, file) if restored else dict(ordered)
    t = columns.pop("t", t)
    columns, shorter = readings_only(t, columns)
    ordering = (*ordering, *restored, *shorter)
    q, dq = columns["q"], columns.get("dq")
    t, start = relative_seconds(t, file=file)
    uncertain: Array = np.zeros(3)
    if setup.pose is not None:
        q, dq, uncertain, mended = pose_entries(q, dq, t, setup, file)
        ordering = (*ordering, *mended)
    nothing = np.full(np.shape(q), np.nan) if dq is None else dq
    unknown = columns.get("temperature", np.full(len(t), np.nan))
    log = Log(t, q, nothing, columns["wrench"], unknown, start, (*repairs, *ordering), acceleration_std=uncertain)
    log = in_sensor_axes(check_samples(log, setup, file=file), setup, file)
    check_content(~np.isnan(log.q).all(0), t[~np.isnan(log.wrench).all(1)], setup, file=file)
    return log


def check_samples(log: Log, setup: Setup, *, file: str = "", first: int = 0) -> Log:
    """Check recorded samples, or a part from sample ``first`` on; return float64 in SI units with the report's sign."""
    floats = {name: values.copy() for name, values in floats_of(log, setup, file=file, first=first).items()}
    if setup.pose is None:
        angle = np.pi / 180 if setup.log.angle_unit == "deg" else 1.0
        unit = np.where(setup.robot.revolute, angle, LENGTH_UNITS[setup.log.length_unit])
        if (unit != 1).any():
            floats |= {name: floats[name] * unit for name in ("q", "dq")}
    scale = np.repeat([FORCE_UNITS[setup.log.force_unit], TORQUE_UNITS[setup.log.torque_unit]], 3)
    with np.errstate(invalid="ignore"):  # a damaged file may have signalling NaNs
        floats["wrench"] = floats["wrench"] * (-scale if setup.sensor.reports == "wrench_on_sensor" else scale)
    rezeroed_at = tuple(float(at - log.start) for at in setup.sensor.rezeroed_at)
    return log._replace(**floats, rezeroed_at=rezeroed_at)


def floats_of(log: Log, setup: Setup, *, file: str = "", first: int = 0) -> dict[str, Array]:
    """The measured arrays of a log as float64, name -> array, checked to have one row per stamp and plausible numbers;
    messages count samples from ``first``."""
    length, n = len(log.t), len(setup.robot.joint_names)
    shapes = {"q": (length, n), "dq": (length, n), "wrench": (length, 6), "temperature": (length,)}
    return {name: _floats(getattr(log, name), shape, name, file, first) for name, shape in shapes.items()}


def check_content(joints: Array, wrench_t: Array, setup: Setup, *, file: str = "") -> None:
    """Refuse a log without motion or wrench, or with an implausible rate.

    ``joints`` (n,) states whether each was ever measured; ``wrench_t`` (W,) s are the stamps at which any axis was.
    """
    for name, measured in zip(setup.robot.joint_names, joints, strict=True):
        if not measured:
            remedy = "record its position, or correct the joints of the setup"
            raise LogError(f"no motion data: joint {name!r} is never measured", file=file, field="q", remedy=remedy)
    require_wrench(wrench_t, file=file)
    rate = 1 / np.median(np.diff(wrench_t)) if len(wrench_t) > 1 else LOWEST_RATE
    if rate > HIGHEST_RATE and len(wrench_t) > PACKET:
        rate = PACKET / np.median(wrench_t[PACKET:] - wrench_t[:-PACKET])
    if not LOWEST_RATE <= rate <= HIGHEST_RATE:
        message = f"the wrench has a rate of {rate:.4g} Hz, which is implausible"
        remedy = "give floating-point time in s, integer time in ns, or state log.time_unit in the setup"
        raise LogError(message, file=file, field="t", remedy=remedy)


def require_wrench(measured: Array, *, file: str = "") -> None:
    """Refuse a log of which no wrench was measured: an empty array, or one of NaN alone."""
    if np.isnan(measured).all():
        remedy = "record the sensor's wrench"
        raise LogError("no wrench data: all values are NaN", file=file, field="wrench", remedy=remedy)


def relative_seconds(t: Array, *, file: str = "") -> tuple[Array, float]:
    """(T,) s since the first of increasing stamps, s if floating point or ns if integer; and that stamp in s."""
    t = as_stamps(t, file=file)
    back = np.flatnonzero(t[1:] <= t[:-1])
    if back.size:
        i = back[0] + 1
        message = f"time does not increase: t[{i}] = {t[i]} after t[{i - 1}] = {t[i - 1]}"
        raise LogError(message, file=file, field="t", remedy="sort the samples and remove repeated stamps")
    if len(t) < 2:
        raise LogError(f"has {len(t)} samples", file=file, field="t", remedy="a log needs at least 2")
    # Integers are subtracted as integers: nanoseconds since 1970 do not fit the 53 bits of a float.
    unit = 1e-9 if t.dtype.kind == "i" else 1.0
    return (t - t[0]) * unit, float(t[0]) * unit


def _floats(values: Array, shape: tuple[int, ...], field: str, file: str, first: int) -> Array:
    """Values as float64, checked to have this shape; messages count samples from ``first``.

    Infinities and values beyond LARGEST are refused: NaN is merely skipped, but these would corrupt the result.
    """
    values = np.asarray(values)
    if values.dtype.kind not in "fiu":
        message = f"has type {values.dtype}"
        raise LogError(message, file=file, field=field, remedy="give real numbers, NaN where not measured")
    if values.shape != shape:
        words = "(samples, joints)" if field in ("q", "dq") else "samples first"
        message = f"has shape {values.shape}, expected {shape}"
        raise LogError(message, file=file, field=field, remedy=f"{words}; the setup has the number of joints")
    values = values.astype(np.float64, copy=False)
    with np.errstate(invalid="ignore"):  # a damaged file may have signalling NaNs
        beyond = np.argwhere(np.abs(values) > LARGEST)
    if beyond.size:
        place = (first + beyond[0][0], *beyond[0][1:])
        value = values[tuple(beyond[0])]
        what = "infinite" if np.isinf(value) else f"{value:.3g}, which nothing measures"
        message = f"{field}[{', '.join(map(str, place))}] is {what}"
        raise LogError(message, file=file, field=field, remedy="mark missing samples as NaN")
    return values


def log_of_parts(parts: Sequence[Part], setup: Setup, repairs: Repairs, file: str = "") -> Log:
    """Make a log of streams with separate stamps, all in s or all in ns: at least joints or a pose, and a wrench."""
    by_array = {name: t for t, arrays in reversed(parts) for name in arrays}
    check_overlap(by_array["q"], by_array["wrench"], file)
    merged = merge_parts(parts, file)
    t, q, wrench = merged.pop("t"), merged.pop("q"), merged.pop("wrench")
    return check_log(t, q, wrench, **merged, setup=setup, file=file, repairs=repairs)


def merge_parts(parts: Sequence[Part], file: str = "") -> dict[str, Array]:
    """Merge streams on one timeline: "t" and the arrays by their names, NaN where a stream has no sample.

    Samples share a row where their stamps are equal to the last bit. The first stream with an array provides it.
    """
    t = np.unique(np.concatenate([times for times, _ in parts]))
    merged = {"t": t}
    for times, arrays in parts:
        for name in arrays.keys() - merged.keys():
            values = one_a_stamp(arrays[name], len(times), name, file)
            merged[name] = np.full((len(t), *values.shape[1:]), np.nan)
            merged[name][np.searchsorted(t, times)] = values
    return merged


def on_one_clock(parts: Sequence[Part], log: LogSetup, file: str = "") -> list[Part]:
    """Correct the rate and offset of each stream's clock; the first array of a stream decides which ones apply."""
    if len({t.dtype.kind for t, _ in parts}) > 1:
        message = f"types {' and '.join(str(t.dtype) for t, _ in parts)} differ"
        raise LogError(message, file=file, field="t_joints, t_wrench", remedy="give both in s, or both in integer ns")
    owners = [QUANTITIES[next(iter(arrays))] for _, arrays in parts]
    if shared := sorted(log.time_offsets.keys() - set(owners)):
        field, remedy = f"log.time_offsets.{shared[0]}", f"state that of {' or '.join(owners)}"
        raise LogError("has no stamps of its own in this log", file=file, field=field, remedy=remedy)
    return [(on_right_clock(t, log, owner), arrays) for owner, (t, arrays) in zip(owners, parts, strict=True)]


def check_overlap(joint_t: Array, wrench_t: Array, file: str = "") -> None:
    """Refuse streams of different clocks, which do not overlap in time."""
    if not len(joint_t) or not len(wrench_t) or joint_t[-1] < wrench_t[0] or wrench_t[-1] < joint_t[0]:
        joints, wrench = (f"{t[0]} to {t[-1]}" if len(t) else "none" for t in (joint_t, wrench_t))
        message = f"the streams do not overlap in time: joints {joints}, wrench {wrench}"
        raise LogError(message, file=file, field="t_joints, t_wrench", remedy="stamp both with one clock")


def further_columns(parts: Sequence[Part], log: Log, setup: Setup, file: str = "") -> Log:
    """Add the further columns of streams to a log; a column that several streams have is taken from the first."""
    columns: dict[str, Column] = {}
    for t, arrays in parts:
        for name, values in arrays.items():
            key = name.removeprefix(EXTRA_PREFIX)
            if key not in (name, *columns):
                columns[key] = _column(t, values, log.start, file, str(setup.log.columns.get(key, key)))
    return log._replace(columns=columns)


def _column(stamps: Array, values: Array, start: float, file: str, field: str) -> Column:
    """Column of the measured ones of (T,) values, with stamps in s since the first sample of the log."""
    t, values = as_stamps(stamps, file=file), np.asarray(values)
    if values.ndim != 1:
        raise LogError(f"has shape {values.shape}", file=file, field=field, remedy="give one number per stamp")
    values = one_a_stamp(values, len(t), field, file)
    if np.isinf(values).any():
        raise LogError("is infinite", file=file, field=field, remedy="write NaN where nothing was measured")
    known = np.isfinite(values)
    if not known.any():
        raise LogError("was never measured", file=file, field=field, remedy="leave it out of [log.columns]")
    ordered = tidy(since(t, start)[known], {field: values[known]})
    return Column(ordered.t, ordered.columns[field])
