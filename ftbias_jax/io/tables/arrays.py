"""Logs as named arrays, whatever file they come from: names, readers by suffix, and conversion to a ``Log``."""

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.check import EXTRA_PREFIX, Part, check_log, further_columns, log_of_parts, on_one_clock
from ftbias_jax.io.log import Log, Repairs
from ftbias_jax.io.stamps.clock import as_stamps, on_right_clock, put_in_order, rows_at_rate, stamps_of
from ftbias_jax.io.tables.array_files import load_arrays, load_hdf5, shapes_of_arrays, shapes_of_hdf5
from ftbias_jax.io.tables.clocks import clocks_of, stamps_by_stream
from ftbias_jax.io.tables.columns import WIDE, Columns, choose_columns, named_columns
from ftbias_jax.io.tables.csv import csv_columns
from ftbias_jax.io.tables.headers import matches
from ftbias_jax.io.tables.parquet import parquet_columns
from ftbias_jax.setup.recorded import PoseSetup
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

STAMPS = ("t", "t_joints", "t_wrench")
MEASURED = ("q", "dq", "wrench", "temperature")
ARRAYS = (*STAMPS, *MEASURED)
POSE_ARRAYS = ("orientation", "position", "angular_velocity", "specific_force")
"""Arrays instead of q and dq, if the setup has a sensor_pose."""

QUANTITIES = {
    "time": STAMPS,
    "position": ("q", "orientation", "position"),
    "velocity": ("dq", "angular_velocity", "specific_force"),
    "wrench": ("wrench",),
    "temperature": ("temperature",),
}
"""Key of [log.columns] -> the array that its columns form, then others that would be read in its place."""
COLUMNS: dict[str, Callable[[str, Callable[[Sequence[str]], Columns]], dict[str, Array]]]
COLUMNS = {".csv": csv_columns, ".parquet": parquet_columns}
"""Suffix -> reader of the columns that are chosen from a header."""
ARRAY_FILES: dict[str, Callable[[str, Sequence[str]], dict[str, Array]]]
ARRAY_FILES = {".npz": load_arrays, ".h5": load_hdf5, ".hdf5": load_hdf5}
"""Suffix -> reader of those of the named arrays that the file holds."""
SHAPES: dict[str, Callable[[str], dict[str, tuple[int, ...]]]]
SHAPES = {".npz": shapes_of_arrays, ".h5": shapes_of_hdf5, ".hdf5": shapes_of_hdf5}
"""Suffix -> reader of the shapes of all arrays."""
WIDEST = 100
"""Maximum numbers per sample of an array that can be split into columns."""
TEXT = (".txt", ".tsv", ".dat")
"""Suffixes of other text tables, which are read as CSV."""
TABLES = (".npz", *COLUMNS, ".h5", ".hdf5")
"""Suffixes of all tables and array files; ROS recordings have their own (``io.ros``)."""
OWN_STAMPS = "t"
"""Name in a header that represents the stamps of arrays that have stamps of their own."""
OURS = ("about", "provenance")
"""Arrays that mark a log written by this program: it has the native names, whatever [log.columns] states."""


def wanted_arrays(setup: Setup) -> tuple[str, ...]:
    """Names of the arrays that a log may have: the native names, and those in [log.columns]."""
    stated = setup.log.columns.values()
    named = (name for names in stated for name in ((names,) if isinstance(names, str) else names))
    return tuple(dict.fromkeys((*ARRAYS, *POSE_ARRAYS, *named)))


def by_native_names(arrays: Mapping[str, Array], setup: Setup, file: str = "") -> dict[str, Array]:
    """The arrays by native names, each replaced by those that [log.columns] of the setup names for it, if any.

    [log.columns] names one array (T,) for each joint or channel, and one each for time and temperature.
    """
    found = {name: values for name, values in arrays.items() if name in (*ARRAYS, *POSE_ARRAYS)}
    for key, natives in QUANTITIES.items():
        stated = setup.log.columns.get(key, ())
        names = (stated,) if isinstance(stated, str) else stated
        for name in names:
            if name not in arrays:
                message = f"log.columns.{key} of the setup names this array, but it is not there"
                raise LogError(message, file=file, field=name, remedy="correct its name")
            if np.ndim(arrays[name]) != 1 or len(arrays[name]) != np.size(arrays[names[0]]):
                message = f"log.columns.{key} of the setup names it, but it has shape {np.shape(arrays[name])}"
                raise LogError(message, file=file, field=name, remedy="name lists of one number a sample")
        if names:
            found = {name: values for name, values in found.items() if name not in natives}
            found[natives[0]] = arrays[stated] if isinstance(stated, str) else np.stack([arrays[x] for x in names], 1)
    return found


def log_from_arrays(arrays: Mapping[str, Array], setup: Setup, file: str = "") -> Log:
    """Build a log from t (T,), q (T, n), wrench (T, 6) and, if present, dq (T, n) and temperature (T,).

    Instead of t, t_joints (J,) may stamp q and dq, and t_wrench (W,) the wrench and the temperature; a setup that
    states log.rate needs no stamps. Further columns (T,) have the stamps t, or else those of the wrench or the joints.
    """
    log = _merged(arrays, setup, file)
    further = {name: values for name, values in arrays.items() if name.startswith(EXTRA_PREFIX)}
    if not further:
        return log
    counted = rows_at_rate(next(iter(further.values())), setup.log)
    clock = next((name for name in ("t", "t_wrench", "t_joints") if name in arrays), "")
    t = as_stamps(stamps_of(arrays[clock], setup.log) if counted is None else counted, file=file)
    return further_columns([(on_right_clock(t, setup.log, "wrench"), further)], log, setup, file)


def _merged(arrays: Mapping[str, Array], setup: Setup, file: str) -> Log:
    if setup.pose is not None:
        arrays = with_pose(arrays, setup.pose, file)
    _get(arrays, "q", "no motion data: there is no array q (T, n) rad", file)
    wrench = _get(arrays, "wrench", "no wrench data: there is no array wrench (T, 6) N, Nm", file)
    counted = rows_at_rate(wrench, setup.log)
    times = {name: stamps_of(arrays[name], setup.log) for name in STAMPS if name in arrays} if counted is None else {}
    if counted is not None or "t" in times:
        if len(times) > 1:
            message = "is given together with t_joints or t_wrench"
            raise LogError(message, file=file, field="t", remedy="keep t, or the stamps of the two streams")
        t = times["t"] if counted is None else counted
        if setup.log.one_clock:
            return check_log(
                t, arrays["q"], wrench, arrays.get("dq"), arrays.get("temperature"), setup=setup, file=file
            )
        times = dict.fromkeys(STAMPS[1:], as_stamps(t, file=file))
    t_joints = _get(times, "t_joints", "there is no time: neither t (T,) s, nor t_joints with t_wrench", file)
    t_wrench = _get(times, "t_wrench", "there is t_joints, but no t_wrench", file)
    parts: list[Part] = []
    repairs: Repairs = ()
    for t, names, which in ((t_joints, MEASURED[:2], "joints"), (t_wrench, MEASURED[2:], "wrench")):
        columns = {name: arrays[name] for name in names if name in arrays}
        ordered = put_in_order(t, columns, f"samples of the {which}", file=file, field=f"t_{which}")
        parts.append((ordered.t, ordered.columns))
        repairs += ordered.repairs
    return log_of_parts(on_one_clock(parts, setup.log, file), setup, repairs, file)


def with_pose(arrays: Mapping[str, Array], pose: PoseSetup, file: str) -> dict[str, Array]:
    """The arrays, with those of the pose joined side by side as q and dq."""
    joined = {name: values for name, values in arrays.items() if name not in POSE_ARRAYS}
    if "q" not in joined or "orientation" in arrays:  # [log.columns] may already have provided q
        joined["q"] = joined_pose(arrays, pose, "q", file)
    if any(part in arrays for part in _pose_parts(arrays, pose)["dq"]):
        joined["dq"] = joined_pose(arrays, pose, "dq", file)
    return joined


def joined_pose(arrays: Mapping[str, Array], pose: PoseSetup, name: str, file: str) -> Array:
    """Join the arrays of a pose side by side as q, or those of its IMU as dq."""
    parts = _pose_parts(arrays, pose)[name]
    flat = []
    for part in parts:
        column = np.atleast_1d(_get(arrays, part, f"there is no array {part}", file))
        flat.append(column.reshape(len(column), -1))
    if len({len(column) for column in flat}) > 1:
        message = f"have {' and '.join(str(len(column)) for column in flat)} samples"
        raise LogError(message, file=file, field=", ".join(parts), remedy="give one of each a stamp")
    return np.concatenate(flat, 1)


def _pose_parts(arrays: Mapping[str, Array], pose: PoseSetup) -> dict[str, list[str]]:
    gyroscope = pose.gyroscope and ("angular_velocity" in arrays or pose.linear != "specific_force")
    parts = {"q": ["orientation"], "dq": ["angular_velocity"] if gyroscope else []}
    if pose.linear != "none":
        parts["q" if pose.linear == "position" else "dq"].append(pose.linear)
    return parts


def _get(arrays: Mapping[str, Array], name: str, message: str, file: str) -> Array:
    if name not in arrays:
        raise LogError(message, file=file, field=name, remedy=f"name the arrays of a log {', '.join(ARRAYS)}")
    return arrays[name]


def suffix_of(file: str) -> str:
    """Suffix of a file, by which its reader is selected."""
    suffix = Path(file).suffix.lower()
    return ".csv" if suffix in TEXT else suffix


def read_table(file: str, setup: Setup) -> Log:
    """Read a log; rows of columns may have joints only or a wrench only, as on a merged timeline."""
    return log_from_arrays(native_arrays(file, setup), setup, file)


def native_arrays(file: str, setup: Setup, static: bool = False) -> dict[str, Array]:
    """The arrays of a log, or of static poses, by the names of the native format (``arrays.ARRAYS``)."""
    quantities = ("position", "wrench", "temperature", *(() if static else ("velocity",)))
    arrays, chosen = read_stored(file, setup, quantities, 2, static)
    if chosen:
        return arrays
    further = {} if static else named_columns(list(arrays), setup, file)
    native = arrays if arrays.keys() >= set(OURS) else by_native_names(arrays, setup, file)
    return native | {key: arrays[name] for key, (name,) in further.items()}


def read_stored(
    file: str, setup: Setup, quantities: Sequence[str], needed: int, static: bool = False
) -> tuple[dict[str, Array], bool]:
    """Arrays of a file, and whether they are chosen columns; otherwise their names are native or from [log.columns].

    Arrays that lack the first ``needed`` quantities are taken as columns, if these provide them; what is missing is
    reported by its native name, unless the file has no native names.
    """

    def choose(header: Sequence[str]) -> Columns:
        return choose_columns(header, quantities, setup, file, static)

    def has(quantity: str) -> bool:
        stated = setup.log.columns.get(quantity, ())
        stated = (stated,) if isinstance(stated, str) else stated
        return arrays.keys() >= set(stated) if stated else not arrays.keys().isdisjoint(QUANTITIES[quantity])

    suffix = suffix_of(file)
    if suffix in COLUMNS:
        return COLUMNS[suffix](file, choose), True
    arrays = ARRAY_FILES[suffix](file, (*wanted_arrays(setup), *(OURS if suffix == ".npz" else ())))
    timed = static or setup.log.rate is not None or has("time")
    if arrays.keys() >= set(OURS) or (timed and all(map(has, quantities[:needed]))):
        return arrays, False
    if not arrays.keys().isdisjoint((*ARRAYS, *POSE_ARRAYS)):
        try:
            choose(_contents(file).header)
        except LogError:
            return arrays, False
    return array_columns(file, choose), True


def array_columns(file: str, choose: Callable[[Sequence[str]], Columns]) -> dict[str, Array]:
    """Read the columns that ``choose`` selects from a file of arrays, by the names that it gives them.

    An array (T,) is a column; the K columns of an array (T, K) are called array/0, array/1, .... If no column holds the
    stamps, but arrays have stamps of their own, the header has OWN_STAMPS too, and each stream of the log gets its own.
    """
    cells, clocks, header = _contents(file)
    chosen = dict(choose(header))
    if clocks and chosen.get("t") == (OWN_STAMPS,):
        del chosen["t"]
    else:
        clocks = {}
    columns = {key: [cells[name] for name in names] for key, names in chosen.items() if names}
    used = {key: sorted({array for array, _ in found}) for key, found in columns.items()}
    needed = set[str]().union(*used.values())
    stored = ARRAY_FILES[suffix_of(file)](file, sorted(needed | {clocks[name] for name in needed & clocks.keys()}))
    arrays = {name: values.reshape(_plain(values.shape)) for name, values in stored.items()}
    if not clocks:
        _check_lengths(arrays, file)
    numbers = {key: [_column(arrays[name], entry) for name, entry in found] for key, found in columns.items()}
    stacked = {key: np.stack(found, 1) if key in WIDE else found[0] for key, found in numbers.items()}
    return stacked | (stamps_by_stream(used, clocks, arrays, file) if clocks else {})


class _Contents(NamedTuple):
    """Content of a file of arrays, as columns."""

    cells: Mapping[str, tuple[str, int | None]]
    """Name of a column -> its array and the index in the rows; None = the array has one number per row."""
    clocks: Mapping[str, str]
    """Array -> its stamps, if no column holds stamps for all arrays."""
    header: list[str]


def _contents(file: str) -> _Contents:
    shapes = {name: _plain(shape) for name, shape in SHAPES[suffix_of(file)](file).items()}
    cells = _cells(shapes)
    clocks = {} if matches("time", list(cells)) else clocks_of(shapes)
    return _Contents(cells, clocks, [*cells, *([OWN_STAMPS] if clocks else [])])


def _plain(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Shape (T,) for a column (T, 1), otherwise the shape itself."""
    return shape[:1] if shape[1:] == (1,) else shape


def _check_lengths(arrays: Mapping[str, Array], file: str) -> None:
    first = next(iter(arrays), "")
    for name, values in arrays.items():
        if len(values) != len(arrays[first]):
            message = f"has {len(values)} samples, {first} {len(arrays[first])}"
            raise LogError(message, file=file, field=name, remedy="store t_joints and t_wrench, or one row a sample")


def _cells(shapes: Mapping[str, tuple[int, ...]]) -> dict[str, tuple[str, int | None]]:
    """Cells of ``_Contents``; an array ``data`` or ``values`` of a group has the name of the group."""
    cells: dict[str, tuple[str, int | None]] = {}
    for array, shape in shapes.items():
        name = re.sub("/(data|values?)$", "", array)
        if len(shape) == 1:
            cells[name] = (array, None)
        elif len(shape) == 2 and shape[1] <= WIDEST:
            cells |= {f"{name}/{i}": (array, i) for i in range(shape[1])}
    return cells


def _column(values: Array, entry: int | None) -> Array:
    return values if entry is None else values[:, entry]
