"""Content of a log, and what can be filtered from it; needs no setup.

For a table or a file of arrays without a setup, this includes the keys of a setup that would describe its streams.
"""

import os
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io import or_poses, read_recorded
from ftbias_jax.io.cleaning import clean
from ftbias_jax.io.draft.rows import time_unit
from ftbias_jax.io.draft.table import ALSO, Table, look, stated_columns
from ftbias_jax.io.health import StreamInfo, stream_info
from ftbias_jax.io.log import Log, Repair
from ftbias_jax.io.pose import STANDARD_GRAVITY
from ftbias_jax.io.ros.choose import wanted_of
from ftbias_jax.io.ros.messages import IMU, JOINT_STATE, JOINTS, POSE, POSITION, TRANSFORM, WRENCH, WRENCH_STAMPED
from ftbias_jax.io.ros.read import log_of, skew
from ftbias_jax.io.ros.record import Recording, Stream, Topic, Wanted, is_ros, read_recording
from ftbias_jax.io.stamps.clock import longer_in_words, one_a_stamp
from ftbias_jax.io.tables.column_names import FIXED, TO_NAME
from ftbias_jax.io.tables.headers import are_counted
from ftbias_jax.io.tables.poses import Poses, as_log
from ftbias_jax.io.tables.streams import read_stream
from ftbias_jax.setup.dump import Known, toml_line, write_template
from ftbias_jax.setup.parse import parse_setup
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import AXES

RATE = {"log.rate": Known(None, "Hz: there are no stamps (t)")}
MOST_NAMES = 40
"""Maximum number of columns that are listed."""
POSE_LABELS = ("x", "y", "z", "qx", "qy", "qz", "qw")


class LogInfo(NamedTuple):
    """Summary of a whole log."""

    streams: tuple[StreamInfo, ...]
    topics: tuple[Topic, ...]
    """Other topics of a recording."""
    repairs: tuple[Repair, ...]
    verdict: str
    """One line: what can be filtered from it, or why nothing."""
    keys: tuple[str, ...] = ()
    """Lines of a setup that describe how to read the log, as far as it shows."""
    others: tuple[str, ...] = ()
    """Columns that are not used."""
    log: Log | None = None
    """The log as read with the setup; None = there is no setup, or it cannot read the log."""
    poses: bool = False
    """Whether the setup reads it as static poses."""


def describe(path: str | os.PathLike[str], setup: Setup | None = None, *, salvage: bool = False) -> LogInfo:
    """Summarise a log: with a setup whether it can be filtered, otherwise its content with the joints as recorded.

    ``salvage`` reads the undamaged part of a damaged recording.
    """
    if is_ros(path):
        return _describe_ros(path, setup, salvage)
    if setup is None:
        table = look(os.fspath(path))
        if table.joints and table.orientation:  # the motion is taken from the joints, as with ftbias setup --robot
            table = table._replace(orientation="", has=table.has | {"pose"})
        if not is_usual(table):
            return look_at(os.fspath(path), table)
        names = table.joint_names
    else:
        names = setup.robot.joint_names
    read = or_poses(read_recorded, path, setup or _setup_of({}, names))
    has_pose = setup is not None and setup.pose is not None
    log = as_log(read) if isinstance(read, Poses) else read
    names = names[: log.q.shape[1]]  # of static poses only the orientation is read
    joints = ~np.isnan(log.q if has_pose else np.column_stack([log.q, log.dq])).all(1)
    shown = ~np.isnan(log.q).all(0) if has_pose else np.full(len(names), True)
    labels = [name for name, there in zip(names, shown, strict=True) if there]
    said = (
        ("pose", "entries that are followed", ())
        if has_pose
        else ("joints", "q" if np.isnan(log.dq).all() else "q, dq", names)
    )
    motion = stream_info(*said, log.start, log.t[joints], log.q[joints][:, shown], labels)
    rows = ~np.isnan(log.wrench).all(1)
    sensed = log.start, log.t[rows], log.wrench[rows], AXES
    wrench = stream_info("wrench", "N, Nm", (), *sensed, sensor=True)
    if longer := longer_in_words(log.t[joints], log.t[rows]):
        wrench = wrench._replace(trouble=(*wrench.trouble, longer))
    streams = (motion, wrench)
    if isinstance(read, Poses):
        counted = streams if read.timed else tuple(stream.without_stamps() for stream in streams)
        return LogInfo(counted, (), read.repairs, f"{len(read.t)} static poses, which show the tool", poses=True)
    verdict = "can be filtered" if setup else f"has {len(names)} joints and a wrench"
    try:
        cleaned = clean(log)
        return LogInfo(streams, (), cleaned.repairs, verdict, log=cleaned if setup else None)
    except LogError as error:
        return LogInfo(streams, (), log.repairs, _nothing(error))


def _describe_ros(path: str | os.PathLike[str], setup: Setup | None, salvage: bool) -> LogInfo:
    has_pose = setup is not None and setup.pose is not None
    wanted = wanted_of(setup) if setup else Wanted(poses=True)
    recording = read_recording(path, salvage=salvage, wanted=wanted)
    shown = [stream for stream in recording.streams if stream.role != TRANSFORM]
    streams = tuple(map(_recorded_info, shown))
    used = {stream.topic.partition(":")[0] for stream in shown}
    others = tuple(topic for topic in recording.topics if topic.name not in used)
    repairs = tuple(Repair(damage, lost=True) for damage in recording.damage)
    roles = {stream.role for stream in recording.streams}
    by_field = has_pose or any(role == POSITION for role, *_ in wanted.fields)
    needed = {WRENCH: f"a wrench ({WRENCH_STAMPED})"} | ({} if by_field else {JOINTS: f"joints ({JOINT_STATE})"})
    missing = [words for role, words in sorted(needed.items()) if role not in roles]
    if setup is None and WRENCH in roles and JOINTS not in roles and roles & {POSE, TRANSFORM}:
        verdict = "has a pose and a wrench, but no joints: a setup with [sensor_pose] reads it"
        return LogInfo(streams, others, repairs, verdict, _pose_keys(recording))
    if missing:
        return LogInfo(streams, others, repairs, f"nothing can be filtered without {' and '.join(missing)}")
    if setup is None:
        return LogInfo(streams, others, repairs, "has joints and a wrench: --setup tells whether they fit")
    try:
        log = clean(log_of(recording, setup, os.fspath(path)))
    except LogError as error:
        return LogInfo(streams, others, repairs, _nothing(error))
    return LogInfo(streams, others, log.repairs, "can be filtered", log=log)


def _nothing(error: LogError) -> str:
    return f"nothing can be filtered: {error.message} ({error.remedy})"


def _recorded_info(stream: Stream) -> StreamInfo:
    known = stream.stamps != 0
    shown = stream.at(known) if known.any() else stream._replace(stamps=stream.logged)
    shown = shown.at(np.argsort(shown.stamps, kind="stable"))
    seconds, start = (shown.stamps - shown.stamps[0]) * 1e-9, float(shown.stamps[0]) * 1e-9
    sensor = stream.role == WRENCH and stream.values.shape[1] == len(AXES)
    labels = _labels(stream, sensor)
    info = stream_info(stream.topic, stream.message_type, stream.names, start, seconds, shown.values, labels, sensor)
    return info._replace(trouble=(*info.trouble, skew(stream)))


def _labels(stream: Stream, sensor: bool) -> Sequence[str]:
    """A name for every column of a stream."""
    if stream.role == JOINTS and stream.names:
        return [*stream.names, *(f"velocity of {name}" for name in stream.names)]
    if stream.role == POSE:
        return POSE_LABELS
    return AXES if sensor else [f"[{i}]" for i in range(stream.values.shape[1])]


def is_usual(table: Table) -> bool:
    """Whether a file has joints and a wrench with stamps under the usual names, and nothing that a setup must state."""
    odd = table.time is not None and len(table.time) > 1 and time_unit(table.time)
    whole = table.joints and "wrench" in table.has and table.time is not None and not table.orientation
    return bool(whole and not odd and not stated_columns(table))


def look_at(path: str, table: Table) -> LogInfo:
    """Summarise what a file, examined by ``look``, has under the usual names."""
    keys = _keys(table)
    rate = {"log.rate": Known(1.0)} if table.time is None else {}  # any rate will do
    setup = _setup_of(keys | rate, table.joint_names or ["q0"])
    quantities = {
        "position": bool(table.orientation or table.joints),
        "velocity": bool(table.orientation or not table.joints) and table.has_imu and not table.static,
        "wrench": "wrench" in table.has,
        "temperature": "temperature" in table.has,
    }
    streams = []
    for quantity in (quantity for quantity, there in quantities.items() if there):
        ((t, arrays),), _ = read_stream(path, (quantity,), setup)
        ((array, values),) = arrays.items()
        values = one_a_stamp(values, len(t), array, path).reshape(len(t), -1)
        rows = np.isfinite(values).any(1)
        name, kind, labels = _said_of(table, quantity, values.shape[1])
        if len(labels) != values.shape[1]:
            message = f"has {values.shape[1]} numbers a sample, not {len(labels)}"
            raise LogError(message, file=path, field=array, remedy="store what its name says")
        start, unit = t[rows][0] if rows.any() else 0, 1e-9 if t.dtype.kind == "i" else 1.0
        seconds = (t[rows] - start) * unit
        info = stream_info(name, kind, (), float(start) * unit, seconds, values[rows], labels, quantity == "wrench")
        streams.append(info if table.time is not None else info.without_stamps())
    lines, others = tuple(_lines(keys)), table.others[:MOST_NAMES]
    return LogInfo(tuple(streams), (), (), _verdict(path, table), lines, others)


def _keys(table: Table) -> dict[str, Known]:
    """Keys of a setup with which the file can be read."""
    keys: dict[str, Known] = {}
    if table.orientation:
        or_else = "" if table.named else f'or "{ALSO[table.orientation]}"'
        keys["sensor_pose.orientation"] = Known(table.orientation, or_else)
    if table.orientation or (table.has_imu and not table.joints):
        linear = {} if table.static else {"accelerometer": "specific_force", "place": "position"}
        keys["sensor_pose.linear"] = Known(next((word for name, word in linear.items() if name in table.has), "none"))
        if "gyroscope" not in table.has:
            keys["sensor_pose.gyroscope"] = Known(False)
    if not table.static and table.time is not None and len(table.time) > 1 and (unit := time_unit(table.time)):
        keys["log.time_unit"] = Known(unit)
    if table.accelerometer is not None:
        lengths = np.linalg.norm(table.accelerometer, axis=1)
        if np.isfinite(lengths).any() and np.nanmedian(lengths) < STANDARD_GRAVITY / 3:
            keys["log.acceleration_unit"] = Known("g")
    keys |= {key: Known(known.value) for key, known in stated_columns(table).items()}
    return keys if table.static or table.time is not None else keys | RATE


def _setup_of(keys: Mapping[str, Known], joint_names: Sequence[str]) -> Setup:
    """A setup only for reading a file: with these joints, unless its keys are of a pose."""
    stated = {"sensor.noise_std": Known(1.0), **keys}
    if not any(key.startswith("sensor_pose.") for key in keys):
        joints = [{"axis": [0, 0, 1], "point": [0, 0, 0], "name": name} for name in joint_names]
        stated |= {"robot.joints": Known(joints), "robot.flange": Known({"translation": [0, 0, 0]})}
    return parse_setup(tomllib.loads(write_template(stated)))


def _said_of(table: Table, quantity: str, width: int) -> tuple[str, str, tuple[str, ...]]:
    """Name and kind of a stream with ``width`` columns, and labels of its columns."""
    name, kind, labels = quantity, "", tuple(f"{quantity} {i}" for i in range(width))
    if quantity == "position":
        name, kind, labels = "joints", "q", tuple(f"q{i}" for i in range(width))
        if table.orientation:
            name, kind, labels = "pose", table.orientation, FIXED[table.orientation][0]
            if not table.named:
                kind = f"{kind} or {ALSO[kind]}"
            if width > len(labels):
                kind, labels = f"{kind} and position", (*labels, "x", "y", "z")
    elif quantity == "velocity":
        parts = {"angular velocity": ("wx", "wy", "wz")} if "gyroscope" in table.has else {}
        parts |= {"acceleration": ("ax", "ay", "az")} if "accelerometer" in table.has else {}
        name, kind, labels = "imu", " and ".join(parts), sum(parts.values(), ())
    elif quantity == "wrench":
        kind, labels = "N, Nm", AXES
    return name, kind, labels


def _lines(keys: Mapping[str, Known]) -> list[str]:
    """The keys as lines of a setup."""
    lines = []
    for section in ("sensor_pose", "log", "log.columns"):
        mine = {key: known for key, known in keys.items() if key.rpartition(".")[0] == section}
        lines += [f"[{section}]"] if mine else []
        for key, (value, remark) in mine.items():
            name = key.rpartition(".")[2]
            lines.append(f"{name} = ...  # {remark}" if value is None else toml_line(name, value, remark))
    return lines


def _verdict(path: str, table: Table) -> str:
    joints = f"{table.joints} joints" + " (and a pose, read without --robot)" * ("pose" in table.has)
    motion = "the pose of the sensor's mount" if table.orientation else joints if table.joints else ""
    parts = [motion, "an IMU" if table.has_imu else "", "a wrench" if "wrench" in table.has else ""]
    found = " and ".join(part for part in parts if part)
    name = Path(path).name
    if are_counted(table.header):
        return f"its columns have no names: {TO_NAME}"
    if not found:
        return (
            f"has no columns with known names: ftbias setup {name} --robot NAME -o setup.toml writes a setup "
            "whose [log.columns] lists what to choose from"
        )
    rate = " --rate HZ" if table.time is None and not table.static else ""
    robot = " --robot NAME" if table.joints else ""
    if motion and "wrench" in table.has:
        found += ", each row as of a pose at rest" if table.static else ""
        still = " (a log of motion: with --rate HZ)" if table.static and table.time is None else ""
        return f"has {found}: ftbias setup {name}{robot}{rate} -o setup.toml finds out how they were recorded{still}"
    missing = "the wrench" if motion else "joints or a pose" + ("" if "wrench" in table.has else " and the wrench")
    return (
        f"has {found}, but not {missing}: if that is in other files, ftbias setup {name} OTHERS{robot}{rate} "
        "-o setup.toml writes [log.files]"
    )


def _pose_keys(recording: Recording) -> tuple[str, ...]:
    """Lines of a setup that reads a ROS recording with poses instead of joints."""
    roles = {stream.role for stream in recording.streams}
    lines = ["[sensor_pose]"]
    if POSE not in roles:
        frames = sorted({stream.names[1] for stream in recording.streams if stream.role == TRANSFORM})
        lines.append(f"frame = ...  # what the sensor is mounted on, of TF's frames {', '.join(frames[:MOST_NAMES])}")
    lines.append(toml_line("linear", "position", 'or "specific_force", by the IMU' if IMU in roles else ""))
    return tuple(lines)
