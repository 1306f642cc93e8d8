"""Logs as Parquet files: the columns of a CSV log, typed; null or NaN = not measured.

A column may hold a list in every row, such as the state of a LeRobot data set. Its entry ``i`` is called ``column/i``,
or ``column/name`` where ``meta/info.json`` of the data set names it.

The unpacked size of the columns is checked before a library allocates memory for them. The footer of a file states the
sizes of its columns, and each page repeats its own size in a header, from which memory is allocated. pyarrow ends the
process if some footers are damaged and it is asked for a column's sizes, so both are parsed here: structs of Thrift's
compact protocol.
"""

import json
import mmap
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.budget import MAX_CHUNK, Budget, need
from ftbias_jax.io.tables.columns import Columns, split
from ftbias_jax.types import Array

BATCH = 1 << 16
"""Rows decoded per batch."""
LOOKED_AT = 1000
"""Rows that are searched for the length of a list."""
MAX_FOOTER = 8 << 20
"""Bytes of the footer, which describes columns and row groups and takes a hundred times as much in memory."""
MAX_LIST = 100_000
"""Maximum number of columns or row groups."""
MOST_ENTRIES = 1000
"""Maximum number of entries of one list; the state of a robot has some dozens."""
MOST_BYTES = 1 << 20
"""Maximum bytes that are read of meta/info.json."""
Cell = tuple[str, int | None]
"""Location of named numbers: the column of the file and the index in its lists; None = the column holds numbers."""
LEVELS = 4
"""Number of folders above a file that may contain the data set's meta: data/chunk-000/episode_000000.parquet."""
MAX_DEPTH = 16
MAX_HEADER = 1 << 16
"""Bytes of a page's header; that of a page of numbers takes about 50."""
TAIL = 8
"""Bytes at the end of a file: the length of its footer, and its magic number."""
TRUE, FALSE, BYTE, I16, I32, I64, DOUBLE, BINARY, LIST, SET, MAP, STRUCT = range(1, 13)
"""Codes of the types of Thrift's compact protocol."""
DAMAGE = (IndexError, KeyError, TypeError, ValueError, AttributeError)


def parquet_columns(file: str, choose: Callable[[Sequence[str]], Columns]) -> dict[str, Array]:
    """Read the columns that ``choose`` selects from their names, as arrays by the names that it gives them.

    "t" is in s if floating point, in ns if integer or a timestamp of any unit. A row may have joints only, or a wrench
    only.
    """
    arrow, compute = need("pyarrow", "parquet", file), need("pyarrow.compute", "parquet", file)
    with _opened(file) as (table, budget):
        schema, cells = table.schema_arrow, cells_of(arrow, table, file)
        columns, where = choose([name for name, _ in cells]), dict(cells)
        time = columns.get("t", ())
        others = {name: names for name, names in columns.items() if name != "t"}
        used = [where[name] for names in others.values() for name in names]
        stored = list(dict.fromkeys([*(where[name][0] for name in time), *(column for column, _ in used)]))
        for name in stored:
            _check_type(arrow, schema.field(name).type, name, name in time, file)
        rows = check_pages(file, stored, budget)
        budget.hold(8 * rows * (len(time) + len(used)))
        t, numbers, first = list[Array](), np.empty((rows, len(used))), 0
        for batch in table.iter_batches(BATCH, columns=stored, use_threads=False):
            here = slice(first, first + batch.num_rows)
            t += [_times(arrow, batch.column(name), name, file) for name in time]
            for i, (column, entry) in enumerate(used):
                values = batch.column(column) if entry is None else compute.list_element(batch.column(column), entry)
                numbers[here, i] = values.cast("float64").to_numpy(zero_copy_only=False)
            first = here.stop
    found = split(others, numbers[:first])
    return {"t": np.concatenate(t)} | found if t else found


@contextmanager
def _opened(file: str) -> Iterator[tuple[Any, Budget]]:
    """The file and its budget; exceptions of pyarrow are raised as LogError."""
    arrow, parquet = need("pyarrow", "parquet", file), need("pyarrow.parquet", "parquet", file)
    budget = Budget(file)
    try:
        # A memory map, not a path: pyarrow would also accept a folder of files, or the address of a server.
        with arrow.memory_map(file) as source:
            _check_footer(source, file)
            limits = {"thrift_container_size_limit": MAX_LIST, "thrift_string_size_limit": MAX_FOOTER}
            with parquet.ParquetFile(source, **limits) as table:
                yield table, budget
    except OSError as error:
        words = error.strerror or error
        raise LogError(f"cannot be read: {words}", file=file, remedy="check the path and the file") from error
    except (arrow.ArrowException, ValueError, KeyError, MemoryError, OverflowError) as error:
        raise LogError(f"is damaged: {error}", file=file, remedy="write it again") from error


def _check_footer(source: Any, file: str) -> None:
    """Refuse a footer that is too long for a log, before it is parsed."""
    size = source.size()
    if size >= 8:
        source.seek(size - 8)
        length = int.from_bytes(source.read(4), "little")
        if length > MAX_FOOTER:
            message = f"describes its columns in {length} bytes"
            raise LogError(message, file=file, remedy=f"the limit is {MAX_FOOTER} bytes; write it in fewer row groups")
        source.seek(0)


def _check_type(arrow: Any, kind: Any, name: str, is_time: bool, file: str) -> None:
    """Refuse a non-numeric column before it is read, because a text may be repeated a million times."""
    types, remedy = arrow.types, "store real numbers, null where not measured"
    if is_time:
        remedy = "store s, integer ns, or timestamps"
    elif types.is_list(kind) or types.is_fixed_size_list(kind):
        kind = kind.value_type
    numbers = types.is_floating(kind) or types.is_integer(kind) or types.is_null(kind)
    if not numbers and not (is_time and types.is_timestamp(kind)):
        raise LogError(f"has the type {kind}", file=file, field=name, remedy=remedy)


def _times(arrow: Any, column: Any, name: str, file: str) -> Array:
    """Stamps of a column as float64 s, or int64 ns."""
    if column.null_count:
        raise LogError(f"has {column.null_count} nulls", file=file, field=name, remedy="give every sample a stamp")
    if arrow.types.is_timestamp(column.type):
        column = column.cast(arrow.timestamp("ns"))
    return column.cast("float64" if arrow.types.is_floating(column.type) else "int64").to_numpy()


def cells_of(arrow: Any, table: Any, file: str) -> list[tuple[str, Cell]]:
    """Name and location of each number in a row; lists of no stated length have the length of the first list."""
    schema, stated = table.schema_arrow, None
    cells: list[tuple[str, Cell]] = []
    for column, kind in zip(map(str, schema.names), schema.types, strict=True):
        if not (arrow.types.is_list(kind) or arrow.types.is_fixed_size_list(kind)):
            cells.append((column, (column, None)))
            continue
        stated = _features(file) if stated is None else stated
        names = _entry_names(stated.get(column))
        width = kind.list_size if arrow.types.is_fixed_size_list(kind) else len(names)
        if not width and arrow.types.is_floating(kind.value_type):  # integers may be pixels of images
            width = _first_length(table, column, file)
        if not 0 < width <= MOST_ENTRIES:
            cells.append((column, (column, None)))
            continue
        names = names if len(names) == width else [str(i) for i in range(width)]
        cells += [(f"{column}/{name}", (column, i)) for i, name in enumerate(names)]
    return cells


def _first_length(table: Any, column: str, file: str) -> int:
    """Number of entries of the first list of a column; 0 = there is none in the first LOOKED_AT rows."""
    check_pages(file, [column], Budget(file))
    batch = next(table.iter_batches(LOOKED_AT, columns=[column], use_threads=False))
    return next((len(entries) for entries in batch.column(0) if entries.is_valid), 0)


def _features(file: str) -> Mapping[str, Any]:
    """Description of a file's columns in its data set; {} if it belongs to none, or the description is unreadable."""
    for folder in list(Path(file).absolute().parents)[:LEVELS]:
        try:
            with open(folder / "meta" / "info.json", "rb") as stream:
                found = json.loads(stream.read(MOST_BYTES))
        except (OSError, ValueError, RecursionError):
            continue
        features = found.get("features") if isinstance(found, dict) else None
        return features if isinstance(features, dict) else {}
    return {}


def _entry_names(feature: Any) -> list[str]:
    """Names of a list's entries, or their indices from its shape; [] if neither is stated."""
    if not isinstance(feature, dict):
        return []
    names, shape = feature.get("names"), feature.get("shape")
    if isinstance(names, dict) and len(names) == 1:  # {"motors": [...]}
        (names,) = names.values()
    if isinstance(names, list) and all(isinstance(name, str) for name in names) and len({*names}) == len(names):
        return names[:MOST_ENTRIES]
    match shape:
        case [int(width)] if 0 < width <= MOST_ENTRIES:
            return [str(i) for i in range(width)]
    return []


class Thrift:
    """Reader of values in Thrift's compact protocol; ValueError or IndexError if they are invalid or truncated."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def struct(self, depth: int = 0) -> dict[int, Any]:
        """Read fields by number: int, bytes, lists and structs; None for other number types, Booleans are left out."""
        fields: dict[int, Any] = {}
        number = 0
        while head := self._byte():
            number = number + (head >> 4) if head >> 4 else self._integer()
            if head & 15 not in (TRUE, FALSE):  # a Boolean field has its value in its type
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
        """Read a zigzag integer: 0, -1, 1, -2, 2 are stored as 0, 1, 2, 3, 4."""
        value = self._varint()
        return (value >> 1) ^ -(value & 1)


def check_pages(file: str, names: Collection[str], budget: Budget) -> int:
    """Number of rows of a file; checks that the named columns unpack to no more than the size of the file allows."""
    with open(file, "rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
        length = int.from_bytes(content[-TAIL : 4 - TAIL], "little")  # checked by _check_footer
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
    """Name of a column in a row group, start of its pages, and their bytes as stored and as unpacked."""
    dictionary = fields.get(11, 0)
    start = min(fields[9], dictionary) if dictionary > 0 else fields[9]
    return fields[3][0].decode("utf-8", "replace"), start, fields[7], fields[6]


def _check_column(content: Any, at: int, end: int, name: str, budget: Budget) -> None:
    """Refuse pages that are too large, separately or together, or that do not fill their column."""
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
