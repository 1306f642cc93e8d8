"""Logs as named arrays, whatever file they come from: the names of the native format."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.check import check_log
from ftbias_jax.io.clock import as_stamps, put_in_order
from ftbias_jax.io.conventions.units import rows_at_rate, stamps
from ftbias_jax.io.log import Log
from ftbias_jax.io.merge import merge_streams
from ftbias_jax.setup.recorded import PoseSetup
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

STAMPS = ("t", "t_joints", "t_wrench")
ARRAYS = ("t", "t_joints", "t_wrench", "q", "dq", "wrench", "temperature")
POSE_ARRAYS = ("orientation", "position", "angular_velocity", "specific_force")
"""Instead of q and dq, where the setup has a sensor_pose."""


QUANTITIES = {
    "time": STAMPS,
    "position": ("q", "orientation", "position"),
    "velocity": ("dq", "angular_velocity", "specific_force"),
    "wrench": ("wrench",),
    "temperature": ("temperature",),
}
"""Key of [log.columns] -> the array that its columns are, and others that would be read in its place."""


def wanted_arrays(setup: Setup) -> tuple[str, ...]:
    """Names of the arrays that a log may have: the native ones, and those of [log.columns]."""
    stated = (setup.log.columns[key] for key in QUANTITIES if key in setup.log.columns)
    named = (name for names in stated for name in ((names,) if isinstance(names, str) else names))
    return tuple(dict.fromkeys((*ARRAYS, *POSE_ARRAYS, *named)))


def by_native_names(arrays: Mapping[str, Array], setup: Setup, file: str = "") -> dict[str, Array]:
    """The arrays with those that [log.columns] of the setup names in the places of the native ones.

    Args:
        arrays: of ``wanted_arrays``, by their names in the file.
        setup: [log.columns] names one array (T,) for each joint or channel, or one for time and temperature.
        file: the name in messages.
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
    """A log of t (T,), q (T, n), wrench (T, 6), and if there dq (T, n) and temperature (T,).

    Instead of t, t_joints (J,) may stamp q and dq, and t_wrench (W,) the wrench and the temperature; a setup that
    states log.rate needs no stamps.
    """
    if setup.pose is not None:
        arrays = with_pose(arrays, setup.pose, file)
    q = _get(arrays, "q", "no motion data: there is no array q (T, n) rad", file)
    wrench = _get(arrays, "wrench", "no wrench data: there is no array wrench (T, 6) N, Nm", file)
    dq, temperature = arrays.get("dq"), arrays.get("temperature")
    counted = rows_at_rate(wrench, setup.log)
    if counted is not None:
        return log_of_table(counted, q, wrench, dq, temperature, setup, file)
    arrays = {name: stamps(values, setup.log) if name in STAMPS else values for name, values in arrays.items()}
    if "t" in arrays:
        if {"t_joints", "t_wrench"} & arrays.keys():
            message = "stands beside t_joints or t_wrench"
            raise LogError(message, file=file, field="t", remedy="keep t, or the stamps of the two streams")
        return log_of_table(arrays["t"], q, wrench, dq, temperature, setup, file)
    t_joints = _get(arrays, "t_joints", "there is no time: neither t (T,) s, nor t_joints with t_wrench", file)
    t_wrench = _get(arrays, "t_wrench", "there is t_joints, but no t_wrench", file)
    return _log_of_two(t_joints, t_wrench, q, wrench, dq, temperature, setup, file)


def log_of_table(
    t: Array, q: Array, wrench: Array, dq: Array | None, temperature: Array | None, setup: Setup, file: str
) -> Log:
    """A log whose samples have one stamp each; of two clocks nevertheless, if the setup states their offsets."""
    if setup.log.time_offsets:
        t = as_stamps(t, file=file)
        return _log_of_two(t, t, q, wrench, dq, temperature, setup, file)
    return check_log(t, q, wrench, dq, temperature, setup=setup, file=file)


def _log_of_two(
    t_joints: Array,
    t_wrench: Array,
    q: Array,
    wrench: Array,
    dq: Array | None,
    temperature: Array | None,
    setup: Setup,
    file: str,
) -> Log:
    """A log of two streams."""
    joints = put_in_order(t_joints, {"q": q, "dq": dq}, "samples of the joints", file=file, field="t_joints")
    readings = {"wrench": wrench, "temperature": temperature}
    sensor = put_in_order(t_wrench, readings, "samples of the wrench", file=file, field="t_wrench")
    (q, dq), (wrench, temperature) = joints.columns, sensor.columns
    offsets = setup.log.time_offsets
    merged = merge_streams(joints.t, q, sensor.t, wrench, dq, temperature, offsets=offsets, file=file)
    repairs = (*joints.repairs, *sensor.repairs)
    return check_log(
        *(merged.t, merged.q, merged.wrench, merged.dq, merged.temperature), setup=setup, file=file, repairs=repairs
    )


def with_pose(arrays: Mapping[str, Array], pose: PoseSetup, file: str) -> dict[str, Array]:
    """The arrays with those of the pose side by side as q and dq."""
    joined = {name: values for name, values in arrays.items() if name not in POSE_ARRAYS}
    if "q" not in joined or "orientation" in arrays:  # [log.columns] may have named what it is made of
        joined["q"] = joined_pose(arrays, pose, "q", file)
    if any(part in arrays for part in _pose_parts(arrays, pose)["dq"]):
        joined["dq"] = joined_pose(arrays, pose, "dq", file)
    return joined


def joined_pose(arrays: Mapping[str, Array], pose: PoseSetup, name: str, file: str) -> Array:
    """The arrays of a pose side by side as q, or those of its IMU as dq."""
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
