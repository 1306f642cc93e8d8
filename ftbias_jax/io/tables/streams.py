"""Logs whose streams are separate files, each with stamps of its own: [log.files] of the setup."""

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.check import EXTRA_PREFIX, Part, further_columns, log_of_parts
from ftbias_jax.io.log import Log, Repair, Repairs
from ftbias_jax.io.remote import check_links, check_patterns, exists, is_url, opened
from ftbias_jax.io.ros.choose import choose, refuse_columns, wanted_of
from ftbias_jax.io.ros.read import credible, parts_of
from ftbias_jax.io.ros.record import SUFFIXES, is_ros, read_recording
from ftbias_jax.io.stamps.clock import as_stamps, on_right_clock, put_in_order, rows_at_rate, stamps_of
from ftbias_jax.io.tables import arrays as native
from ftbias_jax.io.tables.columns import NAMES, named_columns
from ftbias_jax.setup.keys import table as keys
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

QUANTITIES = {
    "position": ("position", "velocity", "temperature"),
    "velocity": ("velocity",),
    "wrench": ("wrench", "temperature"),
    "temperature": ("temperature",),
}
"""Key of [log.files] -> quantities that its file may hold, of which the first is required."""
STAMPS = {"position": "t_joints", "velocity": "t_joints", "wrench": "t_wrench", "temperature": "t_wrench"}
"""Quantity -> name of its stamps in a file of arrays that has no common clock."""
MAIN = "wrench"
"""The stream whose file identifies the log; every setup with [log.files] states it."""


def setup_of_file(setup: Setup, key: str) -> Setup:
    """The setup with the time unit of one of the log's files."""
    unit = setup.log.time_units.get(key, setup.log.time_unit)
    return replace(setup, log=replace(setup.log, time_unit=unit))


def read_files(path: str | os.PathLike[str], setup: Setup, *, salvage: bool = False) -> Log:
    """Read the files of one log, and merge their samples into one timeline, without interpolation."""
    file, named = os.fspath(path), keys.further_columns(setup.log.columns)
    parts: list[Part] = []
    repairs: list[Repair] = []
    unused = {"velocity"} if setup.pose and not setup.pose.columns[1] else set()
    files = files_of(path, setup.log.files)
    if not setup.log.allow_outside:
        check_patterns(setup.log.files, setup.path)
        check_links(files, file)
    for key, one in files.items():
        if key not in unused:
            quantities = [name for name in QUANTITIES[key] if name == key or name not in setup.log.files]
            with opened(one) as there:
                found, mended = read_stream(there, quantities, setup_of_file(setup, key), salvage=salvage)
            parts += [(on_right_clock(t, setup.log, key), arrays) for t, arrays in found]
            repairs += mended
    if len({t.dtype.kind for t, _ in parts}) > 1:
        parts = [(t * 1e-9 if t.dtype.kind == "i" else t, arrays) for t, arrays in parts]
    streams = [(t, arrays) for t, arrays in parts if not any(name.startswith(EXTRA_PREFIX) for name in arrays)]
    log = further_columns(parts, log_of_parts(streams, setup, tuple(repairs), file), setup, file)
    for key, name in named.items():
        if key not in log.columns:
            message = "log.columns of the setup names this column, but no file of the log has it"
            raise LogError(message, file=file, field=name, remedy="correct its name")
    return log


def unknown_format(file: str) -> LogError:
    """Error for a file whose suffix is not that of a log, or for a folder that is not there."""
    if not (native.suffix_of(file) or exists(file)):
        return LogError("cannot be read: No such file or directory", file=file, remedy="check the path")
    *most, last = (*native.TABLES, *SUFFIXES)
    remedy = f"give a log that ends in {', '.join(most)} or {last}, or a ROS 2 bag's folder"
    return LogError(f"unknown format {native.suffix_of(file)!r}", file=file, remedy=remedy)


def read_stream(
    file: str, quantities: Sequence[str], setup: Setup, *, salvage: bool = False
) -> tuple[list[Part], Repairs]:
    """Sorted stamps and arrays of one file, by native names; a recording may have several streams."""
    if is_ros(file):
        return _of_recording(file, quantities, setup, salvage)
    if native.suffix_of(file) not in native.TABLES:
        raise unknown_format(file)
    found, chosen = native.read_stored(file, setup, quantities, 1)
    if not chosen:
        found = _of_arrays(found, quantities, setup, file)
    counted = rows_at_rate(next(values for name, values in found.items() if name != "t"), setup.log)
    recorded = found.pop("t", None)
    t = stamps_of(recorded, setup.log) if counted is None else counted
    further = {name: found.pop(name) for name in [*found] if name.startswith(EXTRA_PREFIX)}
    ordered = put_in_order(t, found, f"samples of {Path(file).name}", file=file)
    parts: list[Part] = [(ordered.t, {name: np.asarray(values) for name, values in ordered.columns.items()})]
    return parts + ([(as_stamps(t, file=file), further)] if further else []), ordered.repairs


def _of_arrays(arrays: Mapping[str, Array], quantities: Sequence[str], setup: Setup, file: str) -> dict[str, Array]:
    """The arrays of the wanted quantities that share the stamps of the first quantity, and these stamps as "t"."""
    further = {key: arrays[name] for key, (name,) in named_columns(list(arrays), setup, file).items()}
    mine = {key: names for key, names in setup.log.columns.items() if key in ("time", *quantities)}
    arrays = native.by_native_names(arrays, replace(setup, log=replace(setup.log, columns=mine)), file)
    clock = "t" if "t" in arrays else STAMPS[quantities[0]]
    if clock not in arrays and setup.log.rate is None:
        raise LogError("there is no time", file=file, field=clock, remedy="store the stamps, or state log.rate")
    found = {"t": arrays[clock]} if clock in arrays else {}
    for quantity in quantities:
        if clock not in ("t", STAMPS[quantity]):
            continue  # it has another clock
        name = NAMES[quantity]
        parts = {"q": ("orientation",), "dq": native.POSE_ARRAYS[2:]}.get(name, ()) if setup.pose is not None else ()
        if setup.pose is not None and any(part in arrays for part in parts):
            found[name] = native.joined_pose(arrays, setup.pose, name, file)
        elif name in arrays:
            found[name] = arrays[name]
        elif quantity == quantities[0]:
            missing = " or ".join(parts) or name
            remedy = (
                f"name the arrays of a log {', '.join(native.ARRAYS if setup.pose is None else native.POSE_ARRAYS)}"
            )
            raise LogError(f"there is no array {missing}", file=file, field=name, remedy=remedy)
    return found | further


def _of_recording(
    file: str, quantities: Sequence[str], setup: Setup, salvage: bool
) -> tuple[list[Part], tuple[Repair, ...]]:
    """The streams of a recording that hold the wanted quantities."""
    # [log.columns] may name a temperature that is in another file of the log.
    refuse_columns(setup, [key for key in quantities if key in (quantities[0], "velocity")], file)
    mended: list[Repair] = []
    recording = credible(read_recording(file, salvage=salvage, wanted=wanted_of(setup)), mended)
    chosen = choose(recording, quantities, setup, file)
    wanted = {NAMES[quantity] for quantity in quantities}
    parts = [
        (t, {name: values for name, values in arrays.items() if name in wanted})
        for t, arrays in parts_of(chosen, setup, mended, file)
    ]
    return [part for part in parts if part[1]], tuple(mended)


def files_of(path: str | os.PathLike[str], patterns: Mapping[str, str]) -> dict[str, str]:
    """The files that make up one log, by quantity."""
    found = list(_readings(os.fspath(path).rstrip("/" + os.sep), patterns))
    if not found:
        remedy = f"give a log whose name fits one of {', '.join(patterns.values())}"
        raise LogError("does not match log.files of the setup", file=path, remedy=remedy)
    # A name may fit several patterns, such as "*.csv" and "*_wrench.csv": take the one whose files exist.
    return next((files for files in found if all(map(exists, files.values()))), found[0])


def inputs_of(path: str | os.PathLike[str], patterns: Mapping[str, str]) -> tuple[str, ...]:
    """All files of a log; the path itself if the log is a single file, or fits no pattern."""
    try:
        return tuple(dict.fromkeys(files_of(path, patterns).values())) if patterns else (os.fspath(path),)
    except LogError:
        return (os.fspath(path),)


def main_file(path: str, patterns: Mapping[str, str]) -> str | None:
    """The file that identifies the log to which a file belongs; None if it belongs to none.

    This is the wrench's file, so that all files of a log give the same name. If it is missing, it is the first other
    file that exists, so that reading the log reports what is missing.
    """
    try:
        files = files_of(path, patterns)
    except LogError:
        return None
    ordered = (files[MAIN], *files.values())
    return next((file for file in ordered if exists(file)), path)


def _readings(path: str, patterns: Mapping[str, str]) -> Iterator[dict[str, str]]:
    """Yield the files of the log to which a path belongs, once for each pattern that it fits."""
    folder, name = os.path.split(path)
    for pattern in patterns.values():
        before, star, after = pattern.partition("*")
        shared = re.fullmatch(f"{re.escape(before)}(.*){re.escape(after)}", name) if star else None
        if shared:
            names = {key: other.replace("*", shared[1], 1) for key, other in patterns.items()}
        elif name == pattern:
            names = dict(patterns)
        else:
            continue
        yield {key: other if is_url(other) else os.path.join(folder, other) for key, other in names.items()}
