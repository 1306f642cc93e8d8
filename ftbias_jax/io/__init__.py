"""Reading recorded logs: one module per format, one common check, one merged timeline as the result."""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import numpy as np

from ftbias_jax.errors import LogError, UsageError, path_of
from ftbias_jax.io.check import EXTRA_PREFIX, floats_of, relative_seconds, require_wrench
from ftbias_jax.io.cleaning import STREAMS, clean
from ftbias_jax.io.log import Log
from ftbias_jax.io.remote import from_anywhere, opened, without_credentials
from ftbias_jax.io.ros.read import read_ros
from ftbias_jax.io.ros.record import is_ros
from ftbias_jax.io.tables.arrays import TABLES, log_from_arrays, read_table, suffix_of
from ftbias_jax.io.tables.poses import Poses, read_poses
from ftbias_jax.io.tables.streams import read_files, unknown_format
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

GivenLog = Log | str | os.PathLike[str]
"""A log of motion, or its path."""
GivenMotion = Log | Poses | str | os.PathLike[str]
"""A log of motion, static poses, or the path of either."""
NO_LOG = "give logs of motion, as ft.read_log reads them, or their paths; of static poses see ft.identify_tool"
"""Remedy where something else is given."""
_OF_TIME = ("t", "time", "t_joints")
"""``LogError.field`` of a log whose stamps are missing or implausible: the file may hold static poses."""


def read_log(path: str | os.PathLike[str], setup: Setup, *, salvage: bool = False, raw: bool = False) -> Log:
    """Read a log in the format of its suffix, or a ROS 2 bag's folder, and clean it.

    Samples that arrived slightly late are sorted; repeated stamps, stuck axes and samples at the end of the sensor's
    range are left out. ``repairs`` of the log counts all of these.

    Args:
        path: the file, or a URL (extra ``remote``); any one of the files if [log.files] of the setup names several.
        setup: gives the number and names of the joints, the sign convention of the sensor, and column names.
        salvage: read the undamaged part of a damaged ROS recording.
        raw: keep samples of stuck and clipped axes and repeats as recorded; ``repairs`` lists them.

    Raises:
        LogError: the file cannot be read, or cannot be filtered with this setup (see ``check_log``).
    """
    log = read_recorded(path, setup, salvage=salvage)
    return clean(log, clipped=not raw, stuck=not raw, held=() if raw else STREAMS, file=os.fspath(path))


def each_of(logs: GivenMotion | Iterable[GivenMotion], executor: Executor | None = None) -> Iterable[Any]:
    """Return logs or paths as an iterable: a single one as a list, paths made absolute for the workers of an executor.

    Raises:
        UsageError: the argument holds arrays by name, such as a table in memory.
    """
    if hasattr(logs, "keys"):
        remedy = "make a log of arrays in memory by ft.Log.from_arrays(setup, t, q, wrench)"
        raise UsageError(f"got {type(logs).__name__}", field="logs", remedy=remedy)
    if isinstance(logs, Log | Poses | str | os.PathLike):
        logs = [logs]
    if not isinstance(logs, Iterable):
        raise UsageError(f"got {type(logs).__name__}", field="logs", remedy=NO_LOG)
    return map(from_anywhere, logs) if executor else logs


def as_log(log: object, setup: Setup, *, raw: bool = False) -> Log:
    """Return a log of motion, or read it as ``read_log`` does if a path is given.

    Raises:
        UsageError: the argument is neither. LogError: see ``read_log``; or the arrays of a log in memory, such as one
            changed by ``_replace``, do not have one row per stamp.
    """
    if isinstance(log, str | os.PathLike):
        return read_log(log, setup, raw=raw)
    if not isinstance(log, Log):
        raise UsageError(f"got {type(log).__name__}", field="logs", remedy=NO_LOG)
    relative_seconds(log.t, file=log.file)
    floats = floats_of(log, setup, file=log.file)
    require_wrench(floats["wrench"], file=log.file)
    return log._replace(**floats)


def as_logs(logs: GivenLog | Iterable[GivenLog], setup: Setup, *, raw: bool = False) -> list[Log]:
    """Return one or several logs as a list, each read by ``as_log`` if it is a path.

    Raises:
        UsageError: no log is given. Others: see ``as_log``.
    """
    read = [as_log(log, setup, raw=raw) for log in each_of(logs)]
    if not read:
        raise UsageError("there is no log", field="logs", remedy="give at least one")
    return read


def names_of(logs: Sequence[Log]) -> list[str]:
    """File names of logs; "log 1", "log 2" and so on for those from memory."""
    return [Path(without_credentials(log.file)).name or f"log {i}" for i, log in enumerate(logs, 1)]


def as_motion(log: GivenMotion, setup: Setup) -> Log | Poses:
    """Return a log of motion or static poses unchanged, or read either by ``read_motion`` if a path is given."""
    if isinstance(log, str | os.PathLike):
        return read_motion(log, setup)
    return log if isinstance(log, Poses) else as_log(log, setup)


def read_motion(path: str | os.PathLike[str], setup: Setup) -> Log | Poses:
    """Read a log as ``read_log`` does, or static poses from a table without time or with a rate of about 1 Hz or less.

    Raises:
        LogError: the file holds neither; the message is that of ``read_log``.
    """
    return or_poses(read_log, path, setup)


def or_poses(read: Callable[..., Log], path: str | os.PathLike[str], setup: Setup, **choices: bool) -> Log | Poses:
    """Read as ``read_motion`` does, by ``read``: ``read_log``, maybe with ``choices`` for it, or ``read_recorded``."""
    try:
        return read(path, setup, **choices)
    except LogError as error:
        if error.field not in _OF_TIME:
            raise
        try:
            with opened(path) as there:
                return read_poses(there, setup)
        except LogError:
            raise error from None


def read_recorded(path: str | os.PathLike[str], setup: Setup, *, salvage: bool = False) -> Log:
    """Read a log as ``read_log`` does, but without the cleaning of sensor faults."""
    file = path_of(path, "path")
    if setup.log.files:
        return read_files(path, setup, salvage=salvage)._replace(file=file)
    with opened(path) as there:
        if is_ros(there):
            return read_ros(there, setup, salvage=salvage)._replace(file=file)
        if suffix_of(there) not in TABLES:
            raise unknown_format(there)
        return read_table(there, setup)._replace(file=file)


def log_of_arrays(
    setup: Setup,
    t: Array | tuple[Array, Array],
    q: Array | None,
    wrench: Array,
    dq: Array | None = None,
    temperature: Array | None = None,
    *,
    orientation: Array | None = None,
    position: Array | None = None,
    angular_velocity: Array | None = None,
    specific_force: Array | None = None,
    columns: Mapping[str, Array] | None = None,
    raw: bool = False,
) -> Log:
    """Make a log from arrays in memory, checked and cleaned as one that ``read_log`` reads.

    Also available as ``Log.from_arrays``.

    Args:
        setup: gives the number of joints and the sign convention of the sensor.
        t: (T,) stamps: floating point in s, or integers in ns; any origin. Or a pair of these, (J,) for the joints
            or the pose and (W,) for wrench and temperature, if the two streams have separate stamps.
        q: (T, n) rad (m); None if the setup has a sensor_pose.
        wrench: (T, 6) N, Nm, sensor frame, as the sensor reports it. NaN = not measured, here and elsewhere.
        dq: (T, n) rad/s (m/s), or None.
        temperature: (T,) deg C, or None.
        orientation: (T, 4) or (T, 3, 3) of the sensor's mount in the base frame, as the setup's sensor_pose states.
        position: (T, 3) m, position of the sensor's mount, base frame.
        angular_velocity: (T, 3) rad/s of an IMU, as the setup's sensor_pose states.
        specific_force: (T, 3) m/s^2, acceleration minus gravity, of the same IMU.
        columns: name -> (T,) further quantities that effects can use, at the stamps (of the wrench).
        raw: keep samples of stuck and clipped axes and repeats as recorded; ``repairs`` lists them.

    Raises:
        LogError: shapes disagree, the clock was set back, a value is infinite, or there is no motion or no wrench.
    """
    times = {"t_joints": t[0], "t_wrench": t[1]} if isinstance(t, tuple) else {"t": t}
    arrays = times | {
        "q": q,
        "wrench": wrench,
        "dq": dq,
        "temperature": temperature,
        "orientation": orientation,
        "position": position,
        "angular_velocity": angular_velocity,
        "specific_force": specific_force,
        **{f"{EXTRA_PREFIX}{name}": values for name, values in (columns or {}).items()},
    }
    given = {name: _unmasked(values) for name, values in arrays.items() if values is not None}
    log = log_from_arrays(given, setup)
    return clean(log, clipped=not raw, stuck=not raw, held=() if raw else STREAMS)


def _unmasked(values: Array) -> Array:
    """NaN where a masked array of NumPy is masked; other arrays as they are."""
    return np.ma.filled(values.astype(float), np.nan) if isinstance(values, np.ma.MaskedArray) else values


Log.from_arrays = staticmethod(log_of_arrays)  # type: ignore[method-assign]
