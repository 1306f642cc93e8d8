"""Selection of the streams of a recording that make up a log: by their types, or as the setup names them."""

from collections.abc import Collection, Sequence

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.ros.messages import (
    BY_FIELD,
    IMU,
    JOINT_STATE,
    JOINTS,
    POSITION,
    SOURCES,
    TEMPERATURE,
    VELOCITY,
    WRENCH,
    WRENCH_STAMPED,
)
from ftbias_jax.io.ros.pose import in_setup_order, pose_streams
from ftbias_jax.io.ros.record import Recording, Stream, Wanted
from ftbias_jax.setup.fields import nearest
from ftbias_jax.setup.recorded import PoseSetup
from ftbias_jax.setup.types import Setup

Chosen = dict[str, tuple[str, Stream]]
"""Array of a log ("q", "dq", "wrench" or "temperature") -> its role, as used in [log.clocks], and its stream."""


def refuse_columns(setup: Setup, quantities: Collection[str], file: str = "") -> None:
    """Refuse [log.columns] for quantities that are read from a recording, which has no columns."""
    for key in setup.log.columns:
        if key in quantities:
            remedy = "name fields of messages in [log.topics], or write the log as .npz, .csv or .parquet"
            message = f"[log.columns] of the setup names {key}, but a recording of ROS has no columns"
            raise LogError(message, file=file, remedy=remedy)


def wanted_of(setup: Setup) -> Wanted:
    """What a setup requires from a recording besides joints, wrenches and temperatures."""
    named = [(role, *topic.partition(":")) for role, topic in setup.log.topics.items() if role in BY_FIELD]
    fields = tuple((role, topic, path) for role, topic, colon, path in named if colon)
    return Wanted(setup.pose is not None, fields)


def choose(recording: Recording, quantities: Sequence[str], setup: Setup, file: str) -> Chosen:
    """Select the streams of the wanted quantities, of which the first is required."""
    first, chosen = quantities[0], Chosen()
    if "velocity" in quantities:
        chosen |= _choose_rates(recording, setup, file)
        if first == "velocity" and not chosen and setup.pose is not None:
            remedy = 'name its topic in the setup: [log.topics] imu = "..." or velocity = "/topic:field"'
            raise LogError("there is no IMU", file=file, field="velocity", remedy=remedy)
    if "position" in quantities or (first == "velocity" and not chosen):  # joint messages hold velocities too
        chosen = _choose_motion(recording, setup, file) | chosen
    if "wrench" in quantities:
        chosen |= _choose_readings(recording, setup, file)
    elif "temperature" in quantities:
        chosen |= _choose_temperature(recording, setup, file)
    if not chosen:
        remedy = 'name it in the setup: [log.topics] temperature = "..."'
        raise LogError("no topic, or several, have a temperature", file=file, field="temperature", remedy=remedy)
    return chosen


def _choose_motion(recording: Recording, setup: Setup, file: str) -> Chosen:
    """Stream of the joint positions, or of the pose if the setup has a sensor_pose."""
    if POSITION in setup.log.topics:
        width = len(setup.robot.joint_names) if setup.pose is None else setup.pose.columns[0]
        return {"q": (POSITION, _by_fields(recording, POSITION, width, setup, file))}
    if setup.pose is None:
        streams = _choose(JOINTS, _joint_streams(recording, setup, file), setup, file)
        return {"q": (JOINTS, _joint_positions(streams, setup.robot.joint_names, file))}
    poses = _choose("pose", pose_streams(recording, setup.pose, file), setup, file)
    pose = _in_one_frame(poses, "poses", "pose", "record one body on a topic", file)
    return {"q": ("pose", pose._replace(values=in_setup_order(pose.values, setup.pose)))}


def _choose_rates(recording: Recording, setup: Setup, file: str) -> Chosen:
    """Stream of joint velocities, or of an IMU, if they are in other messages than the positions; otherwise {}."""
    if VELOCITY in setup.log.topics:
        width = len(setup.robot.joint_names) if setup.pose is None else setup.pose.columns[1]
        return {"dq": (VELOCITY, _by_fields(recording, VELOCITY, width, setup, file))}
    imu = None if setup.pose is None else _choose_imu(recording, setup, setup.pose, file)
    return {} if imu is None else {"dq": (IMU, imu)}


def _choose_readings(recording: Recording, setup: Setup, file: str) -> Chosen:
    """Stream of the wrench, and of the temperature if there is one."""
    found = _of_role(recording, WRENCH, setup)
    if not found:
        raise _missing(recording, f"no wrench data: no topic has the type {WRENCH_STAMPED}", WRENCH, file)
    wrenches = _choose(WRENCH, found, setup, file)
    wrench = _in_one_frame(wrenches, "wrenches", WRENCH, "record one sensor on a topic", file)
    return {"wrench": (WRENCH, _check_width(wrench, WRENCH, 6, file)), **_choose_temperature(recording, setup, file)}


def _in_one_frame(streams: Sequence[Stream], what: str, field: str, remedy: str, file: str) -> Stream:
    """The only stream of a topic, whose messages must all be in one frame."""
    if len(streams) > 1:
        frames = ", ".join(repr(stream.names[0]) for stream in streams[:8])
        message = f"the {what} of {streams[0].topic} are in several frames: {frames}"
        raise LogError(message, file=file, field=field, remedy=remedy)
    return streams[0]


def _choose_temperature(recording: Recording, setup: Setup, file: str) -> Chosen:
    """Stream of the temperature; {} if there is none, or if there are several and the setup names none of them."""
    found = _of_role(recording, TEMPERATURE, setup)
    named = TEMPERATURE in setup.log.topics
    if not named and len({(stream.topic, stream.names) for stream in found}) != 1:
        return {}
    one = _check_width(_interleave(_choose(TEMPERATURE, found, setup, file)), TEMPERATURE, 1, file)
    return {"temperature": (TEMPERATURE, one)}


def _of_role(recording: Recording, role: str, setup: Setup) -> list[Stream]:
    """The streams of a role: those of the lowest ``Source.rank``, or of the topic that the setup names."""
    return _meant([stream for stream in recording.streams if stream.role == role], role, setup)


def _meant(streams: Sequence[Stream], role: str, setup: Setup) -> list[Stream]:
    """The streams of the lowest ``Source.rank``, or of the topic that the setup names."""
    ranks = [
        min((source.rank for source in SOURCES.get(stream.message_type, ()) if source.role == role), default=0)
        for stream in streams
    ]
    named = setup.log.topics.get(role)
    ranked = zip(streams, ranks, strict=True)
    return [stream for stream, rank in ranked if rank == min(ranks) or stream.topic == named]


def _by_fields(recording: Recording, role: str, width: int, setup: Setup, file: str) -> Stream:
    """The stream of the fields that the setup names."""
    topic = setup.log.topics[role]
    if ":" not in topic:
        remedy = f'add the field: {role} = "{topic}:field", or name a topic of joints, pose or imu'
        raise LogError("names no field", file=file, field=f"log.topics.{role}", remedy=remedy)
    found = [stream for stream in recording.streams if stream.role == role and stream.topic == topic]
    if not found:
        topics = {other.name for other in recording.topics}
        message = f"there is no topic {topic.partition(':')[0]!r}"
        remedy = nearest(topic.partition(":")[0], topics)
        raise LogError(message, file=file, field=f"log.topics.{role}", remedy=remedy)
    return _check_width(_interleave(found), role, width, file)


def _check_width(stream: Stream, role: str, width: int, file: str) -> Stream:
    """The stream itself, if it has ``width`` numbers per sample."""
    if stream.values.shape[1] != width:
        message = f"{stream.topic} has {stream.values.shape[1]} numbers for the {role}, not {width}"
        remedy = 'choose entries: "/topic:field[0:6]", or several fields by commas'
        raise LogError(message, file=file, field=f"log.topics.{role}", remedy=remedy)
    return stream


def _choose_imu(recording: Recording, setup: Setup, pose: PoseSetup, file: str) -> Stream | None:
    """Stream of the IMU data that the setup uses; None if it uses none, or if they are optional and not available."""
    needed = pose.linear == "specific_force"
    found = _of_role(recording, IMU, setup)
    if not pose.columns[1] or not (found or needed or IMU in setup.log.topics):
        return None
    if not found:
        types = " or ".join(kind for kind, sources in SOURCES.items() if IMU in {source.role for source in sources})
        raise _missing(recording, f"there is no specific force: no topic has the type {types}", IMU, file)
    if not needed and IMU not in setup.log.topics:
        return None  # a gyroscope may be on any body: the setup must name it
    one = _interleave(_choose(IMU, found, setup, file))
    if one.values.shape[1] == 3:
        return one if needed else None
    _check_width(one, IMU, 6, file)
    return one._replace(values=one.values[:, 0 if pose.gyroscope else 3 : 6 if needed else 3])


def _joint_streams(recording: Recording, setup: Setup, file: str) -> list[Stream]:
    """The streams that contain any of the arm's joints."""
    names = setup.robot.joint_names
    found = [stream for stream in recording.streams if stream.role == JOINTS]
    if not found:
        raise _missing(recording, f"no motion data: no topic has the type {JOINT_STATE}", JOINTS, file)
    of_arm = [stream for stream in found if not stream.names or set(stream.names) & set(names)]
    if not of_arm:
        listed = "; ".join(f"{stream.topic} has {', '.join(stream.names)}" for stream in found[:8])
        message = f"no motion data: none of the setup's joints {', '.join(names)} is recorded ({listed})"
        raise LogError(message, file=file, field=JOINTS, remedy="name the robot's joints in the setup as in the log")
    return _meant(of_arm, JOINTS, setup)


def _choose(what: str, streams: Sequence[Stream], setup: Setup, file: str) -> list[Stream]:
    """The streams of the topic that the setup names, or of the only topic there is."""
    topics = sorted({stream.topic for stream in streams})
    field = f"log.topics.{what}"
    topic = setup.log.topics.get(what, topics[0] if topics else "")
    if topic not in topics:
        message = f"the setup names {topic!r}, which has no {what} for it"
        raise LogError(message, file=file, field=field, remedy=nearest(topic, topics))
    if len(topics) > 1 and what not in setup.log.topics:
        message = f"{len(topics)} topics have {what}: {', '.join(topics)}"
        remedy = f'choose in the setup: [log.topics] {what} = "{topics[0]}"'
        raise LogError(message, file=file, field=field, remedy=remedy)
    return [stream for stream in streams if stream.topic == topic]


def _joint_positions(streams: Sequence[Stream], names: Sequence[str], file: str) -> Stream:
    """Merge all publishers of a topic into one stream, with columns for the arm's joints in the setup's order."""
    n = len(names)
    placed = []
    for stream in streams:
        values = np.full((len(stream.stamps), 2 * n), np.nan)
        if not stream.names:  # the message type has no joint names: the values are in the arm's order
            _check_width(stream, JOINTS, n if stream.values.shape[1] == n else 2 * n, file)
            values[:, : stream.values.shape[1]] = stream.values
        for column, name in enumerate(stream.names):
            if name in names:
                at, k = names.index(name), len(stream.names)
                values[:, [at, n + at]] = stream.values[:, [column, k + column]]
        placed.append(stream._replace(names=tuple(names), values=values))
    return _interleave(placed)


def _interleave(streams: Sequence[Stream]) -> Stream:
    """Merge streams with the same columns, in the order in which the messages were stored."""
    parts = zip(*((stream.stamps, stream.logged, stream.order, stream.values) for stream in streams), strict=True)
    stamps, logged, order, values = map(np.concatenate, parts)
    whole = streams[0]._replace(stamps=stamps, logged=logged, order=order, values=values)
    return whole.at(np.argsort(order))


def _missing(recording: Recording, message: str, role: str, file: str) -> LogError:
    """Error for a recording that has no topic for a role; the remedy lists the topics that it has."""
    topics = [f"{topic.name} ({topic.message_type})" for topic in recording.topics]
    listed = f"; there is {', '.join(topics[:12])}" if topics else ""
    remedy = f"record it{listed}{', ...' if len(topics) > 12 else ''}"
    return LogError(message, file=file, field=role, remedy=remedy)
