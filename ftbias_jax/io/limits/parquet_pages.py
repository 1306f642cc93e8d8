"""Pages of Parquet columns: what each says that it unpacks to, before a library takes memory for it.

The footer of a file says how large its columns are, and each page says so again in a header of its own, by which the
memory is taken. Headers are structs of Thrift's compact protocol; of one only the sizes are read, the rest is skipped.
"""

from __future__ import annotations

import mmap
from collections.abc import Collection, Iterator
from typing import Any, NamedTuple

from ftbias_jax.errors import LogError
from ftbias_jax.io.limits.budget import MAX_CHUNK, Budget

MAX_HEADER = 1 << 16
"""Bytes: of numbers it takes about 50."""
MAX_DEPTH = 16
UNPACKED, STORED = 2, 3
"""Numbers of the fields of a page's header."""
TRUE, FALSE, BYTE, I16, I32, I64, DOUBLE, BINARY, LIST, SET, MAP, STRUCT = range(1, 13)
"""Types of the compact protocol."""


class Page(NamedTuple):
    """One page of a column, as its header says."""

    header: int
    """Bytes of the header itself."""
    stored: int
    """Bytes behind it."""
    unpacked: int
    """Bytes that these become."""


def check_pages(file: str, metadata: Any, names: Collection[str]) -> None:
    """Refuse a file whose pages unpack to more than its size allows, whatever the footer says.

    Args:
        file: the path.
        metadata: its footer, of pyarrow.
        names: of the columns that are read.

    Raises:
        LogError: a page is too large, all pages together are, or a header cannot be read.
    """
    budget = Budget(file)
    with open(file, "rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
        for group in (metadata.row_group(i) for i in range(metadata.num_row_groups)):
            for chunk in (group.column(i) for i in range(group.num_columns)):
                if chunk.path_in_schema.split(".")[0] not in names:
                    continue
                for page in pages_of(content, chunk, file):
                    budget.count()
                    if page.unpacked > MAX_CHUNK:
                        message = f"has a page that unpacks to {page.unpacked} bytes"
                        remedy = f"the limit is {MAX_CHUNK}; write it again with smaller pages"
                        raise LogError(message, file=file, field=chunk.path_in_schema, remedy=remedy)
                    budget.unpack(page.unpacked)


def pages_of(content: Any, chunk: Any, file: str) -> Iterator[Page]:
    """The pages of a column in one row group.

    Args:
        content: bytes of the whole file.
        chunk: what pyarrow's footer says of the column.
        file: the name in messages.

    Raises:
        LogError: a header is damaged, or reaches out of the column.
    """
    starts = [chunk.data_page_offset]
    if chunk.has_dictionary_page and (chunk.dictionary_page_offset or 0) > 0:
        starts.append(chunk.dictionary_page_offset)
    at = min(starts)
    end = at + chunk.total_compressed_size
    values = 0 <= at <= end <= len(content)
    while values and at < end:
        try:
            page = page_at(content[at : min(end, at + MAX_HEADER)])
        except (IndexError, ValueError):
            values = False
            break
        yield page
        at += page.header + page.stored
    if not values or at != end:
        message, remedy = "is damaged: its pages do not fill their column", "write it again"
        raise LogError(message, file=file, field=chunk.path_in_schema, remedy=remedy)


def page_at(header: bytes) -> Page:
    """The page whose header these bytes begin with.

    Raises:
        ValueError, IndexError: it is none, or is longer than these bytes.
    """
    fields: dict[int, int] = {}
    length = _struct(header, 0, 0, fields)
    stored, unpacked = fields.get(STORED, -1), fields.get(UNPACKED, -1)
    if stored < 0 or unpacked < 0:
        raise ValueError("no sizes")
    return Page(length, stored, unpacked)


def _struct(data: bytes, at: int, depth: int, numbers: dict[int, int] | None = None) -> int:
    """Where a struct ends that begins at ``at``; its integers are put into ``numbers`` by their fields."""
    if depth > MAX_DEPTH:
        raise ValueError("too deep")
    field = 0
    while True:
        step, kind = data[at] >> 4, data[at] & 15
        at += 1
        if kind == 0:
            return at
        if step:
            field += step
        else:
            number, at = _varint(data, at)
            field = _signed(number)
        if kind in (I16, I32, I64):
            value, at = _varint(data, at)
            if numbers is not None:
                numbers[field] = _signed(value)
        elif kind not in (TRUE, FALSE):  # a field of truth has its value in its type
            at = _skip(data, at, kind, depth + 1)


def _skip(data: bytes, at: int, kind: int, depth: int) -> int:
    """Where a value ends that begins at ``at``."""
    if kind in (TRUE, FALSE, BYTE):
        return at + 1
    if kind in (I16, I32, I64):
        return _varint(data, at)[1]
    if kind == DOUBLE:
        return at + 8
    if kind == BINARY:
        length, at = _varint(data, at)
        return at + length
    if kind == STRUCT:
        return _struct(data, at, depth)
    if kind not in (LIST, SET):  # no page's header has a map
        raise ValueError("unknown type")
    count, of = data[at] >> 4, data[at] & 15
    at += 1
    if count == 15:
        count, at = _varint(data, at)
    for _ in range(min(count, len(data))):
        at = _skip(data, at, of, depth + 1)
    return at


def _varint(data: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = data[at]
        at += 1
        value |= (byte & 127) << shift
        if byte < 128:
            return value, at
        shift += 7
        if shift > 63:
            raise ValueError("too long")


def _signed(value: int) -> int:
    """Of zigzag: 0, -1, 1, -2, 2 are 0, 1, 2, 3, 4."""
    return (value >> 1) ^ -(value & 1)
