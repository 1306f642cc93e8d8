"""Logs of which every stream is a file of its own, with stamps of its own."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.check import check_log
from ftbias_jax.io.clock import put_in_order
from ftbias_jax.io.conventions.units import rows_at_rate, stamps
from ftbias_jax.io.log import Log, Repair, Repairs
from ftbias_jax.io.tables.csv import named_columns
from ftbias_jax.io.tables.csv_columns import choose_some
from ftbias_jax.setup.sensor_pose import pose_columns
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

QUANTITIES = {
    "position": ("position", "velocity", "temperature"),
    "velocity": ("velocity",),
    "wrench": ("wrench", "temperature"),
    "temperature": ("temperature",),
}
"""Key of [log.files] -> what its file has, the first of it at least."""


def files_of(path: str | os.PathLike[str], setup: Setup) -> dict[str, str]:
    """The files that make up one log, by quantity.

    Args:
        path: any of the files; what the * of its pattern stands for is that of the others.
        setup: [log.files] has the patterns.

    Raises:
        LogError: the name fits no pattern.
    """
    patterns = setup.log.files
    folder, name = os.path.split(os.fspath(path))
    for pattern in patterns.values():
        before, star, after = pattern.partition("*")
        shared = re.fullmatch(f"{re.escape(before)}(.*){re.escape(after)}", name) if star else None
        if shared:
            return {key: os.path.join(folder, other.replace("*", shared[1], 1)) for key, other in patterns.items()}
        if name == pattern:
            return {key: os.path.join(folder, other) for key, other in patterns.items()}
    remedy = f"give a log whose name fits one of {', '.join(patterns.values())}"
    raise LogError("is none of the files that log.files of the setup names", file=path, remedy=remedy)


def read_files(path: str | os.PathLike[str], setup: Setup) -> Log:
    """Read the files of one log, and put their samples on one timeline, without interpolation.

    Args:
        path: any of the files.
        setup: [log.files] names them.

    Raises:
        LogError: a file cannot be read, or the log cannot be filtered (see ``check_log``).
    """
    parts: list[tuple[Array, dict[str, Array]]] = []
    repairs: list[Repair] = []
    unused = {"velocity"} if setup.pose and not pose_columns(setup.pose)[1] else set()
    for key, file in files_of(path, setup).items():
        if key in unused:
            continue
        t, columns, mended = _read_one(file, key, setup)
        parts.append((t, columns))
        repairs += mended
    if len({t.dtype.kind for t, _ in parts}) > 1:
        parts = [(t * 1e-9 if t.dtype.kind == "i" else t, columns) for t, columns in parts]
    times = np.unique(np.concatenate([t for t, _ in parts]))
    merged: dict[str, Array] = {}
    for t, columns in parts:
        rows = np.searchsorted(times, t)
        for name, values in columns.items():
            if name not in merged:
                merged[name] = np.full((len(times), *values.shape[1:]), np.nan)
                merged[name][rows] = values
    return check_log(
        times,
        merged["q"],
        merged["wrench"],
        merged.get("dq"),
        merged.get("temperature"),
        setup=setup,
        file=os.fspath(path),
        repairs=tuple(repairs),
    )


def _read_one(file: str, key: str, setup: Setup) -> tuple[Array, dict[str, Array], Repairs]:
    """Stamps in order, and the arrays of one file by their native names."""
    quantities = [name for name in QUANTITIES[key] if name == key or name not in setup.log.files]
    found = named_columns(file, lambda header: choose_some(header, quantities, setup, file))
    counted = rows_at_rate(len(next(iter(found.values()))), setup.log)
    recorded = found.pop("t", None)
    t = stamps(recorded, setup.log) if counted is None else counted
    ordered = put_in_order(t, found, f"samples of {Path(file).name}", file=file)
    return ordered.t, {name: np.asarray(x) for name, x in zip(found, ordered.columns, strict=True)}, ordered.repairs
