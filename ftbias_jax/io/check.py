"""What every log must be before it is filtered, whatever its format; the one place where signs and stamps change."""

from __future__ import annotations

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.clock import as_stamps, put_in_order
from ftbias_jax.io.conventions.units import angles, wrenches
from ftbias_jax.io.log import Log, Repairs
from ftbias_jax.io.pose import in_sensor_axes, pose_entries
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

LARGEST = 1e20
"""In size, of joints and wrenches in any unit: what is beyond is an error, and its square no number of use."""
LOWEST_RATE, HIGHEST_RATE = 1.5, 5e4
"""Hz: a log of 1000 Hz has 1 Hz if its ms are taken for s, one of 50 Hz has 50 kHz if its us are taken for ns."""


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
    """A log that can be filtered, from arrays as they were recorded.

    Args:
        t: (T,) stamps: floating point in s, or integers in ns; any origin.
        q: (T, n) rad.
        wrench: (T, 6) N, Nm, as the sensor reports it.
        dq: (T, n) rad/s, or None. If the setup has a sensor_pose: both as for ``pose_entries``.
        temperature: (T,) deg C, or None. NaN = not measured.
        setup: the joints, and the sign in which the sensor reports.
        file: the name in messages.
        repairs: what was mended to get so far.

    Returns:
        float64 arrays in the order of their stamps (``put_in_order``): t relative to the first stamp (``start``), the
        wrench on the tool, NaN for what is None.
    """
    given = {"q": q, "dq": dq, "wrench": wrench, "temperature": temperature}
    recorded = {name: values for name, values in given.items() if values is not None}
    t, columns, ordering = put_in_order(t, recorded, file=file)
    q, dq = columns["q"], columns.get("dq")
    t, start = relative_seconds(t, file=file)
    if setup.pose is not None:
        q, dq = pose_entries(q, dq, t, setup, file)
    nothing = np.full(np.shape(q), np.nan) if dq is None else dq
    unknown = columns.get("temperature", np.full(len(t), np.nan))
    log = check_samples(Log(t, q, nothing, columns["wrench"], unknown, start, (*repairs, *ordering)), setup, file=file)
    log = in_sensor_axes(log, setup, file)
    check_content(~np.isnan(log.q).all(0), t[~np.isnan(log.wrench).all(1)], setup, file=file)
    return log


def check_samples(log: Log, setup: Setup, *, file: str = "", first: int = 0) -> Log:
    """Samples as recorded, or the part of them from sample ``first`` on, as float64 with the sign of the report."""
    length, n = len(log.t), len(setup.robot.joint_names)
    shapes = {"q": (length, n), "dq": (length, n), "wrench": (length, 6), "temperature": (length,)}
    floats = {name: _floats(getattr(log, name), shape, name, file, first) for name, shape in shapes.items()}
    for name in ("q", "dq"):
        floats[name] = angles(floats[name], setup)
    floats["wrench"] = wrenches(floats["wrench"], setup)
    rezeroed_at = tuple(float(at - log.start) for at in setup.sensor.rezeroed_at)
    return log._replace(**floats, rezeroed_at=rezeroed_at)


def check_content(joints: Array, wrench_t: Array, setup: Setup, *, file: str = "") -> None:
    """Refuse a log without motion or wrench, or with an implausible rate.

    ``joints`` (n,) says whether each was ever measured; ``wrench_t`` (W,) s are the stamps at which any axis was.
    """
    for name, measured in zip(setup.robot.joint_names, joints, strict=True):
        if not measured:
            remedy = "record its position, or correct the joints of the setup"
            raise LogError(f"no motion data: joint {name!r} is never measured", file=file, field="q", remedy=remedy)
    if not len(wrench_t):
        remedy = "record the sensor's wrench"
        raise LogError("no wrench data: all values are NaN", file=file, field="wrench", remedy=remedy)
    rate = 1 / np.median(np.diff(wrench_t)) if len(wrench_t) > 1 else LOWEST_RATE
    if not LOWEST_RATE <= rate <= HIGHEST_RATE:
        message = f"the wrench has a rate of {rate:.4g} Hz, which is implausible"
        remedy = "give floating-point time in s, integer time in ns, or state log.time_unit in the setup"
        raise LogError(message, file=file, field="t", remedy=remedy)


def relative_seconds(t: Array, *, file: str = "") -> tuple[Array, float]:
    """(T,) s from 0, of increasing stamps in s if floating point or ns if integer, and the first stamp in s."""
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
    """The values, from sample ``first`` on, as float64 of this shape.

    Infinities and numbers near them are refused, because they would poison what NaN only skips.
    """
    values = np.asarray(values)
    if values.dtype.kind not in "fiu":
        message = f"has type {values.dtype}"
        raise LogError(message, file=file, field=field, remedy="give real numbers, NaN where not measured")
    if values.shape != shape:
        words = "(samples, joints)" if field in ("q", "dq") else "samples first"
        message = f"has shape {values.shape}, expected {shape}"
        raise LogError(message, file=file, field=field, remedy=f"{words}; the setup has the number of joints")
    values = values.astype(np.float64)
    with np.errstate(invalid="ignore"):  # a damaged file may have NaN of the kind that raises
        beyond = np.argwhere(np.abs(values) > LARGEST)
    if beyond.size:
        place = (first + beyond[0][0], *beyond[0][1:])
        value = values[tuple(beyond[0])]
        what = "infinite" if np.isinf(value) else f"{value:.3g}, which nothing measures"
        message = f"{field}[{', '.join(map(str, place))}] is {what}"
        raise LogError(message, file=file, field=field, remedy="mark missing samples as NaN")
    return values
