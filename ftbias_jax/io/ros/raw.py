"""Common interface of ROS recordings: messages as bytes, in the order in which they were stored."""

import struct
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from mmap import mmap
from typing import Any, ClassVar, NamedTuple

from ftbias_jax.io.budget import Budget, UnpackError

Buffer = bytes | mmap
OnDamage = Callable[[str], None]
"""Called with one line about what could not be read, before it is skipped; it may raise to stop instead."""


class Definition(NamedTuple):
    """Definition of a message type, as a recording stores it."""

    format: str = ""
    """ "ros1msg", "ros2msg" or "ros2idl"; "" = no definition is stored."""
    text: str = ""


UNDEFINED = Definition()


class RawMessage(NamedTuple):
    """One message as it was stored."""

    topic: str
    message_type: str
    """Plain type such as ``sensor_msgs/JointState``, the same for ROS 1 and 2."""
    encoding: str
    """"ros1" or "cdr", or an encoding that ROS does not use."""
    logged: int
    """ns; time at which the recorder received the message."""
    data: bytes
    definition: Definition = UNDEFINED


class Record(NamedTuple):
    """A section of a file that states its own length."""

    kind: int
    start: int
    """Byte at which the content starts."""
    end: int
    whole: bool = True
    """False for a chunk whose end is missing, but of which a part can still be read."""
    header: Mapping[bytes, bytes] = {}
    """Fields of the header of a ROS 1 record."""


class ChunkedFile(ABC):
    """A file of records, some of which are chunks of records, read from front to back.

    No index is needed, so files that are truncated or were never finished are read as well. Damage is reported to
    ``on_damage`` and skipped; a LogError is raised if a decompressor is not installed, or the budget is spent.
    """

    MAGIC: ClassVar[bytes]
    CHUNK: ClassVar[int]
    MESSAGE: ClassVar[int]
    DEFINING: ClassVar[Mapping[int, str]]
    """Kinds of records that define types or topics -> their names in error messages."""
    LAST: ClassVar[int | None] = None
    """Kind of record after which nothing is read."""
    DAMAGED: ClassVar[str] = "is damaged"

    def __init__(self, data: Buffer, on_damage: OnDamage, budget: Budget) -> None:
        self.data, self.on_damage, self.budget = data, on_damage, budget

    @abstractmethod
    def _record_at(self, data: Buffer, position: int) -> Record | None:
        """The record at a position, or None if there is no valid one."""

    @abstractmethod
    def _next_whole(self, data: Buffer, position: int) -> int:
        """Start of the next valid record from a position on, or the end of the data."""

    @abstractmethod
    def _chunk(self, record: Record) -> bytes:
        """The decompressed records of a chunk."""

    @abstractmethod
    def _learn(self, record: Record, content: bytes) -> None:
        """Store the type or topic that a record defines."""

    @abstractmethod
    def _message(self, record: Record, content: bytes) -> RawMessage:
        """The message in a record."""

    def _note(self, record: Record) -> None:  # noqa: B027
        """Hook for every record of the file that is not a chunk."""

    def scan(self) -> Iterator[RawMessage]:
        """Yield all messages."""
        # Definitions are repeated after the chunks: a first pass over the outermost records finds them.
        for record in self._records(self.data, len(self.MAGIC), _ignore):
            if record.kind in self.DEFINING:
                self._try(self._learn, record, self.data, _ignore)
        for record in self._records(self.data, len(self.MAGIC), self.on_damage):
            if record.kind != self.CHUNK:
                self._note(record)
                yield from self._messages(self.data, record)
                continue
            try:
                chunk = self._chunk(record)
            except (UnpackError, *DAMAGE) as error:
                self.on_damage(f"the chunk at byte {record.start} {self._clause(error)}")
                continue
            if not record.whole:
                self.on_damage(f"the chunk at byte {record.start} is cut short")
            for inner in self._records(chunk, 0, self.on_damage):
                yield from self._messages(chunk, inner)

    def _records(self, data: Buffer, position: int, on_damage: OnDamage) -> Iterator[Record]:
        """Yield the records from a position on; invalid bytes are reported and skipped."""
        while position < len(data):
            self.budget.count()
            record = self._record_at(data, position)
            if record is None:
                following = self._next_whole(data, position + 1)
                on_damage(f"no whole record at byte {position}: {following - position} bytes skipped")
                position = following
                continue
            yield record
            if record.kind == self.LAST:
                return
            position = record.end

    def _messages(self, data: Buffer, record: Record) -> Iterator[RawMessage]:
        if record.kind in self.DEFINING:
            self._try(self._learn, record, data, self.on_damage)
        elif record.kind == self.MESSAGE:
            message = self._try(self._message, record, data, self.on_damage)
            if message is not None:
                yield message

    def _try(self, read: Callable[[Record, bytes], Any], record: Record, data: Buffer, on_damage: OnDamage) -> Any:
        try:
            return read(record, data[record.start : record.end])
        except DAMAGE as error:
            on_damage(f"{self.DEFINING.get(record.kind, 'a message')} {self._clause(error)}")

    def _clause(self, error: Exception) -> str:
        return str(error) if isinstance(error, UnpackError) else f"{self.DAMAGED}: {error}"


DAMAGE = (KeyError, struct.error, UnicodeDecodeError)


def _ignore(what: str) -> None:
    """Ignore damage in the first pass, because the second pass reports it."""


def plain_type(message_type: str) -> str:
    """The type's name without the /msg/ that ROS 2 inserts."""
    return message_type.replace("/msg/", "/")
