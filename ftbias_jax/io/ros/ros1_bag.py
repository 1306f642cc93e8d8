"""ROS 1 bags (format 2.0).

A record is header length, header, data length, data, both lengths uint32. The header is a list of fields
``name=value``; ``op`` is the kind of record. A chunk's data are perhaps compressed.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping

from ftbias_jax.io.limits.budget import Budget
from ftbias_jax.io.limits.unpack import unpack, unpack_cut
from ftbias_jax.io.ros.raw import Buffer, ChunkedFile, Definition, OnDamage, RawMessage, Record, plain_type

MAX_HEADER = 1 << 16  # bytes: the longest real ones hold a topic's name
MESSAGE, FILE_HEADER, CHUNK, CONNECTION = 2, 3, 5, 7

_OPERATIONS = frozenset(range(2, 8))
_OP_FIELD = re.compile(rb"\x04\x00\x00\x00op=[\x02-\x07]")
_BEFORE_OP = 160  # bytes of other fields that may stand before op; the search after damage looks no farther back


class Ros1Bag(ChunkedFile):
    """One bag; after damage the search goes on at the next header that holds together, also inside of a plain chunk."""

    MAGIC = b"#ROSBAG V2.0\n"
    CHUNK, MESSAGE = CHUNK, MESSAGE
    DEFINING = {CONNECTION: "a connection"}  # noqa: RUF012
    DAMAGED = "has a damaged header"

    def __init__(self, data: Buffer, on_damage: OnDamage, budget: Budget) -> None:
        super().__init__(data, on_damage, budget)
        self.topics: dict[int, tuple[str, str, Definition]] = {}  # connection: topic and type

    def _note(self, record: Record) -> None:
        index = int.from_bytes(record.header.get(b"index_pos", b""), "little") if record.kind == FILE_HEADER else 0
        if index > len(self.data):
            self.on_damage(f"is cut short: its index should be at byte {index}, it has {len(self.data)}")

    def _chunk(self, record: Record) -> bytes:
        compression, size = record.header[b"compression"].decode(), _integer(record.header, b"size")
        content = self.data[record.start : record.end]
        return (unpack if record.whole else unpack_cut)(compression, content, size, self.budget)

    def _message(self, record: Record, content: bytes) -> RawMessage:
        topic, message_type, definition = self.topics[_integer(record.header, b"conn")]
        seconds, nanoseconds = struct.unpack("<II", record.header[b"time"])
        return RawMessage(topic, message_type, "ros1", seconds * 10**9 + nanoseconds, content, definition)

    def _learn(self, record: Record, content: bytes) -> None:
        fields = _fields(content)
        definition = Definition("ros1msg", fields.get(b"message_definition", b"").decode(errors="replace"))
        topic, message_type = record.header[b"topic"].decode(), plain_type(fields[b"type"].decode())
        self.topics[_integer(record.header, b"conn")] = (topic, message_type, definition)

    def _record_at(self, data: Buffer, position: int) -> Record | None:
        if position + 4 > len(data):
            return None
        (length,) = struct.unpack_from("<I", data, position)
        start = position + 4 + length + 4
        if length > MAX_HEADER or start > len(data):
            return None
        try:
            header = _fields(data[position + 4 : start - 4])
            (op,) = header[b"op"]
        except (KeyError, ValueError, struct.error):
            return None
        end = start + int(struct.unpack_from("<I", data, start - 4)[0])
        if op not in _OPERATIONS:
            return None
        if end <= len(data):
            return Record(op, start, end, header=header)
        packed = op == CHUNK and header.get(b"compression", b"none") != b"none"
        return Record(op, start, len(data), whole=False, header=header) if packed else None

    def _next_whole(self, data: Buffer, position: int) -> int:
        for match in _OP_FIELD.finditer(data, position):
            for start in range(match.start() - 4, max(position, match.start() - 4 - _BEFORE_OP) - 1, -1):
                self.budget.count()
                if self._record_at(data, start) is not None:
                    return start
        return len(data)


def _fields(header: bytes) -> dict[bytes, bytes]:
    """The fields of a header by name; KeyError or struct.error if it is damaged."""
    fields, position = {}, 0
    while position < len(header):
        (size,) = struct.unpack_from("<I", header, position)
        position += 4
        name, equals, value = header[position : position + size].partition(b"=")
        if not equals or position + size > len(header):
            raise KeyError("a field without a value")
        fields[name] = value
        position += size
    return fields


def _integer(header: Mapping[bytes, bytes], name: bytes) -> int:
    return int(struct.unpack("<I", header[name])[0])
