"""Logs as CSV files: a header line of names, then one line of numbers a sample; an empty cell = not measured."""

from __future__ import annotations

import csv
import os
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TextIO

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.conventions.units import recorded_times
from ftbias_jax.io.limits.budget import Budget
from ftbias_jax.io.log import Log
from ftbias_jax.io.tables.arrays import log_of_table
from ftbias_jax.io.tables.csv_columns import (
    Columns,
    check_names,
    choose_columns,
    choose_time,
    named_arrays,
)
from ftbias_jax.io.tables.delimiters import Commas, with_commas
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

BLOCK = 1 << 22  # characters read at once: large enough to be fast, small beside the numbers of a log
MAX_LINE = 1 << 20
"""Characters; the widest table of a robot has some thousand columns."""

_EMPTY = re.compile(r",[ \t]*(?=,|$)", re.MULTILINE)  # all but the first cell of a line, which would cost much more
_NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*([eE][+-]?\d+)?|\.\d+([eE][+-]?\d+)?|nan|inf(inity)?)\s*", re.I | re.ASCII)


def read_csv(path: str | os.PathLike[str], setup: Setup) -> Log:
    """Read a log; lines may have joints only or a wrench only: the log is a merged timeline."""
    file = os.fspath(path)
    arrays = csv_arrays(file, setup)
    t, q, wrench = recorded_times(arrays, setup.log), arrays["q"], arrays["wrench"]
    return log_of_table(t, q, wrench, arrays.get("dq"), arrays.get("temperature"), setup, file)


def csv_arrays(file: str, setup: Setup, static: bool = False) -> dict[str, Array]:
    """The columns of a log by the names of the native format (``arrays.ARRAYS``)."""
    return named_columns(file, lambda header: choose_columns(header, setup, file, static=static))


def named_columns(file: str, choose: Callable[[Sequence[str]], Columns]) -> dict[str, Array]:
    """The chosen columns of a file, by the names of the native format."""
    budget = Budget(file)
    with _opened(file) as stream:
        header = read_header(stream, file)
        columns = choose(header)
        used = [header.index(name) for names in columns for name in names]
        values = _read_numbers(stream, header, used, budget)
    ends = np.cumsum([len(names) for names in columns])
    return named_arrays(columns, np.split(values, ends[:-1], axis=1))


def load_csv(file: str, setup: Setup, names: Sequence[str]) -> tuple[Array, dict[str, Array]]:
    """The stamps (T,) of a log, or its rows' numbers if it has none, and further columns (T,) of it."""
    with _opened(file) as stream:
        header = read_header(stream, file)
        time = choose_time(header, setup, file)
        check_names(names, header, file)
        used = [header.index(name) for name in (*time, *names)]
        values = _read_numbers(stream, header, used, Budget(file))
    t = values[:, 0] if time else np.arange(len(values))
    return t, dict(zip(names, values.T[len(time) :], strict=True))


@contextmanager
def _opened(file: str) -> Iterator[TextIO | Commas]:
    """The file, and what reading it raises as errors of ours."""
    try:
        with open(file, encoding="utf-8-sig") as text:
            yield with_commas(text)
    except OSError as error:
        raise LogError(f"cannot be read: {error.strerror}", file=file, remedy="check the path") from error
    except UnicodeDecodeError as error:
        raise LogError("is not UTF-8 text", file=file, remedy="give a CSV file") from error
    except csv.Error as error:
        raise LogError(f"is not CSV text: {error}", file=file, remedy="give a CSV file") from error


def read_header(stream: TextIO | Commas, file: str) -> list[str]:
    """The names in the first line."""
    line = stream.readline(MAX_LINE + 1)
    _check_length(line, 1, file)
    # numpy.savetxt marks its header as a comment.
    return [name.strip() for name in next(csv.reader([line.removeprefix("#")]), [])]


def _read_numbers(stream: TextIO | Commas, header: Sequence[str], used: Sequence[int], budget: Budget) -> Array:
    """The used columns of all lines after the header, (lines, len(used)) float64."""
    blocks, line_number = [np.empty((0, len(used)))], 2
    for text in _whole_lines(stream, budget.file):
        block = _read_block(text, line_number, header, used, budget.file)
        budget.hold(block.nbytes)
        blocks.append(block)
        line_number += text.count("\n") + 1
    return np.concatenate(blocks)


def _whole_lines(stream: TextIO | Commas, file: str) -> Iterator[str]:
    """The text in pieces of about BLOCK characters that end where lines do, without the last line's end."""
    rest, line_number = "", 2
    while text := stream.read(BLOCK):
        whole, end, rest = (rest + text).rpartition("\n")
        line_number += whole.count("\n") + len(end)
        _check_length(rest, line_number, file)
        if end:
            yield whole
    if rest:
        yield rest


def _check_length(line: str, line_number: int, file: str) -> None:
    if len(line) > MAX_LINE:
        message = f"is longer than {MAX_LINE} characters"
        raise LogError(message, file=file, field=f"line {line_number}", remedy="give a CSV file")


def _read_block(text: str, line_number: int, header: Sequence[str], used: Sequence[int], file: str) -> Array:
    lines = text.split("\n")
    cells = {line.count(",") + 1 for line in lines if line.strip()}
    if cells == {len(header)} and '"' not in text:
        filled = _EMPTY.sub(",nan", text).split("\n")
        try:
            return np.loadtxt(filled, delimiter=",", comments=None, usecols=used, ndmin=2)
        except ValueError:
            pass  # the careful reading below says which cell
    rows = [_read_line(line, i, header, used, file) for i, line in enumerate(lines, line_number) if line.strip()]
    return np.array(rows).reshape(len(rows), len(used))


def _read_line(line: str, line_number: int, header: Sequence[str], used: Sequence[int], file: str) -> list[float]:
    cells = next(csv.reader([line]))
    if len(cells) != len(header):
        message = f"{len(cells)} cells, the header has {len(header)}"
        raise LogError(message, file=file, field=f"line {line_number}", remedy="write one cell per column")
    return [_number(cells[i], f"line {line_number}, column {header[i]}", file) for i in used]


def _number(cell: str, field: str, file: str) -> float:
    if not cell.strip():
        return float("nan")
    if not _NUMBER.fullmatch(cell):  # float() alone would also take 1_000 and digits of other scripts
        shown = repr(cell[:40])
        remedy = "write a number, or leave the cell empty where nothing was measured"
        raise LogError(f"{shown} is not a number", file=file, field=field, remedy=remedy)
    return float(cell)
