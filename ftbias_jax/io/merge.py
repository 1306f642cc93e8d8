"""Time-stamped streams on one merged timeline, without interpolation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.check import check_stamps
from ftbias_jax.io.conventions.units import later
from ftbias_jax.io.log import Log
from ftbias_jax.types import Array

Part = tuple[Array, Mapping[str, Array]]
"""Stamps of a stream in order, float64 s or int64 ns, and its arrays by the names of a log."""
QUANTITIES = {"q": "position", "dq": "velocity", "wrench": "wrench", "temperature": "temperature"}
"""Array of a log -> what [log.time_offsets] calls it."""
NO_OFFSETS: Mapping[str, float] = MappingProxyType({})


def merge_streams(
    joint_t: Array,
    q: Array,
    wrench_t: Array,
    wrench: Array,
    dq: Array | None = None,
    temperature: Array | None = None,
    *,
    offsets: Mapping[str, float] = NO_OFFSETS,
    file: str = "",
) -> Log:
    """Joint states and wrenches with their own stamps, as one log: NaN where a stream has no sample.

    Samples share a row where their stamps are equal, to the last bit.

    Args:
        joint_t: (J,) stamps of the joint states.
        q: (J, n) rad.
        wrench_t: (W,) stamps of the wrenches.
        wrench: (W, 6) N, Nm.
        dq: (J, n) rad/s; None = not recorded.
        temperature: (W,) deg C; None = not recorded.
        offsets: [log.time_offsets] of the setup.
        file: the name in messages.

    Returns:
        a log as recorded: stamps and sign unchanged, for ``check_log``.
    """
    joint_t = check_stamps(joint_t, file=file, field="t_joints")
    wrench_t = check_stamps(wrench_t, file=file, field="t_wrench")
    if (joint_t.dtype.kind == "f") != (wrench_t.dtype.kind == "f"):
        message = f"types {joint_t.dtype} and {wrench_t.dtype} differ"
        raise LogError(message, file=file, field="t_joints, t_wrench", remedy="give both in s, or both in integer ns")
    joints = {"q": q, "dq": np.full(np.shape(q), np.nan) if dq is None else dq}
    readings = {"wrench": wrench, "temperature": np.full(len(wrench_t), np.nan) if temperature is None else temperature}
    parts = on_one_clock([(joint_t, joints), (wrench_t, readings)], offsets, file)
    check_overlap(parts[0][0], parts[1][0], file)
    return Log(**merge_parts(parts, file))


def merge_parts(parts: Sequence[Part], file: str = "") -> dict[str, Array]:
    """Streams with stamps of their own on one timeline, by the names of their arrays, and "t"."""
    t = np.unique(np.concatenate([times for times, _ in parts]))
    merged = {"t": t}
    for times, arrays in parts:
        rows = np.searchsorted(t, times)
        for name, values in arrays.items():
            if name not in merged:
                merged[name] = _place(np.asarray(values), rows, len(t), name, file)
    return merged


def on_one_clock(parts: Sequence[Part], offsets: Mapping[str, float], file: str = "") -> list[Part]:
    """Streams with the offsets of their clocks added; a stream goes by the first of its arrays."""
    owners = [QUANTITIES[next(iter(arrays))] for _, arrays in parts]
    if shared := sorted(offsets.keys() - set(owners)):
        field, remedy = f"log.time_offsets.{shared[0]}", f"state that of {' or '.join(owners)}"
        raise LogError("has no stamps of its own in this log", file=file, field=field, remedy=remedy)
    return [(later(t, offsets.get(owner, 0.0)), arrays) for owner, (t, arrays) in zip(owners, parts, strict=True)]


def check_overlap(joint_t: Array, wrench_t: Array, file: str = "") -> None:
    """Refuse streams of different clocks."""
    if not len(joint_t) or not len(wrench_t) or joint_t[-1] < wrench_t[0] or wrench_t[-1] < joint_t[0]:
        message = f"the streams do not overlap in time: joints {_span(joint_t)}, wrench {_span(wrench_t)}"
        raise LogError(message, file=file, field="t_joints, t_wrench", remedy="stamp both with one clock")


def _place(values: Array, rows: Array, length: int, field: str, file: str) -> Array:
    """The samples of a stream at their rows of the merged timeline, (length, ...) float64."""
    if values.ndim == 0 or len(values) != len(rows) or values.dtype.kind not in "fiu":
        message = f"has shape {values.shape} and type {values.dtype} for {len(rows)} stamps"
        raise LogError(message, file=file, field=field, remedy="give one sample of real numbers per stamp")
    merged = np.full((length, *values.shape[1:]), np.nan)
    merged[rows] = values
    return merged


def _span(t: Array) -> str:
    return f"{t[0]} to {t[-1]}" if len(t) else "none"
