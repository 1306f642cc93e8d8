"""Logs as Parquet files: the columns of a CSV log, typed; null or NaN = not measured."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.check import check_log
from ftbias_jax.io.log import Log
from ftbias_jax.io.npz_archive import MAX_BYTES
from ftbias_jax.io.tables.csv_columns import choose_columns, named_arrays
from ftbias_jax.io.unpack import need
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array


def read_parquet(path: str | os.PathLike[str], setup: Setup) -> Log:
    """Read a log; rows may have joints only or a wrench only: the log is a merged timeline.

    Args:
        path: the file; time in s if floating point, in ns if integer, or a timestamp of any unit.
        setup: [log.columns] names the columns, where they do not have the usual names (see ``csv_columns``).

    Raises:
        LogError: pyarrow is not installed, the file cannot be read, a column is missing or holds no numbers, or the
            log cannot be filtered (see ``check_log``).
    """
    file = os.fspath(path)
    arrays = parquet_arrays(file, setup)
    t, q, wrench = (arrays[name] for name in ("t", "q", "wrench"))
    return check_log(t, q, wrench, arrays.get("dq"), arrays.get("temperature"), setup=setup, file=file)


def parquet_arrays(file: str, setup: Setup, static: bool = False) -> dict[str, Array]:
    """The columns of a log by the names of the native format; arguments and errors as for ``csv.csv_arrays``."""
    arrow = need("pyarrow", "parquet", file)
    with _opened(file) as table:
        header = [str(name) for name in table.schema_arrow.names]
        columns = choose_columns(header, setup, file, static=static)
        used = [name for names in columns for name in names]
        declared = table.metadata.num_rows * len(used) * 8
        if declared > MAX_BYTES:
            remedy = f"the limit is {MAX_BYTES} bytes; split the log"
            raise LogError(f"declares {declared} bytes of numbers", file=file, remedy=remedy)
        content = table.read(columns=used, use_threads=False)
        times = {name: _times(arrow, content.column(name), name, file) for name in columns.time}
        numbers = times | {
            name: _numbers(arrow, content.column(name), name, file) for name in used if name not in times
        }
    empty = np.empty((content.num_rows, 0))
    return named_arrays(columns, [np.stack([numbers[x] for x in names], 1) if names else empty for names in columns])


def column_names(path: str | os.PathLike[str]) -> list[str]:
    """The names of all columns.

    Raises:
        LogError: pyarrow is not installed, or the file cannot be read.
    """
    with _opened(os.fspath(path)) as table:
        return [str(name) for name in table.schema_arrow.names]


@contextmanager
def _opened(file: str) -> Iterator[Any]:
    """The file, and what pyarrow raises as errors of ours."""
    arrow, parquet = need("pyarrow", "parquet", file), need("pyarrow.parquet", "parquet", file)
    try:
        # A memory map, not a path: pyarrow would take a folder of files, or the address of a server.
        with arrow.memory_map(file) as source, parquet.ParquetFile(source) as table:
            yield table
    except OSError as error:
        words = error.strerror or error
        raise LogError(f"cannot be read: {words}", file=file, remedy="check the path and the file") from error
    except (arrow.ArrowException, ValueError, KeyError, MemoryError, OverflowError) as error:
        raise LogError(f"is damaged: {error}", file=file, remedy="write it again") from error


def _times(arrow: Any, column: Any, name: str, file: str) -> Array:
    """Stamps: float64 s, or int64 ns."""
    if column.null_count:
        raise LogError(f"has {column.null_count} nulls", file=file, field=name, remedy="give every sample a stamp")
    if arrow.types.is_timestamp(column.type):
        return column.cast(arrow.timestamp("ns")).cast("int64").to_numpy()
    if arrow.types.is_integer(column.type):
        return column.cast("int64").to_numpy()
    return _numbers(arrow, column, name, file)


def _numbers(arrow: Any, column: Any, name: str, file: str) -> Array:
    """(T,) float64, NaN for null."""
    kind = column.type
    if not (arrow.types.is_floating(kind) or arrow.types.is_integer(kind) or arrow.types.is_null(kind)):
        raise LogError(
            f"has the type {kind}", file=file, field=name, remedy="store real numbers, null where not measured"
        )
    return column.cast("float64").to_numpy()
