"""What the first lines of a table of text say of all: names, the delimiter, and cells that are dates or lists."""

import csv
import re
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from typing import NamedTuple, TextIO

from ftbias_jax.errors import LogError
from ftbias_jax.io.tables.headers import FORCES, TORQUES, UNITS

LONGEST = 1 << 16
"""Characters of a header by which the delimiter is told, and of the lines after it by which cells are."""
MAX_LINE = 1 << 20
"""Characters; the widest table of a robot has some thousand columns."""
MOST_COMMENTS = 1000
SOME = 2
"""Fractions in a line, which therefore has no names."""
STAMPED = ("sec", "nanosec", "frame_id")
"""What the header of a message of ROS 2 has."""
EPOCH, DAY = "1970-01-01", 86400.0
"""From which s are counted, and s."""
NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*([eE][+-]?\d+)?|\.\d+([eE][+-]?\d+)?|nan|inf(inity)?)\s*", re.I | re.ASCII)

_MARK = re.compile(r"\s*(#|//|% |sep=)")  # the last is Excel's
_SEMICOLONS = str.maketrans({",": ".", ";": ","})
_ENDS = re.compile(r"^#?[ \t]+|[ \t]+$", re.MULTILINE)
_DATE = re.compile(
    r"\b(?:(\d{4}[-/]\d\d[-/]\d\d)[T ]|\d\d?[./]\d\d?[./]\d{4} )?(\d\d?)(:\d\d:\d\d(?:\.\d+)?)(Z|[+-]\d\d:?\d\d)?",
    re.ASCII,
)
_LIST = re.compile(r'"?[\[(]([^\[\]()]*)[\])]"?')


class Layout(NamedTuple):
    """How a table is written."""

    header: list[str]
    """Names of the columns; where cells are lists, one for each entry."""
    with_commas: Callable[[str], str]
    """Turns whole lines into numbers separated by commas."""
    has_lists: bool
    """Whether cells are lists, which may go on in the next line."""
    of_day: bool
    """Whether stamps may be s since midnight."""
    line_number: int
    """Of the first line of numbers, counted from 1."""
    read: str
    """What was read of them to know that."""


def read_layout(stream: TextIO, file: str) -> Layout:
    """The header is the first line that is no comment, or if that has numbers, a comment before it with as many cells.

    A comment begins with a mark, or has a single cell. Units of all columns may stand in the line after the header.
    Columns without names are called 1, 2, 3, ...
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
    """Refuse what is too long for a line of a table."""
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
    """Those in a line with as many cells and no numbers; [] = they are none."""
    units = [cell.strip(' \t\r"[]()') for cell in line.split(",")]
    has_numbers = any(map(NUMBER.fullmatch, re.split(r"[\s,\[\]()\"]+", line))) or _DATE.search(line)
    known = any(unit.lower() in words for unit in units for _, words in UNITS.values())
    return units if known and not has_numbers and len(units) == width else []


def _with_unit(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit.strip("-") else name


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


def _to_commas_of_numbers(line: str) -> Callable[[str], str]:
    """The same by a line of numbers, which may have decimal commas."""
    outside_lists = _LIST.sub("0", line[:LONGEST])
    return _to_commas(";" if ";" in outside_lists else outside_lists)


def _cells(line: str) -> list[str]:
    """Of a line of numbers, with 0 in the place of lists."""
    return _to_commas_of_numbers(line)(_to_seconds(_LIST.sub("0", line.strip()))).split(",")


def _has_numbers(line: str) -> bool:
    """Whether a line has no names: nothing but numbers, dates and lists, or some fractions beside words.

    Numbers that count the columns, as pandas writes them, are names.
    """
    cells = [cell for cell in _cells(line) if cell.strip()]
    counts = len(cells) > 1 and any(cells == [str(i + first) for i in range(len(cells))] for first in (0, 1))
    numbers = [cell for cell in cells if NUMBER.fullmatch(cell)]
    fractions = [number for number in numbers if "." in number]
    return bool(cells) and not counts and (len(numbers) == len(cells) or len(fractions) >= SOME)


def _of_message(cells: Sequence[str]) -> list[str]:
    """Names of the columns of a line of numbers: 1, 2, 3, ..., or those of the message that it is.

    ``ros2 topic echo --csv`` writes whole s, ns, the frame, and of a WrenchStamped six numbers, of a JointState the
    names of the joints and their positions, velocities and efforts; a list without entries is one empty cell.
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
    """By the names and the first lines of numbers."""
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
    """Those of a list, with spaces between them."""
    return " ".join(re.split(r"[,;\s]+", found[1].strip()))


def _width(cell: str) -> int:
    """How many numbers a cell has that is a list; 0 = it is none."""
    listed = re.fullmatch(r"\s*<(\d+)>\s*", cell)
    return int(listed[1]) if listed and int(listed[1]) > 1 else 0


def _side_by_side(text: str, widths: Sequence[int]) -> str:
    """Lines with the entries of their lists in cells of their own; in place of a list that is empty, as many."""
    lines = [line.split(",") for line in text.split("\n")]
    for i, cells in enumerate(lines):
        if len(cells) == len(widths):
            both = zip(cells, widths, strict=True)
            lines[i] = [",".join(cell.split() or [""] * width) if width else cell for cell, width in both]
    return "\n".join(map(",".join, lines))


def _to_seconds(text: str) -> str:
    """The text with s since 1970 in the place of dates, which are of UTC if they do not state their zone.

    Of a time without a date, or with one whose day and month cannot be told apart, s since midnight.
    """

    def seconds(found: re.Match[str]) -> str:
        day, hour, rest, zone = found.groups("")
        try:
            date = datetime.fromisoformat(f"{(day or EPOCH).replace('/', '-')}T{hour.zfill(2)}{rest}{zone}")
        except ValueError:
            return found[0]
        return f"{(date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp():.6f}"

    return _DATE.sub(seconds, text)
