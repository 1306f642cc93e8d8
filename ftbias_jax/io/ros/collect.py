"""Messages of a recording as they come, sorted into streams of numbers."""

from __future__ import annotations

from array import array
from typing import NamedTuple

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.ros.fields import PathError, Plan, make_plan, take, types_of
from ftbias_jax.io.ros.messages import IMU, JOINTS, POSE, SOURCES, TRANSFORM, MessageError, Source, read_message
from ftbias_jax.io.ros.raw import Definition, RawMessage
from ftbias_jax.types import Array


class Stream(NamedTuple):
    """Messages of one topic; those of joints: with one list of joint names."""

    topic: str
    """Behind it, after a colon, the fields that the setup names."""
    message_type: str
    role: str
    """What it is to a log, one of those in ``messages``."""
    names: tuple[str, ...]
    """Of the joints, () = in the order of the setup; of a transform, its frame and child; else its frame."""
    stamps: Array
    """(T,) int64 ns, of the headers; 0 = not set."""
    logged: Array
    """(T,) int64 ns, when the recorder got them."""
    order: Array
    """(T,) int64, increasing: places among all messages of the recording, in the order in which they are stored."""
    values: Array
    """(T, 2 n) positions, then velocities of joints, NaN where not published; (T, 6) a wrench; (T, 7) position and
    quaternion; (T, 6) angular velocity and acceleration of an IMU, or the latter (T, 3); (T, 1) a temperature."""


class Field(NamedTuple):
    """Fields of a topic that the setup names."""

    role: str
    topic: str
    fields: str
    """Paths, separated by commas."""


class Wanted(NamedTuple):
    """What is to be read of a recording beside joints, wrenches and temperatures."""

    poses: bool = False
    """Poses, transforms, IMUs and the robot's description."""
    fields: tuple[Field, ...] = ()


NOTHING_ELSE = Wanted()


class _Growing(NamedTuple):
    """A stream while it is read; arrays of C numbers, which take a tenth of the memory of lists."""

    width: int
    stamps: array[int]
    logged: array[int]
    order: array[int]
    values: array[float]


_Key = tuple[str, str, str, tuple[str, ...]]  # topic, type, role, names


class Collector:
    """Takes messages one after the other."""

    def __init__(self, wanted: Wanted) -> None:
        self._wanted = wanted
        self._growing: dict[_Key, _Growing] = {}
        self._plans: dict[tuple[str, str, Definition, str], Plan | None] = {}

    def add(self, message: RawMessage, place: int) -> None:
        """Add a message to its streams, if a log is made of its type, or the setup names its topic."""
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
                stamp, frame, values = take(plan, message.data, message.encoding)
                self._append(message, place, f"{topic}:{fields}", role, stamp, (frame,), values)

    def finish(self) -> tuple[Stream, ...]:
        """All streams, in the order in which they start."""
        found = []
        for key, growing in self._growing.items():
            stamps, logged, order = (np.array(numbers, np.int64) for numbers in growing[1:4])
            values = np.array(growing.values, np.float64).reshape(len(stamps), growing.width)
            found.append(Stream(*key, stamps, logged, order, values))
        return tuple(found)

    def _add_source(self, message: RawMessage, place: int, source: Source) -> None:
        if not source.fields:
            for reading in read_message(message.message_type, message.data, message.encoding):
                self._append(message, place, message.topic, source.role, *reading)
        elif plan := self._plan(message, source.fields):
            stamp, frame, values = take(plan, message.data, message.encoding)
            names = () if source.role == JOINTS else (frame,)
            self._append(message, place, message.topic, source.role, stamp, names, values)

    def _plan(self, message: RawMessage, fields: str, stated: str = "") -> Plan | None:
        """How to take fields of a message, kept for those that follow; None if nobody defines its type.

        ``stated`` is the key of the setup that names them; "" = they are those that the type usually has.
        """
        key = (message.message_type, message.encoding, message.definition, fields)
        if key not in self._plans:
            try:
                types = types_of(*key[:3])
                self._plans[key] = None if types is None else make_plan(types, message.message_type, fields)
            except (PathError, MessageError) as error:
                if stated and isinstance(error, PathError):
                    raise LogError(error.message, field=stated, remedy=error.remedy) from error
                if stated:
                    raise
                self._plans[key] = None
        return self._plans[key]

    def _append(
        self,
        message: RawMessage,
        place: int,
        topic: str,
        role: str,
        stamp: int,
        names: tuple[str, ...],
        values: tuple[float, ...],
    ) -> None:
        if not abs(message.logged) < 2**63:
            raise MessageError(f"has the time {message.logged}")
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
