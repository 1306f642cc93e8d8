"""Messages from which a log is built: decoding of their bytes, and the roles of each message type.

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
"""Maximum number of joints, and of transforms, in one message; robots have fewer."""
_CDR_ORDERS = {b"\x00\x00": ">", b"\x00\x01": "<"}

JOINTS, WRENCH, POSE, TRANSFORM, IMU, TEMPERATURE = "joints", "wrench", "pose", "transform", "imu", "temperature"
POSITION, VELOCITY = "position", "velocity"
"""Roles of positions and velocities of joints or of a pose, in fields that the setup names."""
BY_FIELD = (POSITION, VELOCITY, WRENCH, TEMPERATURE, IMU)
"""Roles for which [log.topics] may name a field."""

FRANKA1, FRANKA2 = "franka_msgs/FrankaState", "franka_msgs/FrankaRobotState"


class Source(NamedTuple):
    """Fields of a message type that hold the data of one role."""

    role: str
    fields: str
    """Paths separated by commas; "" = the type has a reader of its own."""
    rank: int = 0
    """If several topics have a role, those of the lowest rank are used, unless the setup names another one."""


SOURCES: dict[str, tuple[Source, ...]] = {
    JOINT_STATE: (Source(JOINTS, ""),),
    WRENCH_STAMPED: (Source(WRENCH, ""),),
    POSE_STAMPED: (Source(POSE, ""),),
    TF: (Source(TRANSFORM, ""),),
    "geometry_msgs/Wrench": (Source(WRENCH, "force,torque", 1),),
    # The robot's own estimate: the controller has subtracted its payload, and it refers to the frame K or EE.
    FRANKA1: (Source(JOINTS, "q,dq", 1), Source(WRENCH, "K_F_ext_hat_K", 2)),
    FRANKA2: (
        Source(JOINTS, "measured_joint_state.position,measured_joint_state.velocity", 1),
        Source(WRENCH, "k_f_ext_hat_k.wrench", 2),
    ),
    "sensor_msgs/Imu": (Source(IMU, "angular_velocity,linear_acceleration"),),
    # Accelerometers publish what they measure, the specific force, in these types.
    "geometry_msgs/AccelStamped": (Source(IMU, "accel.linear", 1),),
    "geometry_msgs/AccelWithCovarianceStamped": (Source(IMU, "accel.accel.linear", 1),),
    "geometry_msgs/Accel": (Source(IMU, "linear", 2),),
    "sensor_msgs/Temperature": (Source(TEMPERATURE, "temperature"),),
}
"""Plain name of a message type -> its roles."""


class MessageError(Exception):
    """The bytes are not a valid message of their type; the error's text is a clause to follow the message's name."""


class Cursor:
    """Read position in the bytes of a message, which advances with every value read."""

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
        """Read the stamp in ns and the frame of a std_msgs/Header."""
        if not self.cdr:
            self.uint32()  # the sequence number, which ROS 2 dropped
        seconds, nanoseconds = self.uint32(), self.uint32()
        return seconds * 10**9 + nanoseconds, self.text()

    def uint32(self) -> int:
        """Read one uint32."""
        self.align(4)
        (value,) = struct.unpack_from(self.order + "I", self.data, self.position)
        self.position += 4
        return int(value)

    def text(self) -> str:
        """Read a UTF-8 string."""
        length = self.count(1)
        start, self.position = self.position, self.position + length
        return self.data[start : self.position].removesuffix(b"\x00").decode()

    def numbers(self, letter: str, size: int, count: int) -> tuple[float, ...]:
        """Read ``count`` numbers with one format character of ``struct``; struct.error if the data end before."""
        if not count:
            return ()
        self.skip(size, count)
        return struct.unpack_from(f"{self.order}{count}{letter}", self.data, self.position - size * count)

    def skip(self, size: int, count: int) -> None:
        """Skip numbers; struct.error if the data end before."""
        if count:
            self.align(size)
            self.position += size * count
            if self.position > len(self.data):
                raise struct.error(f"{count} numbers in {len(self.data)} bytes")

    def count(self, size: int, most: int = 2**32) -> int:
        """Read the length of a list, checked against the bytes that are left before anything is allocated for it."""
        count = self.uint32()
        if count > most:
            raise MessageError(f"has a list of {count}, more than {most}")
        if count * size > len(self.data) - self.position:
            raise struct.error(f"a list of {count} in {len(self.data)} bytes")
        return count

    def align(self, size: int) -> None:
        """Advance to the next position at which a number of this size may start."""
        if self.cdr:
            self.position += -(self.position - self.origin) % size


class Reading(NamedTuple):
    """Decoded content of a message, or one transform of a TF message."""

    stamp: int
    """ns, from the header; 0 = not set."""
    names: tuple[str, ...]
    """Joint names; frame and child frame of a transform; text of a string; otherwise the frame, "" = none."""
    values: tuple[float, ...]
    """Positions, then velocities of joints, NaN where the publisher left them out; a wrench (6), N, Nm; a pose (7),
    position m, orientation x, y, z, w; or the numbers of named fields."""


def read_message(kind: str, data: bytes, encoding: str) -> list[Reading]:
    """Decode a message of one of the types above; MessageError if it is damaged or its names do not fit its numbers."""
    try:
        return list(_READERS[kind](Cursor(data, encoding)))
    except (struct.error, UnicodeDecodeError) as error:
        raise MessageError(f"is damaged: {error}") from error


def _joint_state(cursor: Cursor) -> Iterator[Reading]:
    """Decode a JointState; its efforts are not read."""
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
    """Decode a header followed by ``count`` numbers."""
    stamp, frame = cursor.header()
    yield Reading(stamp, (frame,), cursor.numbers("d", 8, count))


def _transforms(cursor: Cursor) -> Iterator[Reading]:
    """Decode the transforms of a TF message; the leading slash that old programs give frames is removed."""
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
