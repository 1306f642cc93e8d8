"""Logs of which every stream is a file of its own, with stamps of its own."""

from __future__ import annotations

import os
from dataclasses import replace

from ftbias_jax.io.check import check_log
from ftbias_jax.io.conventions.units import later
from ftbias_jax.io.log import Log, Repair
from ftbias_jax.io.merge import Part, check_overlap, merge_parts
from ftbias_jax.io.remote.fetch import opened
from ftbias_jax.io.remote.outside import check_links, check_patterns
from ftbias_jax.io.tables.grouping import files_of
from ftbias_jax.io.tables.stream_files import read_stream
from ftbias_jax.setup.sensor_pose import pose_columns
from ftbias_jax.setup.types import Setup

QUANTITIES = {
    "position": ("position", "velocity", "temperature"),
    "velocity": ("velocity",),
    "wrench": ("wrench", "temperature"),
    "temperature": ("temperature",),
}
"""Key of [log.files] -> what its file has, the first of it at least."""


def setup_of_file(setup: Setup, key: str) -> Setup:
    """The setup with the unit of the stamps of one of the files."""
    unit = setup.log.time_units.get(key, setup.log.time_unit)
    return replace(setup, log=replace(setup.log, time_unit=unit))


def read_files(path: str | os.PathLike[str], setup: Setup, *, salvage: bool = False) -> Log:
    """Read the files of one log, and put their samples on one timeline, without interpolation."""
    parts: list[Part] = []
    repairs: list[Repair] = []
    unused = {"velocity"} if setup.pose and not pose_columns(setup.pose)[1] else set()
    files = files_of(path, setup.log.files)
    if not setup.log.allow_outside:
        check_patterns(setup.log.files, setup.path)
        check_links(files, os.fspath(path))
    for key, file in files.items():
        if key not in unused:
            quantities = [name for name in QUANTITIES[key] if name == key or name not in setup.log.files]
            with opened(file) as there:
                found, mended = read_stream(there, quantities, setup_of_file(setup, key), salvage=salvage)
            parts += [(later(t, setup.log.time_offsets.get(key, 0.0)), arrays) for t, arrays in found]
            repairs += mended
    if len({t.dtype.kind for t, _ in parts}) > 1:
        parts = [(t * 1e-9 if t.dtype.kind == "i" else t, arrays) for t, arrays in parts]
    by_array = {name: t for t, arrays in reversed(parts) for name in arrays}
    check_overlap(by_array["q"], by_array["wrench"], os.fspath(path))
    merged = merge_parts(parts, os.fspath(path))
    t, q, wrench = merged.pop("t"), merged.pop("q"), merged.pop("wrench")
    return check_log(t, q, wrench, **merged, setup=setup, file=os.fspath(path), repairs=tuple(repairs))
