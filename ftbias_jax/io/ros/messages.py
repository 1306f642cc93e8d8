"""The messages a log is made of, from their bytes: JointState or PoseStamped or TF, and WrenchStamped.

ROS 1 stores numbers one after the other; ROS 2 (CDR, OMG DDSI-RTPS 2.3, section 10) starts with four bytes that name
the encoding, aligns every number to its own size, and ends strings with a zero byte.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

JOINT_STATE = "sensor_msgs/JointState"
WRENCH_STAMPED = "geometry_msgs/WrenchStamped"
POSE_STAMPED = "geometry_msgs/PoseStamped"
TF = "tf2_msgs/TFMessage"
STRING = "std_msgs/String"

MAX_JOINTS, MAX_TRANSFORMS = 1000, 10_000
"""Of one message; robots have fewer."""

_CDR_ORDERS = {b"\x00\x00": ">", b"\x00\x01": "<"}


class MessageError(Exception):
    """The bytes are not the message they should be; the message is a clause for ours."""


class JointState(NamedTuple):
    """Positions and velocities, () where the publisher left them out."""

    stamp: int
    """ns, of the header; 0 = not set."""
    names: tuple[str, ...]
    position: tuple[float, ...]
    velocity: tuple[float, ...]


class WrenchStamped(NamedTuple):
    """Force and torque as published."""

    stamp: int
    """ns, of the header; 0 = not set."""
    frame: str
    wrench: tuple[float, ...]
    """6: N, Nm."""


def joint_state(data: bytes, encoding: str) -> JointState:
    """Decode a sensor_msgs/JointState; its efforts are not read.

    Raises:
        MessageError: it is damaged, or has not one name a position.
    """
    try:
        cursor = _Cursor(data, encoding)
        stamp, _ = cursor.header()
        names = tuple(cursor.text() for _ in range(cursor.count(4, MAX_JOINTS)))
        message = JointState(stamp, names, cursor.floats(len(names)), cursor.floats(len(names)))
    except (struct.error, UnicodeDecodeError) as error:
        raise MessageError(f"is damaged: {error}") from error
    if len(set(names)) < len(names):
        raise MessageError("has two joints of one name")
    return message


def wrench_stamped(data: bytes, encoding: str) -> WrenchStamped:
    """Decode a geometry_msgs/WrenchStamped.

    Raises:
        MessageError: it is damaged.
    """
    try:
        cursor = _Cursor(data, encoding)
        stamp, frame = cursor.header()
        return WrenchStamped(stamp, frame, cursor.array(6))
    except (struct.error, UnicodeDecodeError) as error:
        raise MessageError(f"is damaged: {error}") from error


class PoseStamped(NamedTuple):
    """A pose as published, or a transform of TF."""

    stamp: int
    """ns, of the header; 0 = not set."""
    names: tuple[str, ...]
    """The frame; of a transform, the frame and its child."""
    pose: tuple[float, ...]
    """7: position m, orientation x, y, z, w."""


def pose_stamped(data: bytes, encoding: str) -> list[PoseStamped]:
    """Decode a geometry_msgs/PoseStamped.

    Raises:
        MessageError: it is damaged.
    """
    try:
        cursor = _Cursor(data, encoding)
        stamp, frame = cursor.header()
        return [PoseStamped(stamp, (frame,), cursor.array(7))]
    except (struct.error, UnicodeDecodeError) as error:
        raise MessageError(f"is damaged: {error}") from error


def transforms(data: bytes, encoding: str) -> list[PoseStamped]:
    """Decode a tf2_msgs/TFMessage; frames without the slash that old programs put in front.

    Raises:
        MessageError: it is damaged.
    """
    try:
        cursor = _Cursor(data, encoding)
        found = []
        for _ in range(cursor.count(64, MAX_TRANSFORMS)):
            stamp, parent = cursor.header()
            child = cursor.text()
            names = (parent.removeprefix("/"), child.removeprefix("/"))
            found.append(PoseStamped(stamp, names, cursor.array(7)))
        return found
    except (struct.error, UnicodeDecodeError) as error:
        raise MessageError(f"is damaged: {error}") from error


def string(data: bytes, encoding: str) -> str:
    """Decode a std_msgs/String.

    Raises:
        MessageError: it is damaged.
    """
    try:
        return _Cursor(data, encoding).text()
    except (struct.error, UnicodeDecodeError) as error:
        raise MessageError(f"is damaged: {error}") from error


class _Cursor:
    """A place in the bytes of a message that moves on with every value read."""

    def __init__(self, data: bytes, encoding: str) -> None:
        self.data, self.cdr = data, encoding == "cdr"
        if not self.cdr and encoding != "ros1":
            raise MessageError(f"has the unknown encoding {encoding[:40]!r}")
        order = _CDR_ORDERS.get(data[:2]) if self.cdr else "<"
        if order is None:
            raise MessageError(f"has the unknown CDR encapsulation {data[:4]!r}")
        self.order, self.origin = order, 4 if self.cdr else 0
        self.position = self.origin

    def header(self) -> tuple[int, str]:
        """Stamp in ns and frame of a std_msgs/Header."""
        if not self.cdr:
            self.uint32()  # the sequence number, which ROS 2 dropped
        seconds, nanoseconds = self.uint32(), self.uint32()
        return seconds * 10**9 + nanoseconds, self.text()

    def uint32(self) -> int:
        self.align(4)
        (value,) = struct.unpack_from(self.order + "I", self.data, self.position)
        self.position += 4
        return int(value)

    def text(self) -> str:
        length = self.count(1)
        start, self.position = self.position, self.position + length
        return self.data[start : self.position].removesuffix(b"\x00").decode()

    def floats(self, names: int) -> tuple[float, ...]:
        """float64[] with its length before it: one for each name, or none."""
        count = self.count(8)
        if count not in (0, names):
            raise MessageError(f"has {names} names, but {count} numbers")
        return self.array(count) if count else ()

    def array(self, count: int) -> tuple[float, ...]:
        """float64[count]."""
        self.align(8)
        start, self.position = self.position, self.position + 8 * count
        return struct.unpack_from(f"{self.order}{count}d", self.data, start)

    def count(self, size: int, most: int = 2**32) -> int:
        """The length of a list, checked against the bytes that are left before anything is made of that length."""
        count = self.uint32()
        if count > most:
            raise MessageError(f"has a list of {count}, more than {most}")
        if count * size > len(self.data) - self.position:
            raise struct.error(f"a list of {count} in {len(self.data)} bytes")
        return count

    def align(self, size: int) -> None:
        if self.cdr:
            self.position += -(self.position - self.origin) % size
