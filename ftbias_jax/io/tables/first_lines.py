"""Layout of a text table, inferred from its first lines: names, delimiter, and cells that are dates or lists."""

import csv
import re
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from typing import NamedTuple, TextIO

from ftbias_jax.errors import LogError
from ftbias_jax.io.tables.column_names import FORCES, TORQUES, UNITS

LONGEST = 1 << 16
"""Characters of a header from which the delimiter is inferred, and of the lines after it for the kinds of cells."""
MAX_LINE = 1 << 20
"""Characters per line; the widest table of a robot has some thousand columns."""
MOST_COMMENTS = 1000
SOME = 2
"""Number of decimal fractions from which on a line is taken for data, not for names."""
STAMPED = ("sec", "nanosec", "frame_id")
"""Columns of the header of a ROS 2 message."""
EPOCH, DAY = "1970-01-01", 86400.0
"""Date from which s are counted, and s of a day."""
NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*([eE][+-]?\d+)?|\.\d+([eE][+-]?\d+)?|nan|inf(inity)?)\s*", re.I | re.ASCII)

_MARK = re.compile(r"\s*(#|//|% |sep=)")  # the last one is Excel's
_SEMICOLONS = str.maketrans({",": ".", ";": ","})
_ENDS = re.compile(r"^#?[ \t]+|[ \t]+$", re.MULTILINE)
_DATE = re.compile(
    r"\b(?:(\d{4}[-/]\d\d[-/]\d\d)[T ]|\d\d?[./]\d\d?[./]\d{4} )?(\d\d?)(:\d\d:\d\d(?:\.\d+)?)(Z|[+-]\d\d:?\d\d)?",
    re.ASCII,
)
_LIST = re.compile(r'"?[\[(]([^\[\]()]*)[\])]"?')


class Layout(NamedTuple):
    """Layout of a table."""

    header: list[str]
    """Names of the columns; if cells are lists, one name for each entry."""
    with_commas: Callable[[str], str]
    """Function that converts whole lines to numbers separated by commas."""
    has_lists: bool
    """Whether cells are lists, which may continue on the next line."""
    of_day: bool
    """Whether stamps may be s since midnight."""
    line_number: int
    """Number of the first line of data, counted from 1."""
    read: str
    """Text of the lines of data that was read to infer the layout."""


def read_layout(stream: TextIO, file: str) -> Layout:
    """Infer the layout of a table from its first lines; columns without names are called 1, 2, 3, ...

    The header is the first line that is no comment or, if it has numbers, a comment before it with as many cells. A
    comment begins with a mark, or has a single cell. Units of all columns may stand in the line after the header.
    """
    comments: list[str] = []
    line, number = _next_line(stream, file, 0)
    while len(comments) < MOST_COMMENTS and _is_comment(line):
        comments.append(line)
        line, number = _next_line(stream, file, number)
    if line and not _has_numbers(line):
        header, text, with_commas = _names(line), stream.read(LONGEST), _to_commas(line[:LONGEST])
        second, _, rest = text.partition("\n")
        if units := _units(with_commas(second), len(header)):
            header, text, number = [*map(_with_unit, header, units)], rest, number + 1
        return _layout(header, text, number + 1, with_commas)
    names = [_names(comment) for comment in reversed(comments)]  # numpy.savetxt marks its header as a comment
    if not line:
        return Layout(names[0] if names else [], str, False, False, number, "")
    cells = [cell.strip() for cell in _cells(line)]
    header = next((found for found in names if len(found) == len(cells)), _of_message(cells))
    return _layout(header, line + stream.read(LONGEST), number, _to_commas_of_numbers(line))


def check_length(line: str, line_number: int, file: str) -> None:
    """Refuse a line that is too long for a table."""
    if len(line) > MAX_LINE:
        message = f"is longer than {MAX_LINE} characters"
        raise LogError(message, file=file, field=f"line {line_number}", remedy="give a CSV file")


def _next_line(stream: TextIO, file: str, number: int) -> tuple[str, int]:
    """The next line that is not blank and its number; "" at the end."""
    while line := stream.readline(MAX_LINE + 1):
        number += 1
        check_length(line, number, file)
        if line.strip():
            break
    return line, number


def _is_comment(line: str) -> bool:
    return bool(line) and (bool(_MARK.match(line)) or (len(_names(line)) == 1 and not _has_numbers(line)))


def _names(line: str) -> list[str]:
    line = _MARK.sub("", line.strip())
    return [name.strip() for name in next(csv.reader([_to_commas(line[:LONGEST])(line)]), [])]


def _units(line: str, width: int) -> list[str]:
    """Units in a line with ``width`` cells and no numbers; [] = the line holds no units."""
    units = [cell.strip(' \t\r"[]()') for cell in line.split(",")]
    has_numbers = any(map(NUMBER.fullmatch, re.split(r"[\s,\[\]()\"]+", line))) or _DATE.search(line)
    known = any(unit.lower() in words for unit in units for _, words in UNITS.values())
    return units if known and not has_numbers and len(units) == width else []


def _with_unit(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit.strip("-") else name


def _to_commas(header: str) -> Callable[[str], str]:
    """Function that converts whole lines to cells separated by commas, from the delimiter of the first line.

    Between semicolons, a comma is the decimal separator.
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


def _to_commas_of_numbers(line: str) -> Callable[[str], str]:
    """``_to_commas`` from a line of numbers, which may have decimal commas."""
    outside_lists = _LIST.sub("0", line[:LONGEST])
    return _to_commas(";" if ";" in outside_lists else outside_lists)


def _cells(line: str) -> list[str]:
    """Cells of a line of numbers, with 0 in place of lists."""
    return _to_commas_of_numbers(line)(_to_seconds(_LIST.sub("0", line.strip()))).split(",")


def _has_numbers(line: str) -> bool:
    """Whether a line is data, not names: nothing but numbers, dates and lists, or some fractions besides words.

    Numbers that count the columns, as pandas writes them, are names.
    """
    cells = [cell for cell in _cells(line) if cell.strip()]
    counts = len(cells) > 1 and any(cells == [str(i + first) for i in range(len(cells))] for first in (0, 1))
    numbers = [cell for cell in cells if NUMBER.fullmatch(cell)]
    fractions = [number for number in numbers if "." in number]
    return bool(cells) and not counts and (len(numbers) == len(cells) or len(fractions) >= SOME)


def _of_message(cells: Sequence[str]) -> list[str]:
    """Names of the columns of a table without header: 1, 2, 3, ..., or those of a ROS message that its cells resemble.

    ``ros2 topic echo --csv`` writes whole s, ns and the frame, then six numbers of a WrenchStamped, or the names of the
    joints and their positions, velocities and efforts of a JointState; a list without entries is one empty cell.
    """
    text = "".join("." if NUMBER.fullmatch(cell) else "w" if cell else "-" for cell in cells)
    if re.fullmatch(r"\.\.[w-]\.{6}", text):
        return [*STAMPED, *FORCES, *TORQUES]
    named = re.match(r"\.\.[w-](w+)", text)
    joints = cells[slice(*named.span(1))] if named else []
    lists = re.fullmatch(3 * rf"(\.{{{len(joints)}}}|-)", text[named.end() :]) if named else None
    if lists is None:
        return [str(i + 1) for i in range(len(cells))]
    header = [*STAMPED, *(f"name_{i}" for i in range(len(joints)))]
    for name, found in zip(("position", "velocity", "effort"), lists.groups(), strict=True):
        header += [name] if found == "-" else [f"{name}_{joint}" for joint in joints]
    return header


def _layout(header: list[str], text: str, line_number: int, with_commas: Callable[[str], str]) -> Layout:
    """Layout of a table from its header and its first lines of numbers."""
    steps = [with_commas]
    if date := _DATE.search(text):  # before spaces become commas, but after decimal commas become points
        steps.insert(1 if with_commas(",") == "." else 0, _to_seconds)
    marked = with_commas(_LIST.sub(lambda found: f"<{len(_entries(found).split())}>", text)).split("\n")
    lines = [cells for line in marked if len(cells := line.split(",")) == len(header)]
    widths = [next(filter(None, map(_width, cells)), 0) for cells in zip(*lines, strict=True)]
    if any(widths):
        steps = [lambda text: _LIST.sub(_entries, text), *steps, lambda text: _side_by_side(text, widths)]
        both = zip(header, widths, strict=True)
        header = [f"{name}/{i}" if width else name for name, width in both for i in range(width or 1)]

    def apply(text: str) -> str:
        for step in steps:
            text = step(text)
        return text

    return Layout(header, apply, any(widths), bool(date and not date[1]), line_number, text)


def _entries(found: re.Match[str]) -> str:
    """Entries of a list, separated by spaces."""
    return " ".join(re.split(r"[,;\s]+", found[1].strip()))


def _width(cell: str) -> int:
    """Number of entries of a cell that is a list; 0 = it is no list."""
    listed = re.fullmatch(r"\s*<(\d+)>\s*", cell)
    return int(listed[1]) if listed and int(listed[1]) > 1 else 0


def _side_by_side(text: str, widths: Sequence[int]) -> str:
    """Lines with the entries of their lists in separate cells; an empty list becomes as many empty cells."""
    lines = [line.split(",") for line in text.split("\n")]
    for i, cells in enumerate(lines):
        if len(cells) == len(widths):
            both = zip(cells, widths, strict=True)
            lines[i] = [",".join(cell.split() or [""] * width) if width else cell for cell, width in both]
    return "\n".join(map(",".join, lines))


def _to_seconds(text: str) -> str:
    """Replace dates in a text by s since 1970; dates without a time zone are in UTC.

    A time without a date, or with a date whose day and month are ambiguous, becomes s since midnight.
    """

    def seconds(found: re.Match[str]) -> str:
        day, hour, rest, zone = found.groups("")
        try:
            date = datetime.fromisoformat(f"{(day or EPOCH).replace('/', '-')}T{hour.zfill(2)}{rest}{zone}")
        except ValueError:
            return found[0]
        return f"{(date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp():.6f}"

    return _DATE.sub(seconds, text)
