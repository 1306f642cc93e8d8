"""Logs as Parquet files: the columns of a CSV log, typed; null or NaN = not measured."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.conventions.units import recorded_times
from ftbias_jax.io.limits.budget import Budget
from ftbias_jax.io.limits.parquet_pages import RowGroup, check_pages, row_groups
from ftbias_jax.io.log import Log
from ftbias_jax.io.tables.arrays import log_of_table
from ftbias_jax.io.tables.csv_columns import Columns, check_names, choose_columns, choose_time, named_arrays
from ftbias_jax.io.tables.parquet_lists import cells_of, number_type, values_of
from ftbias_jax.io.unpack import need
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

BATCH = 1 << 16
"""Rows decoded at once."""
MAX_FOOTER = 8 << 20
"""Bytes of the description of columns and row groups, which takes a hundredfold in memory."""
MAX_LIST = 100_000
"""Columns or row groups."""


def read_parquet(path: str | os.PathLike[str], setup: Setup) -> Log:
    """Read a log; rows may have joints only or a wrench only: the log is a merged timeline."""
    file = os.fspath(path)
    arrays = parquet_arrays(file, setup)
    t, q, wrench = recorded_times(arrays, setup.log), arrays["q"], arrays["wrench"]
    return log_of_table(t, q, wrench, arrays.get("dq"), arrays.get("temperature"), setup, file)


def parquet_arrays(file: str, setup: Setup, static: bool = False) -> dict[str, Array]:
    """The columns of a log by the names of the native format; arguments and errors as for ``csv.csv_arrays``."""
    return parquet_columns(file, lambda header: choose_columns(header, setup, file, static=static))


def parquet_columns(file: str, choose: Callable[[Sequence[str]], Columns]) -> dict[str, Array]:
    """The chosen columns of a file, by the names of the native format; errors as for ``csv.named_columns``."""
    arrow = need("pyarrow", "parquet", file)
    with _opened(file) as (table, budget):
        schema, cells = table.schema_arrow, cells_of(arrow, table, file)
        columns, where = choose([name for name, _ in cells]), dict(cells)
        used = [name for names in columns for name in names]
        stored = list(dict.fromkeys(where[name].column for name in used))
        groups = row_groups(file)
        others, rows = used[len(columns.time) :], _rows(groups, budget, file)
        t = [np.empty(rows, _time_type(arrow, schema.field(name).type, name, file)) for name in columns.time]
        _check_numbers(arrow, schema, {where[name].column for name in others}, file)
        budget.hold(sum(x.nbytes for x in t) + 8 * rows * len(others))
        check_pages(file, groups, set(stored))
        numbers = np.empty((rows, len(others)))
        first, compute = 0, need("pyarrow.compute", "parquet", file)
        for batch in table.iter_batches(BATCH, columns=stored, use_threads=False):
            here = slice(first, first + batch.num_rows)
            for times, name in zip(t, columns.time, strict=True):
                times[here] = _times(arrow, batch.column(name), name, file)
            for i, name in enumerate(others):
                values = values_of(compute, batch.column(where[name].column), where[name].entry)
                numbers[here, i] = values.to_numpy(zero_copy_only=False)
            first = here.stop
    ends = np.cumsum([len(names) for names in columns[1:]])
    times = np.stack(t, 1)[:first] if t else numbers[:first, :0]
    return named_arrays(columns, [times, *np.split(numbers[:first], ends[:-1], axis=1)])


def load_parquet(file: str, setup: Setup, names: Sequence[str]) -> tuple[Array, dict[str, Array]]:
    """The stamps (T,) of a log, or its rows' numbers if it has none, and further columns (T,) of it."""
    arrow = need("pyarrow", "parquet", file)
    with _opened(file) as (table, budget):
        cells = cells_of(arrow, table, file)
        header, where = [name for name, _ in cells], dict(cells)
        time = choose_time(header, setup, file)
        check_names(names, header, file)
        stored = list(dict.fromkeys(where[name].column for name in (*time, *names)))
        _check_numbers(arrow, table.schema_arrow, {where[name].column for name in names}, file)
        groups = row_groups(file)
        budget.hold(8 * _rows(groups, budget, file) * (1 + len(names)))
        check_pages(file, groups, set(stored))
        content, compute = table.read(columns=stored, use_threads=False), need("pyarrow.compute", "parquet", file)
        columns = {name: content.column(where[name].column) for name in names}
        found = {name: values_of(compute, columns[name], where[name].entry).to_numpy() for name in names}
        rows = np.arange(content.num_rows)
        return (_times(arrow, content.column(time[0]), time[0], file) if time else rows), found


def column_names(path: str | os.PathLike[str]) -> list[str]:
    """The names of all columns, and of the entries of those that hold lists."""
    file = os.fspath(path)
    with _opened(file) as (table, _):
        return [name for name, _ in cells_of(need("pyarrow", "parquet", file), table, file)]


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


def _rows(groups: Sequence[RowGroup], budget: Budget, file: str) -> int:
    """The rows that all parts of the file declare, whose pages may unpack to what the budget allows."""
    for group in groups:
        budget.unpack(max(group.unpacked, sum(max(chunk.unpacked, 0) for chunk in group.chunks), 0))
    rows = sum(group.rows for group in groups)
    if rows <= 0:
        raise LogError("has no rows", file=file, remedy="record a log, and export it whole")
    return rows


def _time_type(arrow: Any, kind: Any, name: str, file: str) -> type[np.generic]:
    if arrow.types.is_timestamp(kind) or arrow.types.is_integer(kind):
        return np.int64
    if arrow.types.is_floating(kind) or arrow.types.is_null(kind):
        return np.float64
    raise LogError(f"has the type {kind}", file=file, field=name, remedy="store s, integer ns, or timestamps")


def _times(arrow: Any, column: Any, name: str, file: str) -> Array:
    """Stamps: float64 s, or int64 ns."""
    if column.null_count:
        raise LogError(f"has {column.null_count} nulls", file=file, field=name, remedy="give every sample a stamp")
    if arrow.types.is_timestamp(column.type):
        column = column.cast(arrow.timestamp("ns"))
    return column.cast("float64" if arrow.types.is_floating(column.type) else "int64").to_numpy()


def _check_numbers(arrow: Any, schema: Any, names: Iterable[str], file: str) -> None:
    """Refuse columns that are no numbers before any is read: a text may be repeated a million times."""
    for name in names:
        kind = number_type(arrow, schema.field(name).type)
        if not (arrow.types.is_floating(kind) or arrow.types.is_integer(kind) or arrow.types.is_null(kind)):
            remedy = "store real numbers, null where not measured"
            raise LogError(f"has the type {kind}", file=file, field=name, remedy=remedy)
