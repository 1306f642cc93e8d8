"""Logs as CSV files: a header line of names, then one line of numbers a sample; an empty cell = not measured."""

import csv
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TextIO

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.budget import Budget
from ftbias_jax.io.tables.columns import Columns, split
from ftbias_jax.types import Array

BLOCK = 1 << 22  # characters read at once: large enough to be fast, small beside the numbers of a log
LONGEST = 1 << 16
"""Characters of the first line by which the delimiter is told."""
MAX_LINE = 1 << 20
"""Characters; the widest table of a robot has some thousand columns."""

_SEMICOLONS = str.maketrans({",": ".", ";": ","})
_ENDS = re.compile(r"^#?[ \t]+|[ \t]+$", re.MULTILINE)
_EMPTY = re.compile(r",[ \t]*(?=,|$)", re.MULTILINE)  # all but the first cell of a line, which would cost much more
_NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*([eE][+-]?\d+)?|\.\d+([eE][+-]?\d+)?|nan|inf(inity)?)\s*", re.I | re.ASCII)


def csv_columns(file: str, choose: Callable[[Sequence[str]], Columns]) -> dict[str, Array]:
    """The columns that ``choose`` takes of a header, as arrays by the names that it gives them.

    The file is UTF-8 with cells separated by commas, semicolons, tabs or spaces; a line may have joints only, or a
    wrench only.
    """
    budget = Budget(file)
    try:
        with open(file, encoding="utf-8-sig") as stream:
            line = stream.readline(MAX_LINE + 1)
            _check_length(line, 1, file)
            with_commas = _to_commas(line[:LONGEST])
            # numpy.savetxt marks its header as a comment.
            header = [name.strip() for name in next(csv.reader([with_commas(line).removeprefix("#")]), [])]
            columns = choose(header)
            used = [header.index(name) for names in columns.values() for name in names]
            return split(columns, _read_numbers(map(with_commas, _whole_lines(stream, file)), header, used, budget))
    except OSError as error:
        raise LogError(f"cannot be read: {error.strerror}", file=file, remedy="check the path") from error
    except UnicodeDecodeError as error:
        raise LogError("is not UTF-8 text", file=file, remedy="give a CSV file") from error
    except csv.Error as error:
        raise LogError(f"is not CSV text: {error}", file=file, remedy="give a CSV file") from error


def _to_commas(header: str) -> Callable[[str], str]:
    """What turns whole lines into cells separated by commas, by what stands between those of the first line.

    Between semicolons a comma is the decimal one.
    """
    if "," in header:
        return str
    if ";" in header:
        return lambda text: text.translate(_SEMICOLONS)
    if "\t" in header:
        return lambda text: text.replace("\t", ",")
    if " " in header.strip().removeprefix("#").strip():
        return lambda text: re.sub(r"[ \t]+", ",", _ENDS.sub("", text))
    return str


def _read_numbers(texts: Iterable[str], header: Sequence[str], used: Sequence[int], budget: Budget) -> Array:
    """The used columns of all lines after the header, (lines, len(used)) float64."""
    blocks, line_number = [np.empty((0, len(used)))], 2
    for text in texts:
        block = _read_block(text, line_number, header, used, budget.file)
        budget.hold(block.nbytes)
        blocks.append(block)
        line_number += text.count("\n") + 1
    return np.concatenate(blocks)


def _whole_lines(stream: TextIO, file: str) -> Iterator[str]:
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
