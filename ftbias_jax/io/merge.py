"""Time-stamped streams on one merged timeline, without interpolation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.check import check_log
from ftbias_jax.io.clock import one_a_stamp
from ftbias_jax.io.conventions.units import later
from ftbias_jax.io.log import Log, Repairs
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

Part = tuple[Array, Mapping[str, Array]]
"""Stamps of a stream in order, float64 s or int64 ns, and its arrays by the names of a log."""
QUANTITIES = {"q": "position", "dq": "velocity", "wrench": "wrench", "temperature": "temperature"}
"""Array of a log -> what [log.time_offsets] calls it."""


def log_of_parts(parts: Sequence[Part], setup: Setup, repairs: Repairs, file: str = "") -> Log:
    """A log of streams with stamps of their own, all in s or all in ns: joints or a pose, and a wrench at least."""
    by_array = {name: t for t, arrays in reversed(parts) for name in arrays}
    check_overlap(by_array["q"], by_array["wrench"], file)
    merged = merge_parts(parts, file)
    t, q, wrench = merged.pop("t"), merged.pop("q"), merged.pop("wrench")
    return check_log(t, q, wrench, **merged, setup=setup, file=file, repairs=repairs)


def merge_parts(parts: Sequence[Part], file: str = "") -> dict[str, Array]:
    """Streams on one timeline, by the names of their arrays, and "t": NaN where a stream has no sample.

    Samples share a row where their stamps are equal, to the last bit. Of arrays that two streams have, the first is
    taken.
    """
    t = np.unique(np.concatenate([times for times, _ in parts]))
    merged = {"t": t}
    for times, arrays in parts:
        for name in arrays.keys() - merged.keys():
            values = one_a_stamp(arrays[name], len(times), name, file)
            merged[name] = np.full((len(t), *values.shape[1:]), np.nan)
            merged[name][np.searchsorted(t, times)] = values
    return merged


def on_one_clock(parts: Sequence[Part], offsets: Mapping[str, float], file: str = "") -> list[Part]:
    """Streams with the offsets of their clocks added, [log.time_offsets]; a stream goes by the first of its arrays."""
    if len({t.dtype.kind for t, _ in parts}) > 1:
        message = f"types {' and '.join(str(t.dtype) for t, _ in parts)} differ"
        raise LogError(message, file=file, field="t_joints, t_wrench", remedy="give both in s, or both in integer ns")
    owners = [QUANTITIES[next(iter(arrays))] for _, arrays in parts]
    if shared := sorted(offsets.keys() - set(owners)):
        field, remedy = f"log.time_offsets.{shared[0]}", f"state that of {' or '.join(owners)}"
        raise LogError("has no stamps of its own in this log", file=file, field=field, remedy=remedy)
    return [(later(t, offsets.get(owner, 0.0)), arrays) for owner, (t, arrays) in zip(owners, parts, strict=True)]


def check_overlap(joint_t: Array, wrench_t: Array, file: str = "") -> None:
    """Refuse streams of different clocks."""
    if not len(joint_t) or not len(wrench_t) or joint_t[-1] < wrench_t[0] or wrench_t[-1] < joint_t[0]:
        joints, wrench = (f"{t[0]} to {t[-1]}" if len(t) else "none" for t in (joint_t, wrench_t))
        message = f"the streams do not overlap in time: joints {joints}, wrench {wrench}"
        raise LogError(message, file=file, field="t_joints, t_wrench", remedy="stamp both with one clock")
