"""A recording of ROS, whichever its container, as arrays: one stream a topic and publisher's set of joints."""

from __future__ import annotations

import mmap
import os
from array import array
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.files import temporary_folder
from ftbias_jax.io.limits.budget import SMALL_RECORDING, Budget
from ftbias_jax.io.ros import mcap_file, ros1_bag, sqlite_bag
from ftbias_jax.io.ros.messages import (
    JOINT_STATE,
    POSE_STAMPED,
    STRING,
    TF,
    WRENCH_STAMPED,
    MessageError,
    joint_state,
    pose_stamped,
    string,
    transforms,
    wrench_stamped,
)
from ftbias_jax.io.ros.raw import OnDamage, RawMessage
from ftbias_jax.io.unpack import need
from ftbias_jax.types import Array

SUFFIXES = (".bag", ".db3", ".mcap")
PACKED = ".zstd"  # a file that rosbag2 compressed as a whole

DESCRIPTION = "robot_description"
"""End of the name of the topic on which ROS 2 publishes the URDF."""
MAX_TOLD = 20  # places of damage

_COPY = 1 << 20
_Key = tuple[str, str, tuple[str, ...]]  # topic, type, names


class Stream(NamedTuple):
    """Messages of one topic; those of joints: with one list of joint names."""

    topic: str
    message_type: str
    names: tuple[str, ...]
    """Of the joints; of a wrench or pose, its frame; of a transform, its frame and child."""
    stamps: Array
    """(T,) int64 ns, of the headers; 0 = not set."""
    logged: Array
    """(T,) int64 ns, when the recorder got them."""
    order: Array
    """(T,) int64, increasing: places among all messages of the recording, in the order in which they are stored."""
    values: Array
    """(T, 2 n) positions, then velocities, NaN where not published; (T, 6) a wrench; (T, 7) position, quaternion."""


class Topic(NamedTuple):
    """One topic of any type."""

    name: str
    message_type: str
    messages: int


class Recording(NamedTuple):
    """What a recording holds."""

    streams: tuple[Stream, ...]
    """Joint states and wrenches, in the order in which they start."""
    topics: tuple[Topic, ...]
    """All, whatever their type."""
    damage: tuple[str, ...]
    """What could not be read; () for a whole recording."""
    description: str = ""
    """The URDF on the topic robot_description, read with the poses; "" = none."""


def read_recording(path: str | os.PathLike[str], *, salvage: bool = False, poses: bool = False) -> Recording:
    """Read joint states and wrenches of a ROS 1 bag, a ROS 2 bag (a folder, or its .db3 or .mcap file).

    Args:
        path: the file or folder.
        salvage: skip what is damaged, instead of refusing the recording.
        poses: also read poses and transforms.

    Raises:
        LogError: it cannot be read, is damaged (without salvage), or its compression needs a package.
    """
    file = os.fspath(path)
    damage: list[str] = []
    places = 0

    def on_damage(what: str) -> None:
        nonlocal places
        if not salvage:
            raise LogError(what, file=file, remedy="--salvage reads what is whole")
        places += 1
        if places <= MAX_TOLD:
            damage.append(what)

    streams: dict[_Key, _Growing] = {}
    counts: dict[tuple[str, str], int] = {}
    description = ""
    messages = (message for part in _parts(Path(path)) for message in _messages(part, on_damage))
    try:
        for place, message in enumerate(messages):
            topic = (message.topic, message.message_type)
            counts[topic] = counts.get(topic, 0) + 1
            try:
                _append(streams, message, place, poses)
                if poses and message.message_type == STRING and message.topic.endswith(DESCRIPTION):
                    description = string(message.data, message.encoding)
            except MessageError as error:
                on_damage(f"message {counts[topic]} of {message.topic} {error}")
    except OSError as error:
        raise LogError(f"cannot be read: {error.strerror or error}", file=file, remedy="check the path") from error
    except LogError as error:  # of a part, or of a missing package: named after the whole
        raise LogError(error.message, file=file, field=error.field, remedy=error.remedy) from error
    if places > MAX_TOLD:
        damage.append(f"{places - MAX_TOLD} more places are damaged")
    topics = tuple(Topic(*topic, count) for topic, count in counts.items())
    found = tuple(_finish(*key, growing) for key, growing in streams.items())
    return Recording(found, topics, tuple(damage), description)


class _Growing(NamedTuple):
    """A stream while it is read; arrays of C numbers, which take a tenth of the memory of lists."""

    stamps: array[int]
    logged: array[int]
    order: array[int]
    values: array[float]


def _append(streams: dict[_Key, _Growing], message: RawMessage, place: int, poses: bool) -> None:
    """Add a message to its stream, if it is of a type that a log is made of."""
    values: tuple[float, ...]
    if poses and message.message_type in (POSE_STAMPED, TF):
        decode = pose_stamped if message.message_type == POSE_STAMPED else transforms
        for stamp, names, pose in decode(message.data, message.encoding):
            _add(streams, message, names, stamp, place, pose)
    elif message.message_type == JOINT_STATE:
        stamp, names, position, velocity = joint_state(message.data, message.encoding)
        missing = (float("nan"),) * len(names)
        values = (position or missing) + (velocity or missing)
        _add(streams, message, names, stamp, place, values)
    elif message.message_type == WRENCH_STAMPED:
        stamp, frame, values = wrench_stamped(message.data, message.encoding)
        names = (frame,)
        _add(streams, message, names, stamp, place, values)


def _add(
    streams: dict[_Key, _Growing],
    message: RawMessage,
    names: tuple[str, ...],
    stamp: int,
    place: int,
    values: tuple[float, ...],
) -> None:
    if not abs(message.logged) < 2**63:
        raise MessageError(f"has the time {message.logged}")
    key = (message.topic, message.message_type, names)
    stream = streams.setdefault(key, _Growing(array("q"), array("q"), array("q"), array("d")))
    stream.stamps.append(stamp)
    stream.logged.append(message.logged)
    stream.order.append(place)
    stream.values.extend(values)


def _finish(topic: str, message_type: str, names: tuple[str, ...], growing: _Growing) -> Stream:
    stamps, logged, order = (np.array(numbers, np.int64) for numbers in growing[:3])
    values = np.array(growing.values, np.float64).reshape(len(stamps), -1)
    return Stream(topic, message_type, names, stamps, logged, order, values)


def _parts(path: Path) -> list[Path]:
    """The files of a recording: of a folder, all that hold messages; its metadata.yaml is not needed."""
    if not path.is_dir():
        return [path]
    endings = (*SUFFIXES, *(suffix + PACKED for suffix in SUFFIXES))
    parts = [part for part in path.iterdir() if part.name.lower().endswith(endings)]
    if not parts:
        remedy = "give a ROS 2 bag's folder, or a file"
        raise LogError(f"the folder has no file that ends in {', '.join(SUFFIXES)}", file=path, remedy=remedy)
    return sorted(parts, key=lambda part: (len(part.name), part.name))  # bag_2 before bag_10


def _messages(path: Path, on_damage: OnDamage) -> Iterator[RawMessage]:
    """The messages of one file, by what its first bytes are."""
    if path.name.lower().endswith(PACKED):
        with temporary_folder() as folder:
            unpacked = Path(folder) / "unpacked"
            _unpack_file(path, unpacked, on_damage)
            yield from _messages(unpacked, on_damage)
        return
    budget = Budget(path, SMALL_RECORDING)
    with open(path, "rb") as stream:
        start = stream.read(max(map(len, (ros1_bag.MAGIC, sqlite_bag.MAGIC, mcap_file.MAGIC))))
        if start.startswith(sqlite_bag.MAGIC):
            yield from sqlite_bag.scan_sqlite(path, on_damage, budget)
            return
        scanners: dict[bytes, Callable[[mmap.mmap, OnDamage, Budget], Iterator[RawMessage]]] = {
            ros1_bag.MAGIC: ros1_bag.scan_bag,
            mcap_file.MAGIC: mcap_file.scan_mcap,
        }
        scan = next((scanners[magic] for magic in scanners if start.startswith(magic)), None)
        if scan is None:
            message = f"is no recording of ROS: it starts with {start[:13]!r}" if start else "is empty"
            raise LogError(message, file=path, remedy="give a ROS 1 bag (format 2.0), or an .mcap or .db3 of ROS 2")
        with closing(mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)) as data:
            yield from scan(data, on_damage, budget)


def _unpack_file(path: Path, target: Path, on_damage: OnDamage) -> None:
    """Decompress a whole file beside; the temporary folder, not the memory, must have room for it."""
    budget = Budget(path)
    zstandard = need("zstandard", "ros", str(path))
    with open(path, "rb") as packed, open(target, "wb") as unpacked:
        reader = zstandard.ZstdDecompressor().stream_reader(packed)
        try:
            while block := reader.read(_COPY):
                budget.unpack(len(block))
                unpacked.write(block)
        except zstandard.ZstdError as error:
            on_damage(f"{path.name} cannot be unpacked: {error}")
