"""MCAP files, read from front to back: no index is needed, so cut ones read as well (https://mcap.dev/spec).

A file is a list of records: kind uint8, length uint64, content. A chunk's content are records again.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from typing import NamedTuple

from ftbias_jax.io.limits.budget import Budget
from ftbias_jax.io.ros.raw import UNDEFINED, Buffer, Definition, OnDamage, RawMessage, plain_type, scan_records
from ftbias_jax.io.unpack import UnpackError, unpack, unpack_cut

MAGIC = b"\x89MCAP0\r\n"
LONGEST_NAME = 4  # of a compression: "", "lz4", "zstd"
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, DATA_END = 2, 3, 4, 5, 6, 15

_RECORD = struct.Struct("<BQ")
_CHUNK = struct.Struct("<QQQI")  # first and last time, unpacked size, checksum
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, logged, published
_DAMAGE = (KeyError, struct.error, UnicodeDecodeError)


class _Record(NamedTuple):
    kind: int
    start: int
    """Of its content."""
    end: int
    whole: bool = True
    """False for a chunk whose end is missing."""


class _Known(NamedTuple):
    """Schemas and channels read so far."""

    schemas: dict[int, tuple[str, Definition]]
    """Type, and how it is defined."""
    channels: dict[int, tuple[str, tuple[str, Definition], str]]
    """Topic, schema, encoding."""


def scan_mcap(data: Buffer, on_damage: OnDamage, budget: Budget) -> Iterator[RawMessage]:
    """All messages of a file that starts with MAGIC; what is damaged is told to ``on_damage`` and skipped."""
    known = _Known({0: ("", UNDEFINED)}, {})
    # Schemas and channels stand once more behind the chunks: a first pass over the outermost records finds those.
    for record in _records(data, len(MAGIC), lambda _: None, budget):
        if record.kind in (SCHEMA, CHANNEL):
            _learn(data, record, known, lambda _: None)
    finished = False
    for record in _records(data, len(MAGIC), on_damage, budget):
        if record.kind == CHUNK:
            try:
                chunk = _unpack_chunk(data[record.start : record.end], record.whole, budget)
            except (UnpackError, *_DAMAGE) as error:
                on_damage(f"the chunk at byte {record.start} {_clause(error)}")
                continue
            if not record.whole:
                on_damage(f"the chunk at byte {record.start} is cut short")
            for inner in _records(chunk, 0, on_damage, budget):
                yield from _message(chunk, inner, known, on_damage)
        elif record.kind in (FOOTER, DATA_END):
            finished = True
        else:
            yield from _message(data, record, known, on_damage)
    if not finished:
        on_damage("is cut short: it ends without a footer")


def _unpack_chunk(content: bytes, whole: bool, budget: Budget) -> bytes:
    """The records of a chunk, if its checksum says that they are what was written; there is none for half a chunk."""
    _, _, size, checksum = _CHUNK.unpack_from(content)
    compression, position = _text(content, _CHUNK.size)
    if not whole:
        return unpack_cut(compression, content[position + 8 :], size, budget)
    records = unpack(compression, content[position + 8 :], size, budget)
    if checksum and checksum != zlib.crc32(records):
        raise UnpackError("does not match its checksum")
    return records


def _message(data: Buffer, record: _Record, known: _Known, on_damage: OnDamage) -> Iterator[RawMessage]:
    """The message in a record, if it is one; schemas and channels are learnt."""
    if record.kind in (SCHEMA, CHANNEL):
        _learn(data, record, known, on_damage)
    if record.kind != MESSAGE:
        return
    content = data[record.start : record.end]
    try:
        channel, _, logged, _ = _MESSAGE.unpack_from(content)
        topic, (message_type, definition), encoding = known.channels[channel]
    except _DAMAGE as error:
        on_damage(f"a message {_clause(error)}")
        return
    yield RawMessage(topic, message_type, encoding, logged, content[_MESSAGE.size :], definition)


def _learn(data: Buffer, record: _Record, known: _Known, on_damage: OnDamage) -> None:
    content = data[record.start : record.end]
    try:
        (identity,) = struct.unpack_from("<H", content)
        if record.kind == SCHEMA:
            name, position = _text(content, 2)
            language, position = _text(content, position)
            known.schemas[identity] = (plain_type(name), Definition(language, _definition(content, position)))
        else:
            (schema,) = struct.unpack_from("<H", content, 2)
            topic, position = _text(content, 4)
            known.channels[identity] = (topic, known.schemas[schema], _text(content, position)[0])
    except _DAMAGE as error:
        on_damage(f"a schema or channel {_clause(error)}")


def _records(data: Buffer, position: int, on_damage: OnDamage, budget: Budget) -> Iterator[_Record]:
    """The records from a position on, to the footer; after damage the search goes on at the next whole chunk."""
    for record in scan_records(data, position, _record, _next_chunk, on_damage, budget):
        yield record
        if record.kind == FOOTER:
            return


def _record(data: Buffer, position: int) -> _Record | None:
    """The record at a position, or None if there is no room for it."""
    start = position + _RECORD.size
    if start > len(data):
        return None
    kind, length = _RECORD.unpack_from(data, position)
    if kind and length <= len(data) - start:
        return _Record(kind, start, start + length)
    end = _chunk_end(data, start) if kind == CHUNK else None
    return None if end is None else _Record(kind, start, min(end, len(data)), end <= len(data))


def _next_chunk(data: Buffer, position: int, budget: Budget) -> int:
    """Where the next record starts that has the lengths of a chunk, or the end of the data."""
    while (position := data.find(bytes([CHUNK]), position)) >= 0:
        budget.count()
        record = _record(data, position)
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


def _definition(content: bytes, position: int) -> str:
    """The text of a schema; "" if it is none, which matters to nobody who does not ask for it."""
    try:
        return _text(content, position)[0]
    except _DAMAGE:
        return ""


def _clause(error: Exception) -> str:
    return str(error) if isinstance(error, UnpackError) else f"is damaged: {error}"
