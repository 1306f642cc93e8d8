"""A ROS recording in any container as arrays: one stream per topic and set of joint names."""

from __future__ import annotations

import mmap
import os
from array import array
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.files import temporary_folder
from ftbias_jax.io.budget import SMALL_RECORDING, Budget, need
from ftbias_jax.io.ros import sqlite_bag
from ftbias_jax.io.ros.containers import McapFile, Ros1Bag
from ftbias_jax.io.ros.fields import Plan, make_plan, take, types_of
from ftbias_jax.io.ros.messages import (
    IMU,
    JOINTS,
    POSE,
    SOURCES,
    STRING,
    TRANSFORM,
    MessageError,
    Reading,
    Source,
    read_message,
)
from ftbias_jax.io.ros.raw import Definition, OnDamage, RawMessage
from ftbias_jax.types import Array

SUFFIXES = (".bag", ".db3", ".mcap")
PACKED = ".zstd"  # suffix of a file that rosbag2 compressed as a whole

DESCRIPTION = "robot_description"
"""End of the name of the topic on which ROS 2 publishes the URDF."""
MAX_REPORTED = 20  # damaged places that are listed one by one

_COPY = 1 << 20


def is_ros(path: str | os.PathLike[str]) -> bool:
    """Whether the path names a ROS recording: a folder, or one of its files."""
    return os.fspath(path).lower().removesuffix(PACKED).endswith(SUFFIXES) or os.path.isdir(path)


class Stream(NamedTuple):
    """Messages of one topic; joint messages are grouped further by their list of joint names."""

    topic: str
    """Name of the topic; if the setup names fields, a colon and their paths follow."""
    message_type: str
    role: str
    """Role in a log, one of those in ``messages``."""
    names: tuple[str, ...]
    """Joint names, () = in the order of the setup; frame and child frame of a transform; otherwise the frame."""
    stamps: Array
    """(T,) int64 ns, from the headers; 0 = not set."""
    logged: Array
    """(T,) int64 ns; times at which the recorder received the messages."""
    order: Array
    """(T,) int64, increasing: indices among all messages of the recording, in the order in which they are stored."""
    values: Array
    """(T, 2 n) positions, then velocities of joints, NaN where not published; (T, 6) a wrench; (T, 7) position and
    quaternion; (T, 6) angular velocity and acceleration of an IMU, or (T, 3) acceleration; (T, 1) a temperature."""

    def at(self, rows: Array) -> Stream:
        """The stream restricted to some messages, given as (R,) indices or as a (T,) Boolean mask."""
        return self._replace(
            stamps=self.stamps[rows], logged=self.logged[rows], order=self.order[rows], values=self.values[rows]
        )


class Wanted(NamedTuple):
    """What is to be read from a recording besides joints, wrenches and temperatures."""

    poses: bool = False
    """Whether to read poses, transforms, IMUs and the robot's description."""
    fields: tuple[tuple[str, str, str], ...] = ()
    """Role, topic, and paths of its fields, separated by commas, as the setup names them."""


NOTHING_ELSE = Wanted()


class _Growing(NamedTuple):
    """A stream while it is read; its arrays of C numbers take a tenth of the memory of lists."""

    width: int
    stamps: array[int]
    logged: array[int]
    order: array[int]
    values: array[float]


_Key = tuple[str, str, str, tuple[str, ...]]  # topic, type, role, names


class Collector:
    """Collects messages into streams, one message after the other."""

    def __init__(self, wanted: Wanted) -> None:
        self._wanted = wanted
        self._growing: dict[_Key, _Growing] = {}
        self._plans: dict[tuple[str, str, Definition, str], Plan | None] = {}

    def add(self, message: RawMessage, place: int) -> None:
        """Add a message to its streams, if its type has a role in a log, or the setup names its topic."""
        for source in SOURCES.get(message.message_type, ()):
            if self._wanted.poses or source.role not in (POSE, TRANSFORM, IMU):
                self._add_source(message, place, source)
        for role, topic, fields in self._wanted.fields:
            if topic == message.topic:
                plan = self._plan(message, fields, f"log.topics.{role}")
                if plan is None:
                    what = f"{topic} has the type {message.message_type}, which the recording does not define"
                    remedy = "convert it to MCAP where the type is known: ros2 bag convert; or pip install rosbags"
                    raise LogError(what, field=f"log.topics.{role}", remedy=remedy)
                self._append(message, place, f"{topic}:{fields}", role, take(plan, message.data, message.encoding))

    def finish(self) -> tuple[Stream, ...]:
        """All streams, in the order of their first messages."""
        found = []
        for key, growing in self._growing.items():
            stamps, logged, order = (np.array(numbers, np.int64) for numbers in growing[1:4])
            values = np.array(growing.values, np.float64).reshape(len(stamps), growing.width)
            found.append(Stream(*key, stamps, logged, order, values))
        return tuple(found)

    def _add_source(self, message: RawMessage, place: int, source: Source) -> None:
        if not source.fields:
            for reading in read_message(message.message_type, message.data, message.encoding):
                self._append(message, place, message.topic, source.role, reading)
        elif plan := self._plan(message, source.fields):
            reading = take(plan, message.data, message.encoding)
            reading = reading._replace(names=()) if source.role == JOINTS else reading
            self._append(message, place, message.topic, source.role, reading)

    def _plan(self, message: RawMessage, fields: str, stated: str = "") -> Plan | None:
        """Plan for reading fields of a message, reused for later messages; None if its type is not defined.

        ``stated`` is the key of the setup that names the fields; "" = they are the usual ones of the type.
        """
        key = (message.message_type, message.encoding, message.definition, fields)
        if key not in self._plans:
            try:
                types = types_of(*key[:3])
                self._plans[key] = None if types is None else make_plan(types, message.message_type, fields)
            except (LogError, MessageError) as error:
                if stated and isinstance(error, LogError):
                    raise LogError(error.message, field=stated, remedy=error.remedy) from error
                if stated:
                    raise
                self._plans[key] = None
        return self._plans[key]

    def _append(self, message: RawMessage, place: int, topic: str, role: str, reading: Reading) -> None:
        if not abs(message.logged) < 2**63:
            raise MessageError(f"has the time {message.logged}")
        stamp, names, values = reading
        key = (topic, message.message_type, role, names)
        stream = self._growing.get(key)
        if stream is None:
            stream = _Growing(len(values), array("q"), array("q"), array("q"), array("d"))
            self._growing[key] = stream
        if len(values) != stream.width:
            raise MessageError(f"has {len(values)} numbers, those before have {stream.width}")
        stream.stamps.append(stamp)
        stream.logged.append(message.logged)
        stream.order.append(place)
        stream.values.extend(values)


class Topic(NamedTuple):
    """A topic of any type."""

    name: str
    message_type: str
    messages: int


class Recording(NamedTuple):
    """Content of a recording."""

    streams: tuple[Stream, ...]
    """Streams from which a log is built, in the order of their first messages."""
    topics: tuple[Topic, ...]
    """All topics, whatever their type."""
    damage: tuple[str, ...]
    """Descriptions of what could not be read; () for an undamaged recording."""
    description: str = ""
    """The URDF on the topic robot_description, read only with the poses; "" = none."""


def read_recording(path: str | os.PathLike[str], *, salvage: bool = False, wanted: Wanted = NOTHING_ELSE) -> Recording:
    """Read the streams of a log from a ROS 1 bag, or from a ROS 2 bag (a folder, or its .db3 or .mcap file).

    Raises:
        LogError: the recording cannot be read, is damaged (without salvage), needs a package for its compression, or a
            message lacks a wanted field.
    """
    file = os.fspath(path)
    damage: list[str] = []
    places = 0

    def on_damage(what: str) -> None:
        nonlocal places
        if not salvage:
            raise LogError(what, file=file, remedy="--salvage reads what is whole")
        places += 1
        if places <= MAX_REPORTED:
            damage.append(what)

    streams = Collector(wanted)
    counts: dict[tuple[str, str], int] = {}
    description = ""
    messages = (message for part in _parts(Path(path)) for message in _messages(part, on_damage))
    try:
        for place, message in enumerate(messages):
            topic = (message.topic, message.message_type)
            counts[topic] = counts.get(topic, 0) + 1
            try:
                streams.add(message, place)
                if wanted.poses and message.message_type == STRING and message.topic.endswith(DESCRIPTION):
                    (said,) = read_message(STRING, message.data, message.encoding)
                    (description,) = said.names
            except MessageError as error:
                on_damage(f"message {counts[topic]} of {message.topic} {error}")
    except OSError as error:
        raise LogError(f"cannot be read: {error.strerror or error}", file=file, remedy="check the path") from error
    except LogError as error:  # from a part, or for a missing package: report the whole recording
        raise LogError(error.message, file=file, field=error.field, remedy=error.remedy) from error
    if places > MAX_REPORTED:
        damage.append(f"{places - MAX_REPORTED} more places are damaged")
    topics = tuple(Topic(*topic, count) for topic, count in counts.items())
    return Recording(streams.finish(), topics, tuple(damage), description)


def _parts(path: Path) -> list[Path]:
    """The files of a recording; in a folder, all files with messages (its metadata.yaml is not needed)."""
    if not path.is_dir():
        return [path]
    endings = (*SUFFIXES, *(suffix + PACKED for suffix in SUFFIXES))
    parts = [part for part in path.iterdir() if part.name.lower().endswith(endings)]
    if not parts:
        remedy = "give a ROS 2 bag's folder, or a file"
        raise LogError(f"the folder has no file that ends in {', '.join(SUFFIXES)}", file=path, remedy=remedy)
    return sorted(parts, key=lambda part: (len(part.name), part.name))  # bag_2 before bag_10


def _messages(path: Path, on_damage: OnDamage) -> Iterator[RawMessage]:
    """Yield the messages of one file, whose format is recognised by its first bytes."""
    if path.name.lower().endswith(PACKED):
        with temporary_folder() as folder:
            unpacked = Path(folder) / "unpacked"
            _unpack_file(path, unpacked, on_damage)
            yield from _messages(unpacked, on_damage)
        return
    budget = Budget(path, SMALL_RECORDING)
    with open(path, "rb") as stream:
        start = stream.read(20)
        if start.startswith(sqlite_bag.MAGIC):
            yield from sqlite_bag.scan_sqlite(path, on_damage, budget)
            return
        kind = next((kind for kind in (Ros1Bag, McapFile) if start.startswith(kind.MAGIC)), None)
        if kind is None:
            message = f"is no recording of ROS: it starts with {start[:13]!r}" if start else "is empty"
            raise LogError(message, file=path, remedy="give a ROS 1 bag (format 2.0), or an .mcap or .db3 of ROS 2")
        with closing(mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)) as data:
            yield from kind(data, on_damage, budget).scan()


def _unpack_file(path: Path, target: Path, on_damage: OnDamage) -> None:
    """Decompress a whole file to disk; the temporary folder, not the memory, must have room for it."""
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
