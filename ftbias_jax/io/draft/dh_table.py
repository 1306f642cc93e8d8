"""Keys of a setup from a Denavit-Hartenberg table in a text file, as it is copied from a manual."""

import os
import re
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from ftbias_jax.errors import SetupError, UsageError
from ftbias_jax.io.draft.robot import Keys
from ftbias_jax.setup.dump import Known
from ftbias_jax.setup.fields import Section, read_file
from ftbias_jax.setup.robots import CONVENTIONS, FIXED, UNITS, read_dh

MAX_BYTES = 1 << 16  # a table of an arm is a dozen lines
ORDER = ("a", "alpha", "d", "theta")
"""Columns of a table without a header."""
WORDS = {
    "a": "a", "link length": "a", "alpha": "alpha", "\u03b1": "alpha", "twist": "alpha", "link twist": "alpha",
    "d": "d", "link offset": "d", "theta": "theta", "θ": "theta", "q": "theta", "joint angle": "theta",
    "": "row", "joint": "row", "link": "row", "row": "row", "name": "name", "type": "type",
}  # fmt: skip
"""Heading of a column, without its index and unit -> meaning of the column; a ``row`` column is ignored."""
UNIT_WORDS = {
    "mm": "mm", "millimeter": "mm", "millimetre": "mm", "m": "m", "meter": "m", "metre": "m",
    "deg": "deg", "degree": "deg", "°": "deg", "rad": "rad", "radian": "rad",
}  # fmt: skip
_UNIT = "|".join(sorted((re.escape(word) + "s?" for word in UNIT_WORDS), key=len, reverse=True))
_HEAD = re.compile(rf"(?P<name>.*?)(?:\s*[\[(/_]\s*(?P<unit>{_UNIT})\s*[\])]?)?")
_INDEX = re.compile(r"[_ ]?[({]?(?:i|n|j)\s*(?:-\s*1)?[)}]?$")
_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?"
_VALUE = re.compile(
    rf"(?P<joint>(?:theta|th|q|θ|d)_?\{{?\d*\}}?)?\s*"
    rf"(?:(?P<sign>[+-]?)\s*(?P<number>{_NUMBER})?\s*\*?\s*(?P<pi>pi|π)?\s*(?:/\s*(?P<over>{_NUMBER}))?)?\s*"
    rf"(?P<unit>{_UNIT})?"
)


class Cell(NamedTuple):
    """Content of a cell."""

    value: float
    unit: str
    """Unit that the cell itself states, with pi as radians; "" = none."""
    joint: bool
    """Whether the cell contains the joint's variable."""


class DhTable(NamedTuple):
    """A table, with the convention and the units that the user states."""

    path: str
    """Path of a text file with cells between commas, semicolons or tabs, and a header or the columns of ORDER."""
    convention: str = ""
    """One of CONVENTIONS; "" = not stated, which is refused."""
    units: str = ""
    """One of UNITS; "" = as the header or the cells state them."""


def from_table(table: DhTable) -> Keys:
    """Keys of a setup for the arm in a table."""
    path, convention, units = table
    if not convention:
        remedy = f"say {' or '.join(CONVENTIONS)}, as the source of the table does: the same numbers mean two robots"
        raise UsageError("the Denavit-Hartenberg convention is not stated", field="--dh-convention", remedy=remedy)
    columns, stated, lines = _columns(_lines(path), path)
    cells = [{name: _cell(line[i], f"{name} of row {n}", path) for name, i in columns.items() if name in ORDER}
             for n, line in enumerate(lines, 1)]  # fmt: skip
    units = _units(cells, stated, units, path)
    marked = any(row["theta"].joint for row in cells)  # then rows without the mark have no joint
    rows: list[list[Any]] = []
    for row, line in zip(cells, lines, strict=True):
        numbers: list[Any] = [row[name].value for name in ORDER]
        kind = line[columns["type"]].lower() if "type" in columns else ""
        slides = row["d"].joint or kind.startswith("p")
        fixed = kind == FIXED or (not kind and marked and not row["theta"].joint)
        rows.append([*numbers, "prismatic"] if slides else [*numbers, FIXED] if fixed else numbers)
    keys = {"dh": rows, "dh_convention": convention, "dh_units": units}
    if "name" in columns:
        keys["joint_names"] = [line[columns["name"]] for line, row in zip(lines, rows, strict=True) if FIXED not in row]
    read_dh(Section(keys, "robot", path), convention, units)
    remark = f"from {os.path.basename(path)}"
    return {
        f"robot.{key}": Known(value, "as stated" if key == "dh_convention" else remark) for key, value in keys.items()
    }


def _lines(path: str) -> list[list[str]]:
    """Cells of the lines that are neither empty nor comments."""
    remedy = "give a text file with the rows of the table"
    try:
        text = read_file(path, MAX_BYTES, remedy, remedy).decode("utf-8-sig").replace("\u2212", "-")
    except UnicodeDecodeError as error:
        raise SetupError("is no text in UTF-8", file=path, remedy=remedy) from error
    between = ";" if ";" in text else "\t" if "\t" in text else ","
    text = text.replace(",", ".") if between == ";" else text  # beside semicolons, a comma is the decimal point
    kept = [line for line in text.splitlines() if line.strip(f"{between} \t") and not line.startswith("#")]
    return [[cell.strip().strip('"').strip() for cell in line.split(between)] for line in kept]


def _columns(lines: list[list[str]], path: str) -> tuple[dict[str, int], dict[str, set[str]], list[list[str]]]:
    """Index of each column, the units in the header by column, and the lines below the header."""
    if not lines:
        raise SetupError("has no rows", file=path, remedy=f"give rows of {', '.join(ORDER)}")
    columns: dict[str, int] = {}
    stated: dict[str, set[str]] = {}
    head, below = lines[0], lines[1:]
    if all(_VALUE.fullmatch(cell.lower()) and re.search(r"\d|pi|π", cell.lower()) for cell in head):
        columns, below = {name: i for i, name in enumerate(ORDER)}, lines
        if len(head) != len(ORDER):
            remedy = f"write a header, or the {len(ORDER)} columns {', '.join(ORDER)}"
            raise SetupError(f"has no header and {len(head)} columns", file=path, remedy=remedy)
    else:
        for i, cell in enumerate(head):
            name, unit = _heading(cell, path)
            if name in columns and name != "row":
                raise SetupError(f"has two columns of {name}", file=path, remedy="remove one")
            columns[name] = i
            stated[name] = {unit} - {""}
    if missing := [name for name in ORDER if name not in columns]:
        raise SetupError(f"has no column {missing[0]}", file=path, remedy=f"head the columns {', '.join(ORDER)}")
    for n, line in enumerate(below, 1):
        if len(line) != len(head):
            remedy = "give every row as many cells"
            raise SetupError(f"row {n} has {len(line)} cells, the first line {len(head)}", file=path, remedy=remedy)
    return columns, stated, below


def _heading(cell: str, path: str) -> tuple[str, str]:
    """Column and unit ("" = not stated) of a cell of the header."""
    text = re.sub(r"\(\s*i\s*-\s*1\s*\)", "", cell.lower())
    found = _HEAD.fullmatch(text)
    name, unit = (found["name"].strip(), found["unit"] or "") if found else (text, "")
    known = WORDS.get(name, WORDS.get(_INDEX.sub("", name).strip()))
    if known is None:
        remedy = f"head the columns {', '.join(ORDER)}, and perhaps name and type; remove others"
        raise SetupError(f"column {cell!r} is not known", file=path, remedy=remedy)
    return known, _unit(unit)


def _unit(word: str) -> str:
    return UNIT_WORDS.get(word) or UNIT_WORDS.get(word.removesuffix("s"), "")


def _cell(text: str, where: str, path: str) -> Cell:
    found = _VALUE.fullmatch(text.lower())
    if not text or not found or (found["over"] and not (found["number"] or found["pi"])):
        remedy = "write a number, pi/2, 90°, or the joint's variable with its offset, such as q2 - 90"
        raise SetupError(f"{where} is {text!r}", file=path, remedy=remedy)
    if not (found["number"] or found["pi"]) and (found["sign"] or not found["joint"]):
        raise SetupError(f"{where} is {text!r}", file=path, remedy="write a number")
    plain = 1.0 if found["pi"] or not found["joint"] else 0.0
    value = float(found["number"] or plain) * (np.pi if found["pi"] else 1.0) / float(found["over"] or 1.0)
    unit = "rad" if found["pi"] else _unit(found["unit"] or "")
    return Cell(-value if found["sign"] == "-" else value, unit, bool(found["joint"]))


def _units(cells: Iterable[Mapping[str, Cell]], stated: Mapping[str, set[str]], option: str, path: str) -> str:
    """One of UNITS, on which header, cells and option agree."""
    found = []
    for columns, words, asked in zip((("a", "d"), ("alpha", "theta")), ("lengths", "angles"), (0, 1), strict=True):
        units = {unit for name in columns for unit in stated.get(name, ())}
        units |= {row[name].unit for row in cells for name in columns} - {""}
        units |= {option.split(",")[asked]} if option else set()
        if len(units) != 1:
            two = " and ".join(sorted(units))
            says = f"states {words} in {two}" if units else f"does not state the unit of {words}"
            remedy = f"head the columns as in 'a [mm]' and 'alpha [deg]', or give --dh-units: {' '.join(UNITS)}"
            raise SetupError(says, file=path, field="--dh-units", remedy=remedy)
        found.append(units.pop())
    if ",".join(found) not in UNITS:
        raise SetupError(f"has lengths in {found[0]} and angles in {found[1]}", file=path, remedy="correct the header")
    return ",".join(found)
