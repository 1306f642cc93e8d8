"""Strict reading of single TOML fields: each value has its type, shape and range, or a SetupError that names it."""

import difflib
import re
import tomllib
from collections.abc import Collection, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from ftbias_jax.errors import SetupError
from ftbias_jax.files import no_regular_file
from ftbias_jax.types import Array


class Section(NamedTuple):
    """One TOML table, its name and its file."""

    values: Mapping[str, Any]
    name: str
    """Dotted, such as ``robot.flange``; "" for the whole file."""
    file: str

    def path(self, key: str) -> str:
        """Full name of a key."""
        return f"{self.name}.{key}" if self.name else key

    def error(self, key: str, message: str, remedy: str) -> SetupError:
        """The error to raise about a key."""
        return SetupError(message, file=self.file, field=self.path(key), remedy=remedy)


Bounds = tuple[float, float]
ANY: Bounds = (-np.inf, -np.inf)
MAX_TOML = 1 << 20  # a setup is a page of text; anything larger is another kind of file
MOST_PARTS = 32
"""Maximum number of parts of a dotted key, because the parser's memory grows with their square."""
LARGEST = 1e30  # absolute value, far above every quantity of a setup, whose square is still finite


def nearest(name: str, known: Iterable[str]) -> str:
    """Remedy for an unknown name: the closest known one, or all of them."""
    choices = {_plain(choice): choice for choice in sorted(known)}
    close = difflib.get_close_matches(_plain(name), choices, n=1)
    return f"did you mean {choices[close[0]]!r}?" if close else f"known: {', '.join(choices.values())}"


def _plain(name: str) -> str:
    """Strip a name of what people write differently: case, hyphens, blanks."""
    return re.sub(r"[\W_]", "", name.lower())


def show(value: object, length: int = 60) -> str:
    """A value for a message, shortened to one line."""
    text = repr(value)
    return text if len(text) <= length else f"{text[: length - 3]}..."


def check_keys(section: Section, known: Collection[str]) -> Section:
    """Return the section if all its keys are known; raise an error otherwise."""
    for key in section.values:
        if key not in known:
            raise section.error(key, "unknown key", nearest(key, known))
    return section


def read_file(file: str, most: int, remedy: str, instead: str) -> bytes:
    """Return the content of a file of at most ``most`` bytes.

    Raises:
        SetupError: it cannot be read (with ``remedy``), or is larger (with ``instead`` as the remedy).
    """
    try:
        if kind := no_regular_file(file):
            raise SetupError(kind, file=file, remedy=remedy)
        with open(file, "rb") as stream:
            content = stream.read(most + 1)
    except (OSError, ValueError) as error:  # the latter: a zero byte in the name
        message = f"cannot be read: {getattr(error, 'strerror', None) or error}"
        raise SetupError(message, file=file or "the setup with an empty name", remedy=remedy) from error
    if len(content) > most:
        size = f"{most >> 20} MiB" if most >> 20 else f"{most >> 10} KiB"
        raise SetupError(f"is larger than {size}", file=file, remedy=instead)
    return content


def read_toml(file: str, remedy: str, instead: str) -> tuple[str, dict[str, Any]]:
    """Return the text of a TOML file and its tables.

    Raises:
        SetupError: as for ``read_file``, or it is not TOML.
    """
    content = read_file(file, MAX_TOML, remedy, instead)
    try:
        text = content.decode()
        if _longest_key(text) > MOST_PARTS:
            raise SetupError(f"has a key of more than {MOST_PARTS} parts", file=file, remedy="write tables as [table]")
        return text, tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # broken UTF-8, broken TOML (says where), arrays nested without end
        raise SetupError(f"is not valid TOML: {error}", file=file, remedy="correct the syntax") from error


def _longest_key(text: str) -> int:
    """Number of parts of the longest dotted key, or of what may be one; comments are ignored."""
    lines = (line.partition("#")[0] for line in text.splitlines())
    return max((piece.count(".") + 1 for line in lines for piece in re.split(r"[=,\[\]{}]", line)), default=0)


def refuse(section: Section, keys: Iterable[str], why: str, remedy: str = "remove one of the two") -> None:
    """Raise an error if one of these keys is present; ``why`` states what excludes it."""
    for key in keys:
        if key in section.values:
            raise section.error(key, why, remedy)


def read_only(array: Array) -> Array:
    """Make an array read-only and return it."""
    array.setflags(write=False)
    return array


def subsection(parent: Section, key: str, known: Collection[str], *, required: bool = False) -> Section:
    """Return the table at a key, all of whose keys must be known; an absent optional one is empty."""
    if required and key not in parent.values:
        raise parent.error(key, "missing section", f"add [{parent.path(key)}]")
    return check_keys(table(parent, key), known)


def table(parent: Section, key: str) -> Section:
    """Return the table at a key, with any keys; empty if absent."""
    values = parent.values.get(key, {})
    if not isinstance(values, Mapping):
        raise parent.error(key, f"expected a table, got {show(values)}", f"write it as [{parent.path(key)}]")
    return Section(values, parent.path(key), parent.file)


def require(section: Section, key: str, remedy: str) -> Any:
    """Return the value at a required key."""
    if key not in section.values:
        raise section.error(key, "missing key", remedy)
    return section.values[key]


def text(section: Section, key: str, default: str, choices: Collection[str] = ()) -> str:
    """Return a string, which is one of the choices if there are any."""
    value = section.values.get(key, default)
    if not isinstance(value, str):
        raise section.error(key, f"expected a string, got {show(value)}", 'write it as "..."')
    if choices and value not in choices:
        raise section.error(key, f"unknown value {show(value)}", nearest(value, choices))
    return value


def names(section: Section, key: str, size: int) -> tuple[str, ...]:
    """Return a required list of ``size`` different strings."""
    value = require(section, key, f"give {size} names")
    if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
        raise section.error(key, f"expected a list of strings, got {show(value)}", f"give {size} names")
    if len(value) != size:
        raise section.error(key, f"has {len(value)} names", f"give {size}")
    repeated = next((item for item in value if value.count(item) > 1), None)
    if repeated is not None:
        raise section.error(key, f"the name {show(repeated)} is there twice", f"give {size} different names")
    return tuple(value)


def rows(section: Section, key: str, size: int) -> list[list[Any]]:
    """Return a required list of rows of ``size`` entries, or one more."""
    remedy = f"give rows of {size} numbers"
    value = require(section, key, remedy)
    if not isinstance(value, list) or not value or not all(isinstance(row, list) for row in value):
        raise section.error(key, f"expected rows, got {show(value)}", remedy)
    for i, row in enumerate(value):
        if len(row) not in (size, size + 1):
            raise section.error(f"{key}[{i}]", f"has {len(row)} entries", f"give {size} numbers")
    return value


def vector(
    section: Section, key: str, size: int, default: Array | None = None, *, within: Bounds = ANY, expand: bool = False
) -> Array:
    """Return numbers as a read-only (size,) float64 array.

    Args:
        section: the table with the value.
        key: the key of the value.
        size: of the result.
        default: the value if the key is absent; None = required.
        within: inclusive lower bound, and exclusive lower bound, of every number.
        expand: one number stands for all; of six, two stand for three forces and three torques.
    """
    sizes = sizes_of(size, expand)
    words = {1: "one number", 2: "two (force, torque)"}
    counts = " or ".join(words.get(count, f"{count} numbers") for count in sizes)
    least, above = within
    bounded = f"{least:g} or more" if np.isfinite(least) else "finite"
    remedy = f"give {counts}, each {f'greater than {above:g}' if np.isfinite(above) else bounded}"
    value = require(section, key, remedy) if default is None else section.values.get(key, default)
    flat = value if isinstance(value, list | tuple | np.ndarray) else [value]
    if not all(isinstance(item, int | float) and not isinstance(item, bool) for item in flat):
        raise section.error(key, f"expected numbers, got {show(value)}", remedy)
    if len(flat) not in sizes:
        raise section.error(key, f"has {len(flat)} numbers", remedy)
    try:
        numbers = np.array([float(item) for item in flat])
    except OverflowError:  # TOML integers are unbounded
        numbers = np.array([np.inf])
    if not (np.isfinite(numbers) & (numbers > above) & (numbers >= least)).all():
        raise section.error(key, f"got {show(value)}", remedy)
    if np.abs(numbers).max() > LARGEST:
        raise section.error(key, f"got {show(value)}", "check the number and its unit: nothing here is so large")
    return read_only(np.array(np.repeat(numbers, size // len(flat))))


def sizes_of(size: int, expand: bool) -> list[int]:
    """Counts of numbers that may be written for ``size`` of them."""
    return sorted({size} | ({1} if expand else set()) | ({2} if expand and size == 6 else set()))
