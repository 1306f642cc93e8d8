"""What the columns of a Parquet file unpack to, before a library takes memory for them.

The footer of a file says how large its columns are, and each page says so again in a header of its own, by which the
memory is taken.
"""

from __future__ import annotations

import mmap
from collections.abc import Collection, Iterator, Sequence
from typing import Any, NamedTuple

from ftbias_jax.errors import LogError
from ftbias_jax.io.limits.budget import MAX_CHUNK, Budget
from ftbias_jax.io.limits.thrift import struct_at

MAX_HEADER = 1 << 16
"""Bytes: of numbers it takes about 50."""
TAIL = 8
"""Bytes at the end of a file: the length of its footer, and its mark."""
ROW_GROUPS = 4
"""Field of the footer."""
COLUMNS, TOTAL_BYTES, ROWS = 1, 2, 3
"""Fields of a row group."""
META_DATA = 3
"""Field of a column."""
PATH, TOTAL_UNPACKED, TOTAL_STORED, DATA_PAGE, DICTIONARY_PAGE = 3, 6, 7, 9, 11
"""Fields of its metadata."""
UNPACKED, STORED = 2, 3
"""Fields of a page's header."""


class Chunk(NamedTuple):
    """A column in one row group, as the footer says."""

    name: str
    """Of the column; of a nested one that of the outermost."""
    start: int
    """The byte at which its pages begin."""
    stored: int
    """Bytes."""
    unpacked: int
    """Bytes that these become."""


class RowGroup(NamedTuple):
    """A part of the rows, as the footer says."""

    rows: int
    unpacked: int
    """Bytes."""
    chunks: tuple[Chunk, ...]


class Page(NamedTuple):
    """One page of a column, as its header says."""

    header: int
    """Bytes of the header itself."""
    stored: int
    """Bytes behind it."""
    unpacked: int
    """Bytes that these become."""


def row_groups(file: str) -> tuple[RowGroup, ...]:
    """What the footer of a file says, whose length was checked before."""
    with open(file, "rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
        try:
            length = int.from_bytes(content[-TAIL : 4 - TAIL], "little")
            footer, _ = struct_at(content[-TAIL - length : -TAIL])
            return tuple(map(_row_group, footer[ROW_GROUPS]))
        except (IndexError, KeyError, TypeError, ValueError, AttributeError) as error:
            raise LogError("is damaged: its footer cannot be read", file=file, remedy="write it again") from error


def _row_group(fields: dict[int, Any]) -> RowGroup:
    chunks = tuple(_chunk(column[META_DATA]) for column in fields[COLUMNS])
    return RowGroup(fields[ROWS], fields[TOTAL_BYTES], chunks)


def _chunk(fields: dict[int, Any]) -> Chunk:
    starts = [fields[DATA_PAGE]]
    if fields.get(DICTIONARY_PAGE, 0) > 0:
        starts.append(fields[DICTIONARY_PAGE])
    name = fields[PATH][0].decode("utf-8", "replace")
    return Chunk(name, min(starts), fields[TOTAL_STORED], fields[TOTAL_UNPACKED])


def check_pages(file: str, groups: Sequence[RowGroup], names: Collection[str]) -> None:
    """Refuse a file whose pages unpack to more than its size allows, whatever the footer says."""
    budget = Budget(file)
    with open(file, "rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
        for chunk in (chunk for group in groups for chunk in group.chunks if chunk.name in names):
            for page in pages_of(content, chunk, file):
                budget.count()
                if page.unpacked > MAX_CHUNK:
                    message = f"has a page that unpacks to {page.unpacked} bytes"
                    remedy = f"the limit is {MAX_CHUNK}; write it again with smaller pages"
                    raise LogError(message, file=file, field=chunk.name, remedy=remedy)
                budget.unpack(page.unpacked)


def pages_of(content: Any, chunk: Chunk, file: str) -> Iterator[Page]:
    """The pages of a column in one row group."""
    at, end = chunk.start, chunk.start + chunk.stored
    whole = 0 <= at <= end <= len(content)
    while whole and at < end:
        try:
            page = page_at(content[at : min(end, at + MAX_HEADER)])
        except (IndexError, ValueError):
            whole = False
            break
        yield page
        at += page.header + page.stored
    if not whole or at != end:
        message, remedy = "is damaged: its pages do not fill their column", "write it again"
        raise LogError(message, file=file, field=chunk.name, remedy=remedy)


def page_at(header: bytes) -> Page:
    """The page whose header these bytes begin with."""
    fields, length = struct_at(header)
    stored, unpacked = fields.get(STORED), fields.get(UNPACKED)
    if not (isinstance(stored, int) and isinstance(unpacked, int) and stored >= 0 and unpacked >= 0):
        raise ValueError("no sizes")
    return Page(length, stored, unpacked)
