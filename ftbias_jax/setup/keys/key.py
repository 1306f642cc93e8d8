"""What the table of keys says about one key and one section."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from typing import Any, NamedTuple

from ftbias_jax.setup.fields import ANY, Range


class Kind(Enum):
    """What stands on the right of a key."""

    NUMBER = "a number"
    NUMBERS = "numbers"
    TEXT = "text"
    FLAG = "true or false"
    NAMES = "names"
    ROWS = "rows of numbers"
    TABLE = "a table"
    TABLES = "tables"


PER_JOINT = 0
"""Size of a key that has an entry for every joint, or for every entry of a recorded pose."""
SEVERAL = -1
"""Size of a key that has as many numbers as there are events."""


class Key(NamedTuple):
    """One key of a section."""

    kind: Kind
    meaning: str
    """In words, for the reference; without a full stop."""
    unit: str = ""
    size: int = 1
    """How many numbers or names, or PER_JOINT, or SEVERAL."""
    expand: bool = False
    """One number stands for all; of six, two stand for three forces and three torques."""
    within: Range = ANY
    """What every number may be."""
    default: Any = None
    """The value if the key is absent; None = it has none."""
    required: bool = False
    choices: tuple[str, ...] = ()
    absent: str = ""
    """In words, what holds if the key is absent and has no default, or the default in a reader's words."""
    example: Any = None
    """A value that the parser accepts, for a key without a default."""


class SectionKeys(NamedTuple):
    """One section."""

    about: str
    keys: Mapping[str, Key]
    required: bool = False
    further: str = ""
    """What any other key means, whose value is text; "" = there is no other key."""


def number(meaning: str, unit: str = "", **more: Any) -> Key:
    """A key of one number."""
    return Key(Kind.NUMBER, meaning, unit, **more)


def numbers(meaning: str, unit: str, size: int, **more: Any) -> Key:
    """A key of several numbers."""
    return Key(Kind.NUMBERS, meaning, unit, size, **more)


def text(meaning: str, **more: Any) -> Key:
    """A key of text."""
    return Key(Kind.TEXT, meaning, **more)


def names(meaning: str, size: int, **more: Any) -> Key:
    """A key of different names."""
    return Key(Kind.NAMES, meaning, size=size, **more)
