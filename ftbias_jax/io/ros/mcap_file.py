"""MCAP files (https://mcap.dev/spec).

A record is its kind uint8, its length uint64, and its content.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator

from ftbias_jax.io.limits.budget import Budget
from ftbias_jax.io.limits.unpack import UnpackError, unpack, unpack_cut
from ftbias_jax.io.ros.raw import (
    DAMAGE,
    UNDEFINED,
    Buffer,
    ChunkedFile,
    Definition,
    OnDamage,
    RawMessage,
    Record,
    plain_type,
)

LONGEST_NAME = 4  # of a compression: "", "lz4", "zstd"
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, DATA_END = 2, 3, 4, 5, 6, 15

_RECORD = struct.Struct("<BQ")
_CHUNK = struct.Struct("<QQQI")  # first and last time, unpacked size, checksum
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, logged, published


class McapFile(ChunkedFile):
    """One file; after damage the search goes on at the next whole chunk."""

    MAGIC = b"\x89MCAP0\r\n"
    CHUNK, MESSAGE, LAST = CHUNK, MESSAGE, FOOTER
    DEFINING = dict.fromkeys((SCHEMA, CHANNEL), "a schema or channel")

    def __init__(self, data: Buffer, on_damage: OnDamage, budget: Budget) -> None:
        super().__init__(data, on_damage, budget)
        self.schemas: dict[int, tuple[str, Definition]] = {0: ("", UNDEFINED)}
        self.channels: dict[int, tuple[str, tuple[str, Definition], str]] = {}  # topic, schema, encoding
        self.finished = False

    def scan(self) -> Iterator[RawMessage]:
        """All messages."""
        yield from super().scan()
        if not self.finished:
            self.on_damage("is cut short: it ends without a footer")

    def _note(self, record: Record) -> None:
        self.finished = self.finished or record.kind in (FOOTER, DATA_END)

    def _chunk(self, record: Record) -> bytes:
        """The records, if the checksum says that they are what was written; there is none for half a chunk."""
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
            except DAMAGE:
                definition = ""  # which matters to nobody who does not ask for it
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
        end = _chunk_end(data, start) if kind == CHUNK else None
        return None if end is None else Record(kind, start, min(end, len(data)), end <= len(data))

    def _next_whole(self, data: Buffer, position: int) -> int:
        while (position := data.find(bytes([CHUNK]), position)) >= 0:
            self.budget.count()
            record = self._record_at(data, position)
            if record is not None and record.end == _chunk_end(data, record.start):
                return position
            position += 1
        return len(data)


def _chunk_end(data: Buffer, start: int) -> int | None:
    """Where a chunk's content that starts here ends by its own account, which repeats the record's."""
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
