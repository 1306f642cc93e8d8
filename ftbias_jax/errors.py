"""Errors that a user can cause; each states the location, the offending value and the remedy.

The command line prints ``str(error)`` as one line and exits with ``error.exit_code``; anything that is not an
``FtbiasError`` is a bug and keeps its traceback.
"""

import os
import sys
from typing import Any, SupportsIndex, cast

LONGEST = 2000
"""Maximum number of characters of a printed line: a list of many columns fits, a name of a megabyte does not."""
LONGEST_NAME = 200
"""Maximum number of characters of the name of a file, a topic or a column."""


def printable(text: str) -> str:
    """Text on one line without control characters, because names from a log could otherwise disturb a terminal."""
    return "".join(c if c.isprintable() else "?" for c in " ".join(cut(text, LONGEST).split()))


def cut(text: str, longest: int = LONGEST_NAME) -> str:
    """Shorten text that is too long to its beginning and end, with the number of omitted characters between them."""
    if len(text) <= longest:
        return text
    half = longest // 2
    return f"{text[:half]}[... {len(text) - 2 * half} characters ...]{text[-half:]}"


def is_number(value: object, least: float = sys.float_info.min, most: float = sys.float_info.max) -> bool:
    """Whether an argument is one real number within limits, by default positive and finite; text is none."""
    if isinstance(value, str | bytes | bool):
        return False
    try:
        return least <= float(cast(Any, value)) <= most
    except (TypeError, ValueError):
        return False


def is_integer(value: object) -> bool:
    """Whether an argument is an integer of Python or NumPy."""
    return isinstance(value, SupportsIndex) and not isinstance(value, bool)


class FtbiasError(Exception):
    """Base class of all errors that a user can correct.

    Args:
        message: what is wrong, with the offending value.
        file: the file it is in, or "" for data that came from memory.
        field: the key, column or array it is in, such as ``tool.mass``.
        remedy: what to do about it.
    """

    exit_code = 1

    def __init__(self, message: str, *, file: object = "", field: str = "", remedy: str = "") -> None:
        self.message, self.file, self.field, self.remedy = message, str(file), field, remedy
        where = ": ".join(cut(part) for part in (self.file, field) if part)
        text = f"{where}: {message}" if where else message
        super().__init__(printable(f"{text} ({remedy})" if remedy else text))


class SetupError(FtbiasError):
    """The setup (TOML) is wrong: a missing, misspelt or impossible value."""


class LogError(FtbiasError):
    """The log cannot be read or cannot be filtered."""


class OutputError(FtbiasError):
    """A result cannot be written."""


class UsageError(FtbiasError):
    """The command line asks for something that does not exist."""

    exit_code = 2


def path_of(path: object, field: str) -> str:
    """The path in an argument, as text.

    Raises:
        UsageError: naming ``field``; it is no path.
    """
    if not isinstance(path, str | os.PathLike):
        raise UsageError(f"got {type(path).__name__}", field=field, remedy="give the path of a file")
    return str(os.fspath(path))
