"""What all recordings of ROS are to their readers: messages as bytes, in the order in which they were stored."""

from __future__ import annotations

from collections.abc import Callable
from mmap import mmap
from typing import NamedTuple

Buffer = bytes | mmap
OnDamage = Callable[[str], None]
"""Called with one line about what could not be read, before it is skipped; it may raise to stop instead."""


class RawMessage(NamedTuple):
    """One message as it was stored."""

    topic: str
    message_type: str
    """Such as ``sensor_msgs/JointState``, the same for ROS 1 and 2."""
    encoding: str
    """"ros1" or "cdr", or something that is no encoding of ROS."""
    logged: int
    """ns, when the recorder got it."""
    data: bytes


def plain_type(message_type: str) -> str:
    """The type's name without the /msg/ that ROS 2 puts in the middle."""
    return message_type.replace("/msg/", "/")
