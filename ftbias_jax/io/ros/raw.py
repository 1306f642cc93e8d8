"""What all recordings of ROS are to their readers: messages as bytes, in the order in which they were stored."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from mmap import mmap
from typing import NamedTuple, Protocol, TypeVar

from ftbias_jax.io.limits.budget import Budget

Buffer = bytes | mmap
OnDamage = Callable[[str], None]
"""Called with one line about what could not be read, before it is skipped; it may raise to stop instead."""


class FilePiece(Protocol):
    """A piece of a file that says itself where it ends."""

    @property
    def end(self) -> int:
        """Position after it."""


R = TypeVar("R", bound=FilePiece)


class Definition(NamedTuple):
    """What a recording says of a type of messages."""

    format: str = ""
    """ "ros1msg", "ros2msg" or "ros2idl"; "" = it says nothing."""
    text: str = ""


UNDEFINED = Definition()


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
    definition: Definition = UNDEFINED


def scan_records(
    data: Buffer,
    position: int,
    record_at: Callable[[Buffer, int], R | None],
    next_whole: Callable[[Buffer, int, Budget], int],
    on_damage: OnDamage,
    budget: Budget,
) -> Iterator[R]:
    """The records from a position on; what makes no sense is told and skipped."""
    while position < len(data):
        budget.count()
        record = record_at(data, position)
        if record is None:
            following = next_whole(data, position + 1, budget)
            on_damage(f"no whole record at byte {position}: {following - position} bytes skipped")
            position = following
        else:
            yield record
            position = record.end


def plain_type(message_type: str) -> str:
    """The type's name without the /msg/ that ROS 2 puts in the middle."""
    return message_type.replace("/msg/", "/")
