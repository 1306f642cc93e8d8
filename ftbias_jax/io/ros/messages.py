"""The messages a log is made of: their bytes value by value, and what each type is to a log.

ROS 1 stores numbers one after the other; ROS 2 (CDR, OMG DDSI-RTPS 2.3, section 10) starts with four bytes that name
the encoding, aligns every number to its own size, and ends strings with a zero byte.
"""

import struct
from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

JOINT_STATE = "sensor_msgs/JointState"
WRENCH_STAMPED = "geometry_msgs/WrenchStamped"
POSE_STAMPED = "geometry_msgs/PoseStamped"
TF = "tf2_msgs/TFMessage"
STRING = "std_msgs/String"

MAX_JOINTS, MAX_TRANSFORMS = 1000, 10_000
"""Of one message; robots have fewer."""
_CDR_ORDERS = {b"\x00\x00": ">", b"\x00\x01": "<"}

JOINTS, WRENCH, POSE, TRANSFORM, IMU, TEMPERATURE = "joints", "wrench", "pose", "transform", "imu", "temperature"
POSITION, VELOCITY = "position", "velocity"
"""Of joints or of a pose, by fields that the setup names."""
BY_FIELD = (POSITION, VELOCITY, WRENCH, TEMPERATURE, IMU)
"""Roles for which [log.topics] may name a field."""

FRANKA1, FRANKA2 = "franka_msgs/FrankaState", "franka_msgs/FrankaRobotState"


class Source(NamedTuple):
    """What a type has for one role."""

    role: str
    fields: str
    """Paths by commas; "" = its own reader."""
    rank: int = 0
    """Of several topics for a role, those of the lowest rank are meant, unless the setup names another."""


SOURCES: dict[str, tuple[Source, ...]] = {
    JOINT_STATE: (Source(JOINTS, ""),),
    WRENCH_STAMPED: (Source(WRENCH, ""),),
    POSE_STAMPED: (Source(POSE, ""),),
    TF: (Source(TRANSFORM, ""),),
    "geometry_msgs/Wrench": (Source(WRENCH, "force,torque", 1),),
    # The robot's own estimate: the controller has taken its payload off, and it is of the frame K or EE.
    FRANKA1: (Source(JOINTS, "q,dq", 1), Source(WRENCH, "K_F_ext_hat_K", 2)),
    FRANKA2: (
        Source(JOINTS, "measured_joint_state.position,measured_joint_state.velocity", 1),
        Source(WRENCH, "k_f_ext_hat_k.wrench", 2),
    ),
    "sensor_msgs/Imu": (Source(IMU, "angular_velocity,linear_acceleration"),),
    # Accelerometers publish what they feel, which is the specific force, in these types.
    "geometry_msgs/AccelStamped": (Source(IMU, "accel.linear", 1),),
    "geometry_msgs/AccelWithCovarianceStamped": (Source(IMU, "accel.accel.linear", 1),),
    "geometry_msgs/Accel": (Source(IMU, "linear", 2),),
    "sensor_msgs/Temperature": (Source(TEMPERATURE, "temperature"),),
}
"""Plain type -> its roles."""


class MessageError(Exception):
    """The bytes are not the message they should be; the message is a clause for ours."""


class Cursor:
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
        """One number."""
        self.align(4)
        (value,) = struct.unpack_from(self.order + "I", self.data, self.position)
        self.position += 4
        return int(value)

    def text(self) -> str:
        """A string of UTF-8."""
        length = self.count(1)
        start, self.position = self.position, self.position + length
        return self.data[start : self.position].removesuffix(b"\x00").decode()

    def numbers(self, letter: str, size: int, count: int) -> tuple[float, ...]:
        """So many numbers of one kind, by its letter of struct; struct.error if they are not there."""
        if not count:
            return ()
        self.skip(size, count)
        return struct.unpack_from(f"{self.order}{count}{letter}", self.data, self.position - size * count)

    def skip(self, size: int, count: int) -> None:
        """Move on over numbers; struct.error if they are not there."""
        if count:
            self.align(size)
            self.position += size * count
            if self.position > len(self.data):
                raise struct.error(f"{count} numbers in {len(self.data)} bytes")

    def count(self, size: int, most: int = 2**32) -> int:
        """The length of a list, checked against the bytes that are left before anything is made of that length."""
        count = self.uint32()
        if count > most:
            raise MessageError(f"has a list of {count}, more than {most}")
        if count * size > len(self.data) - self.position:
            raise struct.error(f"a list of {count} in {len(self.data)} bytes")
        return count

    def align(self, size: int) -> None:
        """Move on to where a number of this size may start."""
        if self.cdr:
            self.position += -(self.position - self.origin) % size


class Reading(NamedTuple):
    """What a message says, or one transform of TF."""

    stamp: int
    """ns, of the header; 0 = not set."""
    names: tuple[str, ...]
    """Of the joints; of a transform, its frame and child; else its frame, "" = none. Of a string, the text."""
    values: tuple[float, ...]
    """Positions, then velocities of joints, NaN where the publisher left them out; 6 of a wrench, N, Nm; 7 of a pose,
    position m, orientation x, y, z, w. Or those of fields."""


def read_message(kind: str, data: bytes, encoding: str) -> list[Reading]:
    """Decode a message of one of the types above; MessageError if it is damaged, or has not one name a position."""
    try:
        return list(_READERS[kind](Cursor(data, encoding)))
    except (struct.error, UnicodeDecodeError) as error:
        raise MessageError(f"is damaged: {error}") from error


def _joint_state(cursor: Cursor) -> Iterator[Reading]:
    """Its efforts are not read."""
    stamp, _ = cursor.header()
    names = tuple(cursor.text() for _ in range(cursor.count(4, MAX_JOINTS)))
    values: tuple[float, ...] = ()
    for _ in ("position", "velocity"):
        count = cursor.count(8)
        if count not in (0, len(names)):
            raise MessageError(f"has {len(names)} names, but {count} numbers")
        values += cursor.numbers("d", 8, count) or (float("nan"),) * len(names)
    if len(set(names)) < len(names):
        raise MessageError("has two joints of one name")
    yield Reading(stamp, names, values)


def _stamped(count: int, cursor: Cursor) -> Iterator[Reading]:
    """A header and so many numbers."""
    stamp, frame = cursor.header()
    yield Reading(stamp, (frame,), cursor.numbers("d", 8, count))


def _transforms(cursor: Cursor) -> Iterator[Reading]:
    """Frames without the slash that old programs put in front."""
    for _ in range(cursor.count(64, MAX_TRANSFORMS)):
        stamp, parent = cursor.header()
        names = (parent.removeprefix("/"), cursor.text().removeprefix("/"))
        yield Reading(stamp, names, cursor.numbers("d", 8, 7))


_READERS: dict[str, Callable[[Cursor], Iterator[Reading]]] = {
    JOINT_STATE: _joint_state,
    WRENCH_STAMPED: partial(_stamped, 6),
    POSE_STAMPED: partial(_stamped, 7),
    TF: _transforms,
    STRING: lambda cursor: iter([Reading(0, (cursor.text(),), ())]),
}
