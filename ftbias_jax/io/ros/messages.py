"""The messages a log is made of, from their bytes: JointState or PoseStamped or TF, and WrenchStamped."""

from __future__ import annotations

import struct
from typing import NamedTuple

from ftbias_jax.io.ros.cursor import Cursor, MessageError

JOINT_STATE = "sensor_msgs/JointState"
WRENCH_STAMPED = "geometry_msgs/WrenchStamped"
POSE_STAMPED = "geometry_msgs/PoseStamped"
TF = "tf2_msgs/TFMessage"
STRING = "std_msgs/String"

MAX_JOINTS, MAX_TRANSFORMS = 1000, 10_000
"""Of one message; robots have fewer."""


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
    """Decode a sensor_msgs/JointState; its efforts are not read."""
    try:
        cursor = Cursor(data, encoding)
        stamp, _ = cursor.header()
        names = tuple(cursor.text() for _ in range(cursor.count(4, MAX_JOINTS)))
        message = JointState(stamp, names, cursor.floats(len(names)), cursor.floats(len(names)))
    except (struct.error, UnicodeDecodeError) as error:
        raise MessageError(f"is damaged: {error}") from error
    if len(set(names)) < len(names):
        raise MessageError("has two joints of one name")
    return message


def wrench_stamped(data: bytes, encoding: str) -> WrenchStamped:
    """Decode a geometry_msgs/WrenchStamped."""
    try:
        cursor = Cursor(data, encoding)
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
    """Decode a geometry_msgs/PoseStamped."""
    try:
        cursor = Cursor(data, encoding)
        stamp, frame = cursor.header()
        return [PoseStamped(stamp, (frame,), cursor.array(7))]
    except (struct.error, UnicodeDecodeError) as error:
        raise MessageError(f"is damaged: {error}") from error


def transforms(data: bytes, encoding: str) -> list[PoseStamped]:
    """Decode a tf2_msgs/TFMessage; frames without the slash that old programs put in front."""
    try:
        cursor = Cursor(data, encoding)
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
    """Decode a std_msgs/String."""
    try:
        return Cursor(data, encoding).text()
    except (struct.error, UnicodeDecodeError) as error:
        raise MessageError(f"is damaged: {error}") from error
