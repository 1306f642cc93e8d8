"""Logs as recordings of ROS 1 and 2: topics found by their type, joints matched by their names."""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.check import check_log
from ftbias_jax.io.clock import choose_clock, continue_after_jumps, order_repairs, tidy
from ftbias_jax.io.log import Log, Repair
from ftbias_jax.io.merge import merge_streams
from ftbias_jax.io.ros.messages import JOINT_STATE, WRENCH_STAMPED
from ftbias_jax.io.ros.pose import as_one, in_setup_order, pose_streams
from ftbias_jax.io.ros.record import Recording, Stream, read_recording
from ftbias_jax.setup.fields import nearest
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

CREDIBLE_DELAY = 10**10
"""ns: how much more or less than usual a message of a damaged recording may be late."""


def read_ros(path: str | os.PathLike[str], setup: Setup, *, salvage: bool = False) -> Log:
    """Read a ROS 1 bag, or a ROS 2 bag: its folder, or a ``.db3`` or ``.mcap`` file.

    If the setup has a sensor_pose, it comes from a topic of geometry_msgs/PoseStamped, or from TF. Otherwise the joints
    come from all publishers of one topic of sensor_msgs/JointState, the wrench from one topic of
    geometry_msgs/WrenchStamped; messages about other joints, such as a gripper's, are ignored.

    Args:
        path: the recording.
        setup: [log.topics] chooses where there are several.
        salvage: skip what is damaged.

    Raises:
        LogError: it cannot be read, has no or several topics to choose from, or cannot be filtered (``check_log``).
    """
    return log_of(read_recording(path, salvage=salvage, poses=setup.pose is not None), setup, os.fspath(path))


def log_of(recording: Recording, setup: Setup, file: str = "") -> Log:
    """The log in a recording that is read already; see ``read_ros``."""
    names = setup.robot.joint_names
    mended = [Repair(damage, lost=True) for damage in recording.damage]
    if mended:
        recording = _credible(recording, mended)
    if setup.pose is None:
        joints = _joint_positions(_choose("joints", _joint_streams(recording, names, file), setup, file), names)
    else:
        joints = as_one(_choose("pose", pose_streams(recording, setup.pose, file), setup, file), file)
        joints = joints._replace(values=in_setup_order(joints.values, setup.pose))
    wrench = _wrenches(_choose("wrench", _wrench_streams(recording, file), setup, file), file)

    clock = choose_clock((joints.stamps, wrench.stamps), (joints.logged, wrench.logged))
    if clock.complaint:
        mended.append(Repair(f"{clock.complaint}: times of the recorder used; {skew(joints)}, {skew(wrench)}"))
    known = [t != 0 for t in clock.stamps]
    stamps, jumps = continue_after_jumps([t[rows] for t, rows in zip(clock.stamps, known, strict=True)], file)
    if jumps:
        mended.append(Repair(f"the clock jumps back ({jumps} in all): what follows is put 1 s after what was before"))
    (joint_t, motion), (wrench_t, readings) = (
        _in_order(t, stream, rows, mended) for t, stream, rows in zip(stamps, (joints, wrench), known, strict=True)
    )
    n = len(names)
    q, dq = (motion[:, :n], motion[:, n:]) if setup.pose is None else (motion, None)
    merged = merge_streams(joint_t, q, wrench_t, readings, dq, file=file)
    log = check_log(merged.t, merged.q, merged.wrench, merged.dq, setup=setup, file=file, repairs=tuple(mended))
    return log._replace(frame=wrench.names[0])


def _credible(recording: Recording, mended: list[Repair]) -> Recording:
    """What is left of a damaged recording without stamps and frames that a flipped bit may have made."""
    wrenches = [stream for stream in recording.streams if stream.message_type == WRENCH_STAMPED]
    kept = []
    for stream in recording.streams:
        most = max((len(other.stamps) for other in wrenches if other.topic == stream.topic), default=0)
        late = stream.logged - stream.stamps
        believed = np.abs(late - np.median(late)) < CREDIBLE_DELAY
        if stream.message_type == WRENCH_STAMPED and len(stream.stamps) < most / 2:
            believed = np.zeros_like(believed)
        if believed.any():
            columns = {name: getattr(stream, name)[believed] for name in ("stamps", "logged", "order", "values")}
            kept.append(stream._replace(**columns))
        if not believed.all():
            what = (
                f"{(~believed).sum()} of the samples of {stream.topic} left out: their stamp or frame is not credible"
            )
            mended.append(Repair(what, lost=True))
    mended.append(Repair(f"{sum(topic.messages for topic in recording.topics)} messages were recovered"))
    return recording._replace(streams=tuple(kept))


def skew(stream: Stream) -> str:
    """How far the recorder's clock is from that of a stream's headers, in words."""
    stamped = stream.stamps != 0
    if not stamped.any():
        return f"{stream.topic} has no stamps"
    ahead = np.median((stream.logged - stream.stamps)[stamped]) * 1e-9
    return f"{stream.topic} was recorded {abs(ahead):.3g} s {'after' if ahead >= 0 else 'before'} its stamps"


def _in_order(t: Array, stream: Stream, known: Array, mended: list[Repair]) -> tuple[Array, Array]:
    """Stamps and values of the known rows in increasing order; what that took is added to ``mended``."""
    ordered = tidy(t, stream.values[known])
    mended.extend(order_repairs(ordered, f"samples of {stream.topic}"))
    if not known.all():
        what = f"{(~known).sum()} of the samples of {stream.topic} left out: they have no stamp"
        mended.append(Repair(what, lost=True))
    return ordered.t, ordered.values


def _joint_streams(recording: Recording, names: Sequence[str], file: str) -> list[Stream]:
    """The streams that have any of the arm's joints."""
    found = [stream for stream in recording.streams if stream.message_type == JOINT_STATE]
    if not found:
        message = f"no motion data: no topic has the type {JOINT_STATE}"
        raise LogError(message, file=file, field="joints", remedy=_recorded(recording))
    of_arm = [stream for stream in found if set(stream.names) & set(names)]
    if not of_arm:
        listed = "; ".join(f"{stream.topic} has {', '.join(stream.names)}" for stream in found[:8])
        message = f"no motion data: none of the setup's joints {', '.join(names)} is recorded ({listed})"
        raise LogError(message, file=file, field="joints", remedy="name the robot's joints in the setup as in the log")
    return of_arm


def _wrench_streams(recording: Recording, file: str) -> list[Stream]:
    found = [stream for stream in recording.streams if stream.message_type == WRENCH_STAMPED]
    if not found:
        message = f"no wrench data: no topic has the type {WRENCH_STAMPED}"
        raise LogError(message, file=file, field="wrench", remedy=_recorded(recording))
    return found


def _choose(what: str, streams: Sequence[Stream], setup: Setup, file: str) -> list[Stream]:
    """The streams of the topic that the setup names, or of the only one there is."""
    topics = sorted({stream.topic for stream in streams})
    topic = setup.log.topics.get(what, topics[0])
    field = f"log.topics.{what}"
    if topic not in topics:
        message = f"the setup names {topic!r}, which has no {what} for it"
        raise LogError(message, file=file, field=field, remedy=nearest(topic, topics))
    if len(topics) > 1 and what not in setup.log.topics:
        message = f"{len(topics)} topics have {what}: {', '.join(topics)}"
        remedy = f'choose in the setup: [log.topics] {what} = "{topics[0]}"'
        raise LogError(message, file=file, field=field, remedy=remedy)
    return [stream for stream in streams if stream.topic == topic]


def _joint_positions(streams: Sequence[Stream], names: Sequence[str]) -> Stream:
    """All publishers of a topic as one stream, with columns for the joints of the arm in the setup's order."""
    n = len(names)
    placed = []
    for stream in streams:
        values = np.full((len(stream.stamps), 2 * n), np.nan)
        for column, name in enumerate(stream.names):
            if name in names:
                at, k = names.index(name), len(stream.names)
                values[:, [at, n + at]] = stream.values[:, [column, k + column]]
        placed.append(stream._replace(names=tuple(names), values=values))
    return _interleave(placed)


def _wrenches(streams: Sequence[Stream], file: str) -> Stream:
    if len(streams) > 1:
        frames = ", ".join(repr(stream.names[0]) for stream in streams[:8])
        message = f"the wrenches of {streams[0].topic} are in several frames: {frames}"
        raise LogError(message, file=file, field="wrench", remedy="record one sensor on a topic")
    return streams[0]


def _interleave(streams: Sequence[Stream]) -> Stream:
    """Streams of the same columns as one, in the order in which the messages were stored."""
    stamps, logged, order, values = (
        np.concatenate([getattr(stream, name) for stream in streams])
        for name in ("stamps", "logged", "order", "values")
    )
    rows = np.argsort(order)
    return streams[0]._replace(stamps=stamps[rows], logged=logged[rows], order=order[rows], values=values[rows])


def _recorded(recording: Recording) -> str:
    """What there is instead, as a remedy."""
    topics = [f"{topic.name} ({topic.message_type})" for topic in recording.topics]
    return (
        f"record it; there is {', '.join(topics[:12])}{', ...' if len(topics) > 12 else ''}" if topics else "record it"
    )
