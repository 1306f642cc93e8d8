"""Readers of record-based ROS containers: ROS 1 bags (format 2.0) and MCAP files (https://mcap.dev/spec).

A record of a bag consists of header length, header, data length and data, both lengths uint32. The header is a list of
fields ``name=value``; ``op`` is the kind of record. A chunk's data may be compressed.

A record of an MCAP file consists of its kind (uint8), its length (uint64) and its content.
"""

import re
import struct
import zlib
from collections.abc import Iterator, Mapping

from ftbias_jax.io.budget import Budget, UnpackError, unpack, unpack_cut
from ftbias_jax.io.ros import raw
from ftbias_jax.io.ros.raw import Buffer, ChunkedFile, Definition, OnDamage, RawMessage, Record, plain_type

MAX_HEADER = 1 << 16  # bytes of a bag record's header; the longest real ones hold a topic's name
FILE_HEADER, CONNECTION = 3, 7
LONGEST_NAME = 4  # characters of a compression's name in MCAP: "", "lz4", "zstd"
FOOTER, SCHEMA, CHANNEL, DATA_END = 2, 3, 4, 15

_OPERATIONS = frozenset(range(2, 8))
_OP_FIELD = re.compile(rb"\x04\x00\x00\x00op=[\x02-\x07]")
_BEFORE_OP = 160  # bytes of other fields that may precede op; the search after damage looks back no farther
_RECORD = struct.Struct("<BQ")
_CHUNK = struct.Struct("<QQQI")  # first and last time, unpacked size, checksum
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, logged, published


class Ros1Bag(ChunkedFile):
    """A ROS 1 bag; after damage, reading resumes at the next valid header, also inside an uncompressed chunk."""

    MAGIC = b"#ROSBAG V2.0\n"
    CHUNK, MESSAGE = 5, 2
    DEFINING = {CONNECTION: "a connection"}  # noqa: RUF012
    DAMAGED = "has a damaged header"

    def __init__(self, data: Buffer, on_damage: OnDamage, budget: Budget) -> None:
        super().__init__(data, on_damage, budget)
        self.topics: dict[int, tuple[str, str, Definition]] = {}  # connection -> topic, type, definition

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
        packed = op == self.CHUNK and header.get(b"compression", b"none") != b"none"
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


class McapFile(ChunkedFile):
    """An MCAP file; after damage, reading resumes at the next whole chunk."""

    MAGIC = b"\x89MCAP0\r\n"
    CHUNK, MESSAGE, LAST = 6, 5, FOOTER
    DEFINING = dict.fromkeys((SCHEMA, CHANNEL), "a schema or channel")

    def __init__(self, data: Buffer, on_damage: OnDamage, budget: Budget) -> None:
        super().__init__(data, on_damage, budget)
        self.schemas: dict[int, tuple[str, Definition]] = {0: ("", raw.UNDEFINED)}
        self.channels: dict[int, tuple[str, tuple[str, Definition], str]] = {}  # topic, schema, encoding
        self.finished = False

    def scan(self) -> Iterator[RawMessage]:
        """Yield all messages."""
        yield from super().scan()
        if not self.finished:
            self.on_damage("is cut short: it ends without a footer")

    def _note(self, record: Record) -> None:
        self.finished = self.finished or record.kind in (FOOTER, DATA_END)

    def _chunk(self, record: Record) -> bytes:
        """The records of a chunk, verified by its checksum; a truncated chunk cannot be verified."""
        content = self.data[record.start : record.end]
        _, _, size, checksum = _CHUNK.unpack_from(content)
        compression, position = _text(content, _CHUNK.size)
        if not record.whole:
            return unpack_cut(compression, content[position + 8 :], size, self.budget)
        records = unpack(compression, content[position + 8 :], size, self.budget)
        if checksum and checksum != zlib.crc32(records):
            raise UnpackError("does not match its checksum")
        return records

    def _message(self, record: Record, content: bytes) -> RawMessage:
        channel, _, logged, _ = _MESSAGE.unpack_from(content)
        topic, (message_type, definition), encoding = self.channels[channel]
        return RawMessage(topic, message_type, encoding, logged, content[_MESSAGE.size :], definition)

    def _learn(self, record: Record, content: bytes) -> None:
        (identity,) = struct.unpack_from("<H", content)
        if record.kind == SCHEMA:
            name, position = _text(content, 2)
            language, position = _text(content, position)
            try:
                definition = _text(content, position)[0]
            except raw.DAMAGE:
                definition = ""  # needed only if fields of this type are requested
            self.schemas[identity] = (plain_type(name), Definition(language, definition))
        else:
            (schema,) = struct.unpack_from("<H", content, 2)
            topic, position = _text(content, 4)
            self.channels[identity] = (topic, self.schemas[schema], _text(content, position)[0])

    def _record_at(self, data: Buffer, position: int) -> Record | None:
        start = position + _RECORD.size
        if start > len(data):
            return None
        kind, length = _RECORD.unpack_from(data, position)
        if kind and length <= len(data) - start:
            return Record(kind, start, start + length)
        end = _chunk_end(data, start) if kind == self.CHUNK else None
        return None if end is None else Record(kind, start, min(end, len(data)), end <= len(data))

    def _next_whole(self, data: Buffer, position: int) -> int:
        while (position := data.find(bytes([self.CHUNK]), position)) >= 0:
            self.budget.count()
            record = self._record_at(data, position)
            if record is not None and record.end == _chunk_end(data, record.start):
                return position
            position += 1
        return len(data)


def _chunk_end(data: Buffer, start: int) -> int | None:
    """End of a chunk's content that starts here, by the chunk's own lengths, which repeat the record's length."""
    try:
        (length,) = struct.unpack_from("<I", data, start + _CHUNK.size)
        records = start + _CHUNK.size + 4 + length
        return records + 8 + int(struct.unpack_from("<Q", data, records)[0]) if length <= LONGEST_NAME else None
    except struct.error:
        return None


def _text(content: bytes, position: int) -> tuple[str, int]:
    """The string at a position, and the position after it."""
    (length,) = struct.unpack_from("<I", content, position)
    end = position + 4 + length
    if end > len(content):
        raise KeyError("a text is longer than its record")
    return content[position + 4 : end].decode(), end
