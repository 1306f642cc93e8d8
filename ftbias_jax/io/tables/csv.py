"""Logs as text tables: a header line of names, then one line of numbers per sample; an empty cell = not measured."""

import csv
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TextIO

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.budget import Budget
from ftbias_jax.io.tables.columns import Columns, split
from ftbias_jax.io.tables.first_lines import DAY, NUMBER, Layout, check_length, read_layout
from ftbias_jax.io.tables.headers import halves_of_stamps
from ftbias_jax.types import Array

BLOCK = 1 << 22  # characters per read: large enough to be fast, small compared with the numbers of a log
STAMPS = "t"
"""Name of the stamps that are written as two columns."""

_EMPTY = re.compile(r",[ \t]*(?=,|$)", re.MULTILINE)  # not the first cell of a line, which would cost much more


def csv_columns(file: str, choose: Callable[[Sequence[str]], Columns]) -> dict[str, Array]:
    """Read the columns that ``choose`` selects from a header, as arrays by the names that it gives them.

    The file is UTF-8 with cells separated by commas, semicolons, tabs or spaces; a line may have joints only, or a
    wrench only. Lines that begin with # may come first. Columns without names are called 1, 2, 3, ..., and entries of
    cells that are lists, such as "[0.1, 0.2]", column/0, column/1, ...; dates become s since 1970, and times of day
    become s since midnight. Two columns of whole s and remaining ns give one more column, t.
    """
    budget = Budget(file)
    try:
        with open(file, encoding="utf-8-sig") as stream:
            layout = read_layout(stream, file)
            halves = halves_of_stamps(layout.header)
            columns = choose([*layout.header, *([STAMPS] if halves else [])])
            names = [name for found in columns.values() for name in found]
            whole, *beyond = halves or (STAMPS,)
            used = [layout.header.index(whole if name == STAMPS else name) for name in names + beyond]
            numbers = _read_numbers(_whole_lines(stream, layout, file), layout, used, budget)
            if beyond:
                numbers[:, [*(name == STAMPS for name in names), False]] += 1e-9 * numbers[:, -1:]
            found = split(columns, numbers[:, : len(names)])
            if layout.of_day and "t" in found:  # the log may continue after midnight
                found["t"] = np.unwrap(found["t"], period=DAY)
            return found
    except OSError as error:
        raise LogError(f"cannot be read: {error.strerror}", file=file, remedy="check the path") from error
    except UnicodeDecodeError as error:
        raise LogError("is not UTF-8 text", file=file, remedy="give a CSV file") from error
    except csv.Error as error:
        raise LogError(f"is not CSV text: {error}", file=file, remedy="give a CSV file") from error


def _read_numbers(texts: Iterable[str], layout: Layout, used: Sequence[int], budget: Budget) -> Array:
    """The used columns of all lines after the header, (lines, len(used)) float64."""
    blocks, line_number = [np.empty((0, len(used)))], layout.line_number
    for text in texts:
        block = _read_block(layout.with_commas(text), line_number, layout.header, used, budget.file)
        budget.hold(block.nbytes)
        blocks.append(block)
        line_number += text.count("\n") + 1
    return np.concatenate(blocks)


def _whole_lines(stream: TextIO, layout: Layout, file: str) -> Iterator[str]:
    """Yield the text in pieces of whole lines, of about BLOCK characters, without the line break at their end."""
    rest, line_number = layout.read, layout.line_number
    while text := stream.read(BLOCK):
        text = rest + text
        end = text.rfind("\n")
        while layout.has_lists and (opened := _open_list(text[: end + 1])) >= 0:
            end = text.rfind("\n", 0, opened)
        whole, rest = text[: max(end, 0)], text[end + 1 :]
        line_number += whole.count("\n") + (end >= 0)
        check_length(rest, line_number, file)
        if end >= 0:
            yield whole
    if rest:
        yield rest


def _open_list(text: str) -> int:
    """Position at which a list begins that continues after the text; -1 = none."""
    opened, closed = max(map(text.rfind, "[(")), max(map(text.rfind, "])"))
    return opened if opened > closed else -1


def _read_block(text: str, line_number: int, header: Sequence[str], used: Sequence[int], file: str) -> Array:
    lines = text.split("\n")
    cells = {line.count(",") + 1 for line in lines if line.strip()}
    if cells == {len(header)} and '"' not in text:
        filled = _EMPTY.sub(",nan", text).split("\n")
        try:
            return np.loadtxt(filled, delimiter=",", comments=None, usecols=used, ndmin=2)
        except ValueError:
            pass  # reading line by line below reports the faulty cell
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
    if not NUMBER.fullmatch(cell):  # float() alone would also take 1_000 and digits of other scripts
        shown = repr(cell[:40])
        remedy = "write a number, or leave the cell empty where nothing was measured"
        raise LogError(f"{shown} is not a number", file=file, field=field, remedy=remedy)
    return float(cell)
