"""Logs as Parquet files: the columns of a CSV log, typed; null or NaN = not measured.

A column may hold a list in every row, such as the state of a LeRobot data set. Its entry ``i`` is called ``column/i``,
or ``column/name`` where ``meta/info.json`` of the data set names it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.limits.budget import Budget, need
from ftbias_jax.io.limits.parquet_pages import check_pages
from ftbias_jax.io.tables.columns import Columns, split
from ftbias_jax.types import Array

BATCH = 1 << 16
"""Rows decoded at once."""
MAX_FOOTER = 8 << 20
"""Bytes of the description of columns and row groups, which takes a hundredfold in memory."""
MAX_LIST = 100_000
"""Columns or row groups."""
MOST_ENTRIES = 1000
"""Of one list: the state of a robot has some dozens."""
MOST_BYTES = 1 << 20
"""Of meta/info.json."""
Cell = tuple[str, int | None]
"""Where the numbers of a name are: the column of the file, and the entry of its lists; None = it holds numbers."""
LEVELS = 4
"""Folders above a file in which the data set's meta may be: data/chunk-000/episode_000000.parquet."""


def parquet_columns(file: str, choose: Callable[[Sequence[str]], Columns]) -> dict[str, Array]:
    """The columns that ``choose`` takes of their names, as arrays by the names that it gives them.

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
    """The file and its budget; what pyarrow raises as errors of ours."""
    arrow, parquet = need("pyarrow", "parquet", file), need("pyarrow.parquet", "parquet", file)
    budget = Budget(file)
    try:
        # A memory map, not a path: pyarrow would take a folder of files, or the address of a server.
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
    """Refuse a description of columns that is too long for a log, before it is parsed."""
    size = source.size()
    if size >= 8:
        source.seek(size - 8)
        length = int.from_bytes(source.read(4), "little")
        if length > MAX_FOOTER:
            message = f"describes its columns in {length} bytes"
            raise LogError(message, file=file, remedy=f"the limit is {MAX_FOOTER} bytes; write it in fewer row groups")
        source.seek(0)


def _check_type(arrow: Any, kind: Any, name: str, is_time: bool, file: str) -> None:
    """Refuse a column that has no numbers before any is read: a text may be repeated a million times."""
    types, remedy = arrow.types, "store real numbers, null where not measured"
    if is_time:
        remedy = "store s, integer ns, or timestamps"
    elif types.is_list(kind) or types.is_fixed_size_list(kind):
        kind = kind.value_type
    numbers = types.is_floating(kind) or types.is_integer(kind) or types.is_null(kind)
    if not numbers and not (is_time and types.is_timestamp(kind)):
        raise LogError(f"has the type {kind}", file=file, field=name, remedy=remedy)


def _times(arrow: Any, column: Any, name: str, file: str) -> Array:
    """Stamps: float64 s, or int64 ns."""
    if column.null_count:
        raise LogError(f"has {column.null_count} nulls", file=file, field=name, remedy="give every sample a stamp")
    if arrow.types.is_timestamp(column.type):
        column = column.cast(arrow.timestamp("ns"))
    return column.cast("float64" if arrow.types.is_floating(column.type) else "int64").to_numpy()


def cells_of(arrow: Any, table: Any, file: str) -> list[tuple[str, Cell]]:
    """The names of all numbers in a row, and where each is; lists whose length is not known are one name."""
    schema, stated = table.schema_arrow, None
    cells: list[tuple[str, Cell]] = []
    for column, kind in zip(map(str, schema.names), schema.types, strict=True):
        if not (arrow.types.is_list(kind) or arrow.types.is_fixed_size_list(kind)):
            cells.append((column, (column, None)))
            continue
        stated = _features(file) if stated is None else stated
        names = _entry_names(stated.get(column))
        width = kind.list_size if arrow.types.is_fixed_size_list(kind) else len(names)
        if not 0 < width <= MOST_ENTRIES:
            cells.append((column, (column, None)))
            continue
        names = names if len(names) == width else [str(i) for i in range(width)]
        cells += [(f"{column}/{name}", (column, i)) for i, name in enumerate(names)]
    return cells


def _features(file: str) -> Mapping[str, Any]:
    """What the data set of a file says of its columns; {} if it belongs to none, or says nothing that can be read."""
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
    """Names of a list's entries, or their numbers by its shape; [] if neither is stated."""
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
