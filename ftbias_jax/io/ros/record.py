"""A recording of ROS, whichever its container, as arrays: one stream a topic and publisher's set of joints."""

from __future__ import annotations

import mmap
import os
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

from ftbias_jax.errors import LogError
from ftbias_jax.files import temporary_folder
from ftbias_jax.io.limits.budget import SMALL_RECORDING, Budget
from ftbias_jax.io.limits.unpack import need
from ftbias_jax.io.ros import sqlite_bag
from ftbias_jax.io.ros.collect import NOTHING_ELSE, Collector, Stream, Wanted
from ftbias_jax.io.ros.mcap_file import McapFile
from ftbias_jax.io.ros.messages import STRING, MessageError, read_message
from ftbias_jax.io.ros.raw import OnDamage, RawMessage
from ftbias_jax.io.ros.ros1_bag import Ros1Bag

SUFFIXES = (".bag", ".db3", ".mcap")
PACKED = ".zstd"  # a file that rosbag2 compressed as a whole

DESCRIPTION = "robot_description"
"""End of the name of the topic on which ROS 2 publishes the URDF."""
MAX_TOLD = 20  # places of damage

_COPY = 1 << 20


def is_ros(path: str | os.PathLike[str]) -> bool:
    """Whether the path names a recording of ROS: a folder, or one of its files."""
    return os.fspath(path).lower().removesuffix(PACKED).endswith(SUFFIXES) or os.path.isdir(path)


class Topic(NamedTuple):
    """One topic of any type."""

    name: str
    message_type: str
    messages: int


class Recording(NamedTuple):
    """What a recording holds."""

    streams: tuple[Stream, ...]
    """What a log is made of, in the order in which it starts."""
    topics: tuple[Topic, ...]
    """All, whatever their type."""
    damage: tuple[str, ...]
    """What could not be read; () for a whole recording."""
    description: str = ""
    """The URDF on the topic robot_description, read with the poses; "" = none."""


def read_recording(path: str | os.PathLike[str], *, salvage: bool = False, wanted: Wanted = NOTHING_ELSE) -> Recording:
    """Read what a log is made of from a ROS 1 bag, a ROS 2 bag (a folder, or its .db3 or .mcap file).

    Raises:
        LogError: it cannot be read, is damaged (without salvage), its compression needs a package, or a message does
            not have a field that is wanted.
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
    except LogError as error:  # of a part, or of a missing package: named after the whole
        raise LogError(error.message, file=file, field=error.field, remedy=error.remedy) from error
    if places > MAX_TOLD:
        damage.append(f"{places - MAX_TOLD} more places are damaged")
    topics = tuple(Topic(*topic, count) for topic, count in counts.items())
    return Recording(streams.finish(), topics, tuple(damage), description)


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
