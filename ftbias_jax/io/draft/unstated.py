"""What a table or a file of arrays has that no setup describes: its streams, and the keys that would state them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.draft.columns import nested, stated_columns
from ftbias_jax.io.draft.table import Table, time_unit
from ftbias_jax.io.health import StreamInfo, stream_info
from ftbias_jax.io.pose import STANDARD_GRAVITY
from ftbias_jax.io.ros.messages import IMU, POSE, TRANSFORM
from ftbias_jax.io.ros.record import Recording
from ftbias_jax.io.tables.headers import FIXED
from ftbias_jax.io.tables.streams import read_stream
from ftbias_jax.setup.keys.toml_text import toml_line
from ftbias_jax.setup.parse import parse_setup
from ftbias_jax.types import AXES

MOST_NAMES = 40
"""Columns that are listed."""


class Unstated(NamedTuple):
    """A whole file."""

    streams: tuple[StreamInfo, ...]
    others: tuple[str, ...]
    """Columns that nothing was made of."""
    keys: tuple[str, ...]
    """Lines of a setup that say how to read it."""
    verdict: str


def is_usual(table: Table) -> bool:
    """Whether a file has joints and a wrench with their stamps by the usual names, and nothing that must be stated."""
    odd = table.time is not None and len(table.time) > 1 and time_unit(table.time)
    whole = table.joints and table.wrench and table.time is not None and not table.orientation
    return bool(whole and not odd and not stated_columns(table))


def look_at(path: str, table: Table) -> Unstated:
    """What a file, which ``look`` has looked into, has by the usual names."""
    stated = _stated(table)
    read = {**stated, "log": {"rate": 1.0, **stated.get("log", {})}} if table.time is None else stated
    robot = robot_of(table.joint_names or ["q0"])
    if table.orientation or _has_imu(table):
        del robot["robot"]
    setup = parse_setup({**robot, **read})
    streams = []
    for quantity, there in _quantities(table).items():
        if there:
            ((t, arrays),), _ = read_stream(path, (quantity,), setup)
            ((array, values),) = arrays.items()
            if values.ndim == 0 or len(values) != len(t) or values.dtype.kind not in "fiu":
                message = f"has shape {values.shape} and type {values.dtype} for {len(t)} stamps"
                raise LogError(message, file=path, field=array, remedy="give one sample of real numbers per stamp")
            values = values.reshape(len(t), -1)
            rows = np.isfinite(values).any(1)
            name, kind, labels = _said_of(table, quantity, values.shape[1])
            if len(labels) != values.shape[1]:
                message = f"has {values.shape[1]} numbers a sample, not {len(labels)}"
                raise LogError(message, file=path, field=array, remedy="store what its name says")
            unit = 1e-9 if t.dtype.kind == "i" else 1.0
            start = t[rows][0] if rows.any() else 0
            seconds = (t[rows] - start) * unit
            sensor = quantity == "wrench"
            info = stream_info(name, kind, (), float(start) * unit, seconds, values[rows], labels, sensor)
            streams.append(info if table.time is not None else info.without_stamps())
    return Unstated(tuple(streams), table.others[:MOST_NAMES], tuple(_lines(stated, table)), _verdict(path, table))


def _quantities(table: Table) -> dict[str, bool]:
    """[log.files]' names of what a file has."""
    return {
        "position": bool(table.orientation or table.joints),
        "velocity": bool(table.orientation or not table.joints) and _has_imu(table),
        "wrench": table.wrench,
        "temperature": table.temperature,
    }


def _has_imu(table: Table) -> bool:
    return table.gyroscope or table.accelerometer is not None


def _stated(table: Table) -> dict[str, Any]:
    """Tables of a setup that read the file."""
    stated: dict[str, Any] = {}
    if table.orientation or (_has_imu(table) and not table.joints):
        pose: dict[str, Any] = {"orientation": table.orientation or "quaternion_xyzw", "linear": "none"}
        if table.accelerometer is not None:
            pose["linear"] = "specific_force"
        elif table.position:
            pose["linear"] = "position"
        if not table.gyroscope:
            pose["gyroscope"] = False
        stated["sensor_pose"] = pose
    log: dict[str, Any] = {}
    if table.time is not None and len(table.time) > 1 and (unit := time_unit(table.time)):
        log["time_unit"] = unit
    if table.accelerometer is not None:
        lengths = np.linalg.norm(table.accelerometer, axis=1)
        if np.isfinite(lengths).any() and np.nanmedian(lengths) < STANDARD_GRAVITY / 3:
            log["acceleration_unit"] = "g"
    log |= nested(stated_columns(table)).get("log", {})
    return stated | ({"log": log} if log else {})


def robot_of(joint_names: Sequence[str]) -> dict[str, Any]:
    """A robot of these joints, in a setup that reads a file and means nothing else."""
    joints = [{"axis": [0, 0, 1], "point": [0, 0, 0], "name": name} for name in joint_names]
    return {"robot": {"joints": joints, "flange": {"translation": [0, 0, 0]}}, "sensor": {"noise_std": 1.0}}


def _said_of(table: Table, quantity: str, width: int) -> tuple[str, str, tuple[str, ...]]:
    """Name and kind of a stream of so many numbers, and names for its columns."""
    name, kind, labels = quantity, "", tuple(f"{quantity} {i}" for i in range(width))
    if quantity == "position":
        name, kind, labels = "joints", "q", tuple(f"q{i}" for i in range(width))
        if table.orientation:
            name, kind, labels = "pose", table.orientation, FIXED[table.orientation][0]
            if not table.named:
                kind = "quaternion_xyzw or quaternion_wxyz"
            if width > len(labels):
                kind, labels = f"{kind} and position", (*labels, "x", "y", "z")
    elif quantity == "velocity":
        parts = {"angular velocity": ("wx", "wy", "wz")} if table.gyroscope else {}
        parts |= {"acceleration": ("ax", "ay", "az")} if table.accelerometer is not None else {}
        name, kind, labels = "imu", " and ".join(parts), sum(parts.values(), ())
    elif quantity == "wrench":
        kind, labels = "N, Nm", AXES
    return name, kind, labels


def _lines(stated: Mapping[str, Mapping[str, Any]], table: Table) -> list[str]:
    """The tables as lines of a setup."""
    lines = []
    tables = {name: dict(values) for name, values in stated.items()}
    if not table.orientation:
        tables.get("sensor_pose", {}).pop("orientation", None)
    if table.time is None:
        tables.setdefault("log", {})["rate"] = None
    for name, values in tables.items():
        columns = values.pop("columns", {}) if name == "log" else {}
        lines += [f"[{name}]"] if values else []
        for key, value in values.items():
            if key == "rate":
                lines.append("rate = ...  # Hz: there are no stamps (t)")
                continue
            either = key == "orientation" and table.orientation and not table.named
            lines.append(toml_line(key, value, 'or "quaternion_wxyz"' if either else ""))
        lines += ["[log.columns]", *(toml_line(key, value) for key, value in columns.items())] if columns else []
    return lines


def _verdict(path: str, table: Table) -> str:
    motion = "the pose of the sensor's mount" if table.orientation else f"{table.joints} joints" if table.joints else ""
    parts = [motion, "an IMU" if _has_imu(table) else "", "a wrench" if table.wrench else ""]
    found = " and ".join(part for part in parts if part)
    name = Path(path).name
    if not found:
        return (
            f"has nothing that is known by its name: ftbias setup {name} --robot NAME -o setup.toml writes a setup "
            "whose [log.columns] lists what to choose from"
        )
    rate = " --rate HZ" if table.time is None else ""
    robot = " --robot NAME" if table.joints and not table.orientation else ""
    if motion and table.wrench:
        still = "; static poses need no stamps for ftbias identify" if table.time is None else ""
        return f"has {found}: ftbias setup {name}{robot}{rate} -o setup.toml finds out how they were recorded{still}"
    missing = "the wrench" if motion else "joints or a pose" + ("" if table.wrench else " and the wrench")
    return (
        f"has {found}, but not {missing}: if that is in other files, ftbias setup {name} OTHERS{robot}{rate} "
        "-o setup.toml writes [log.files]"
    )


def pose_keys(recording: Recording) -> tuple[str, ...]:
    """Lines of a setup that reads a recording of ROS with poses instead of joints."""
    roles = {stream.role for stream in recording.streams}
    lines = ["[sensor_pose]"]
    if POSE not in roles:
        frames = sorted({stream.names[1] for stream in recording.streams if stream.role == TRANSFORM})
        lines.append(f"frame = ...  # what the sensor is mounted on, of TF's frames {', '.join(frames[:MOST_NAMES])}")
    lines.append(toml_line("linear", "position", 'or "specific_force", by the IMU' if IMU in roles else ""))
    return tuple(lines)
