"""What the columns of a Parquet file unpack to, before a library takes memory for them.

The footer of a file says how large its columns are, and each page says so again in a header of its own, by which the
memory is taken. pyarrow ends the process where some footers are damaged and it is asked for a column's sizes, so both
are read here: structs of Thrift's compact protocol.
"""

from __future__ import annotations

import mmap
from collections.abc import Collection
from typing import Any

from ftbias_jax.errors import LogError
from ftbias_jax.io.limits.budget import MAX_CHUNK, Budget

MAX_DEPTH = 16
MAX_HEADER = 1 << 16
"""Bytes: of numbers it takes about 50."""
TAIL = 8
"""Bytes at the end of a file: the length of its footer, and its mark."""
TRUE, FALSE, BYTE, I16, I32, I64, DOUBLE, BINARY, LIST, SET, MAP, STRUCT = range(1, 13)
"""Types of the compact protocol."""
DAMAGE = (IndexError, KeyError, TypeError, ValueError, AttributeError)


class Thrift:
    """Values one after the other; ValueError or IndexError if they are none, or do not end in these bytes."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def struct(self, depth: int = 0) -> dict[int, Any]:
        """Fields by number: int, bytes, lists and structs; None for numbers of other types, truth is left out."""
        fields: dict[int, Any] = {}
        number = 0
        while head := self._byte():
            number = number + (head >> 4) if head >> 4 else self._integer()
            if head & 15 not in (TRUE, FALSE):  # a field of truth has its value in its type
                fields[number] = self._value(head & 15, depth + 1)
        return fields

    def _value(self, kind: int, depth: int) -> Any:
        if depth > MAX_DEPTH:
            raise ValueError("too deep")
        if kind in (I16, I32, I64):
            return self._integer()
        if kind == STRUCT:
            return self.struct(depth)
        if kind in (LIST, SET):
            head = self._byte()
            count = head >> 4 if head >> 4 < 15 else self._varint()
            if count > len(self.data) - self.at:  # every value takes a byte at least
                raise ValueError("longer than its struct")
            return [self._value(head & 15, depth) for _ in range(count)]
        if kind not in (TRUE, FALSE, BYTE, DOUBLE, BINARY):
            raise ValueError("unknown type")  # Parquet has no maps
        size = self._varint() if kind == BINARY else 8 if kind == DOUBLE else 1
        self.at += size
        if self.at > len(self.data):
            raise ValueError("reaches out of its struct")
        return self.data[self.at - size : self.at] if kind == BINARY else None

    def _byte(self) -> int:
        self.at += 1
        return self.data[self.at - 1]

    def _varint(self) -> int:
        value = 0
        for shift in range(0, 64, 7):
            byte = self._byte()
            value |= (byte & 127) << shift
            if byte < 128:
                return value
        raise ValueError("too long")

    def _integer(self) -> int:
        """Of zigzag: 0, -1, 1, -2, 2 are 0, 1, 2, 3, 4."""
        value = self._varint()
        return (value >> 1) ^ -(value & 1)


def check_pages(file: str, names: Collection[str], budget: Budget) -> int:
    """The rows of a file, whose columns of these names unpack to no more than its size allows, whatever it says."""
    with open(file, "rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
        length = int.from_bytes(content[-TAIL : 4 - TAIL], "little")  # was checked before
        try:
            groups = Thrift(content[-TAIL - length : -TAIL]).struct()[4]
            chunks = [[_chunk(column[3]) for column in group[1]] for group in groups]
            rows = sum(int(group[3]) for group in groups)
            for group, parts in zip(groups, chunks, strict=True):
                budget.unpack(max(group[2], sum(max(unpacked, 0) for *_, unpacked in parts), 0))
        except DAMAGE as error:
            raise LogError("is damaged: its footer cannot be read", file=file, remedy="write it again") from error
        if rows <= 0:
            raise LogError("has no rows", file=file, remedy="record a log, and export it whole")
        pages = Budget(file)
        for name, start, stored, _ in (chunk for parts in chunks for chunk in parts if chunk[0] in names):
            _check_column(content, start, start + stored, name, pages)
    return rows


def _chunk(fields: dict[int, Any]) -> tuple[str, int, int, int]:
    """Of a column in a row group its name, where its pages begin, and their bytes as stored and as unpacked."""
    dictionary = fields.get(11, 0)
    start = min(fields[9], dictionary) if dictionary > 0 else fields[9]
    return fields[3][0].decode("utf-8", "replace"), start, fields[7], fields[6]


def _check_column(content: Any, at: int, end: int, name: str, budget: Budget) -> None:
    """Refuse pages that are too large, one or all together, or that do not fill their column."""
    damaged = LogError(
        "is damaged: its pages do not fill their column", file=budget.file, field=name, remedy="write it again"
    )
    if not 0 <= at <= end <= len(content):
        raise damaged
    while at < end:
        budget.count()
        header = Thrift(content[at : min(end, at + MAX_HEADER)])
        try:
            fields = header.struct()
            unpacked, stored = fields[2], fields[3]
            if unpacked < 0 or stored < 0:
                raise ValueError("no sizes")
        except DAMAGE as error:
            raise damaged from error
        if unpacked > MAX_CHUNK:
            message = f"has a page that unpacks to {unpacked} bytes"
            remedy = f"the limit is {MAX_CHUNK}; write it again with smaller pages"
            raise LogError(message, file=budget.file, field=name, remedy=remedy)
        budget.unpack(unpacked)
        at += header.at + stored
    if at != end:
        raise damaged
