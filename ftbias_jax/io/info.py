"""What is in a log, and what can be filtered from it; needs no setup."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io import read_recorded
from ftbias_jax.io.cleaning import clean
from ftbias_jax.io.draft.table import look
from ftbias_jax.io.draft.unstated import is_usual, look_at, pose_keys, robot_of
from ftbias_jax.io.health import StreamInfo, stream_info
from ftbias_jax.io.log import Log, Repair
from ftbias_jax.io.ros.choose import wanted_of
from ftbias_jax.io.ros.messages import JOINT_STATE, JOINTS, POSE, POSITION, TRANSFORM, WRENCH, WRENCH_STAMPED
from ftbias_jax.io.ros.read import log_of, skew
from ftbias_jax.io.ros.record import Stream, Topic, Wanted, is_ros, read_recording
from ftbias_jax.setup.parse import parse_setup
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import AXES

POSE_LABELS = ("x", "y", "z", "qx", "qy", "qz", "qw")


class LogInfo(NamedTuple):
    """A whole log."""

    streams: tuple[StreamInfo, ...]
    topics: tuple[Topic, ...]
    """Other topics of a recording."""
    repairs: tuple[Repair, ...]
    verdict: str
    """One line: what can be filtered from it, or why nothing."""
    usable: bool
    keys: tuple[str, ...] = ()
    """Lines of a setup that say how to read it, as far as it shows."""
    others: tuple[str, ...] = ()
    """Columns that nothing is made of."""
    log: Log | None = None
    """As the setup reads it; None = there is no setup, or it does not."""


def describe(path: str | os.PathLike[str], setup: Setup | None = None, *, salvage: bool = False) -> LogInfo:
    """Look into a log.

    Args:
        path: the log.
        setup: judge whether the log can be filtered with it; None = take joints as they come.
        salvage: of a damaged recording, read what is whole.
    """
    if is_ros(path):
        return _describe_ros(path, setup, salvage)
    if setup is None:
        table = look(os.fspath(path))
        if not is_usual(table):
            unstated = look_at(os.fspath(path), table)
            return LogInfo(unstated.streams, (), (), unstated.verdict, False, unstated.keys, unstated.others)
        names = table.joint_names
    else:
        names = setup.robot.joint_names
    log = read_recorded(path, setup or parse_setup(robot_of(names)))
    has_pose = setup is not None and setup.pose is not None
    joints = ~np.isnan(log.q if has_pose else np.column_stack([log.q, log.dq])).all(1)
    shown = ~np.isnan(log.q).all(0) if has_pose else np.full(len(names), True)
    labels = [name for name, there in zip(names, shown, strict=True) if there]
    said = ("pose", "entries that are followed", ()) if has_pose else ("joints", "q, dq", names)
    motion = stream_info(*said, log.start, log.t[joints], log.q[joints][:, shown], labels)
    rows = ~np.isnan(log.wrench).all(1)
    sensed = log.start, log.t[rows], log.wrench[rows], AXES
    streams = (motion, stream_info("wrench", "N, Nm", (), *sensed, sensor=True))
    verdict = "can be filtered" if setup else f"has {len(names)} joints and a wrench"
    try:
        cleaned = clean(log)
        return LogInfo(streams, (), cleaned.repairs, verdict, True, log=cleaned if setup else None)
    except LogError as error:
        return LogInfo(streams, (), log.repairs, _nothing(error), False)


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
    by_field = has_pose or any(field.role == POSITION for field in wanted.fields)
    needed = {WRENCH: f"a wrench ({WRENCH_STAMPED})"} | ({} if by_field else {JOINTS: f"joints ({JOINT_STATE})"})
    missing = [words for role, words in sorted(needed.items()) if role not in roles]
    if setup is None and WRENCH in roles and JOINTS not in roles and roles & {POSE, TRANSFORM}:
        verdict = "has a pose and a wrench, but no joints: a setup with [sensor_pose] reads it"
        return LogInfo(streams, others, repairs, verdict, False, pose_keys(recording))
    if missing:
        return LogInfo(streams, others, repairs, f"nothing can be filtered without {' and '.join(missing)}", False)
    if setup is None:
        return LogInfo(streams, others, repairs, "has joints and a wrench: --setup tells whether they fit", True)
    try:
        log = clean(log_of(recording, setup, os.fspath(path)))
    except LogError as error:
        return LogInfo(streams, others, repairs, _nothing(error), False)
    return LogInfo(streams, others, log.repairs, "can be filtered", True, log=log)


def _nothing(error: LogError) -> str:
    return f"nothing can be filtered: {error.message} ({error.remedy})"


def _recorded_info(stream: Stream) -> StreamInfo:
    known = stream.stamps != 0
    t = np.sort(stream.stamps[known] if known.any() else stream.logged)
    seconds, start = (t - t[0]) * 1e-9, float(t[0]) * 1e-9
    order = np.argsort(stream.stamps[known] if known.any() else stream.logged, kind="stable")
    values = stream.values[known if known.any() else slice(None)][order]
    sensor = stream.role == WRENCH and stream.values.shape[1] == len(AXES)
    labels = _labels(stream, sensor)
    info = stream_info(stream.topic, stream.message_type, stream.names, start, seconds, values, labels, sensor)
    return info._replace(trouble=(*info.trouble, skew(stream)))


def _labels(stream: Stream, sensor: bool) -> Sequence[str]:
    """A name for every column of a stream."""
    if stream.role == JOINTS and stream.names:
        return [*stream.names, *(f"velocity of {name}" for name in stream.names)]
    if stream.role == POSE:
        return POSE_LABELS
    return AXES if sensor else [f"[{i}]" for i in range(stream.values.shape[1])]
