"""ROS 1 bags (format 2.0), read from front to back: no index is needed, so cut or unfinished ones read as well.

A bag is a list of records: header length, header, data length, data, all lengths uint32. The header is a list of
fields ``name=value``; ``op`` is the kind of record. A chunk's data are records again, perhaps compressed.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from ftbias_jax.io.limits.budget import Budget
from ftbias_jax.io.ros.raw import Buffer, Definition, OnDamage, RawMessage, plain_type, scan_records
from ftbias_jax.io.unpack import UnpackError, unpack, unpack_cut

MAGIC = b"#ROSBAG V2.0\n"
MAX_HEADER = 1 << 16  # bytes: the longest real ones hold a topic's name
MESSAGE, FILE_HEADER, CHUNK, CONNECTION = 2, 3, 5, 7

_OPERATIONS = frozenset(range(2, 8))
_OP_FIELD = re.compile(rb"\x04\x00\x00\x00op=[\x02-\x07]")
_BEFORE_OP = 160  # bytes of other fields that may stand before op; the search after damage looks no farther back
_DAMAGE = (KeyError, struct.error, UnicodeDecodeError)

Topics = dict[int, tuple[str, str, Definition]]  # connection: topic and type


class _Record(NamedTuple):
    op: int
    header: Mapping[bytes, bytes]
    start: int
    """Of its data."""
    end: int
    whole: bool = True
    """False for a compressed chunk whose end is missing; without compression, the search goes on inside."""


def scan_bag(data: Buffer, on_damage: OnDamage, budget: Budget) -> Iterator[RawMessage]:
    """All messages of a bag that starts with MAGIC; what is damaged is told to ``on_damage`` and skipped."""
    topics: Topics = {}
    # The connections stand once more behind the chunks: a first pass over the outermost records finds those.
    for record in _records(data, len(MAGIC), lambda _: None, budget):
        if record.op == CONNECTION:
            _learn(data, record, topics, lambda _: None)
    for record in _records(data, len(MAGIC), on_damage, budget):
        if record.op == CHUNK:
            try:
                chunk = _unpack_chunk(data, record, budget)
            except (UnpackError, *_DAMAGE) as error:
                on_damage(f"the chunk at byte {record.start} {_clause(error)}")
                continue
            if not record.whole:
                on_damage(f"the chunk at byte {record.start} is cut short")
            for inner in _records(chunk, 0, on_damage, budget):
                yield from _message(chunk, inner, topics, on_damage)
        elif record.op == FILE_HEADER:
            index = int.from_bytes(record.header.get(b"index_pos", b""), "little")
            if index > len(data):
                on_damage(f"is cut short: its index should be at byte {index}, it has {len(data)}")
        else:
            yield from _message(data, record, topics, on_damage)


def _unpack_chunk(data: Buffer, record: _Record, budget: Budget) -> bytes:
    compression, size = record.header[b"compression"].decode(), _integer(record.header, b"size")
    return (unpack if record.whole else unpack_cut)(compression, data[record.start : record.end], size, budget)


def _message(data: Buffer, record: _Record, topics: Topics, on_damage: OnDamage) -> Iterator[RawMessage]:
    """The message in a record, if it is one; a connection is learnt."""
    if record.op == CONNECTION:
        _learn(data, record, topics, on_damage)
    if record.op != MESSAGE:
        return
    try:
        topic, message_type, definition = topics[_integer(record.header, b"conn")]
        seconds, nanoseconds = struct.unpack("<II", record.header[b"time"])
    except _DAMAGE as error:
        on_damage(f"a message {_clause(error)}")
        return
    logged = seconds * 10**9 + nanoseconds
    yield RawMessage(topic, message_type, "ros1", logged, data[record.start : record.end], definition)


def _learn(data: Buffer, record: _Record, topics: Topics, on_damage: OnDamage) -> None:
    try:
        fields = _fields(data[record.start : record.end])
        definition = Definition("ros1msg", fields.get(b"message_definition", b"").decode(errors="replace"))
        topic, message_type = record.header[b"topic"].decode(), plain_type(fields[b"type"].decode())
        topics[_integer(record.header, b"conn")] = (topic, message_type, definition)
    except _DAMAGE as error:
        on_damage(f"a connection {_clause(error)}")


def _records(data: Buffer, position: int, on_damage: OnDamage, budget: Budget) -> Iterator[_Record]:
    """The records from a position on; after damage the search goes on at the next header that holds together."""
    return scan_records(data, position, _record, _next_record, on_damage, budget)


def _record(data: Buffer, position: int) -> _Record | None:
    """The record at a position, or None if its header or its lengths make no sense."""
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
        return _Record(op, header, start, end)
    packed = op == CHUNK and header.get(b"compression", b"none") != b"none"
    return _Record(op, header, start, len(data), whole=False) if packed else None


def _next_record(data: Buffer, position: int, budget: Budget) -> int:
    """Where the next record that holds together starts, or the end of the data."""
    for match in _OP_FIELD.finditer(data, position):
        for start in range(match.start() - 4, max(position, match.start() - 4 - _BEFORE_OP) - 1, -1):
            budget.count()
            if _record(data, start) is not None:
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


def _clause(error: Exception) -> str:
    return str(error) if isinstance(error, UnpackError) else f"has a damaged header: {error}"
