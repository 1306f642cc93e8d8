"""Output on the terminal: warnings, and replacements of characters that a terminal cannot show."""

from __future__ import annotations

import codecs
import io
import sys
from collections.abc import Callable, Iterable
from functools import partial
from typing import TYPE_CHECKING

from ftbias_jax.errors import printable

if TYPE_CHECKING:
    from ftbias_jax.io.log import Repairs

WORDS = {"±": "+-", "σ": "sigma", "×": "x", "²": "^2", "°": "deg"}
"""ASCII replacements of the special characters in tables and messages."""
_CONTROL = {*range(0x20), *range(0x7F, 0xA0)} - set(map(ord, "\t\n\r"))
_BIDI = {0x061C, 0x200E, 0x200F, *range(0x2028, 0x202F), *range(0x2066, 0x206A)}
ESCAPED = {code: f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" for code in _CONTROL | _BIDI}
"""Control and bidirectional characters -> escapes shown instead, because names in the output come from files."""


def print_what_the_terminal_can() -> None:
    """Make the standard streams replace characters that their encoding lacks, instead of failing within a table."""
    codecs.register_error("ftbias", _in_other_words)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="ftbias")
            # Patched on the stream itself, so that every print is covered.
            setattr(stream, "write", partial(_write_escaped, type(stream).write, stream))  # noqa: B010


def _write_escaped(write: Callable[[io.TextIOWrapper, str], int], stream: io.TextIOWrapper, text: str) -> int:
    return write(stream, text.translate(ESCAPED))


def _in_other_words(error: UnicodeError) -> tuple[str, int]:
    assert isinstance(error, UnicodeEncodeError)  # registered for writing only
    text = error.object[error.start : error.end]
    return "".join(WORDS.get(character, "?") for character in text), error.end


def warn(text: str) -> None:
    """Print a line that begins with "warning: " on standard error; errors begin with the program's name instead."""
    print(printable(f"warning: {text}"), file=sys.stderr, flush=True)


def print_repairs(logs: Iterable[tuple[str, Repairs]]) -> int:
    """Print the repairs of every log on standard error; returns the exit code, 3 if samples were lost, else 0.

    Args:
        logs: path and repairs of each log.
    """
    code = 0
    for path, repairs in logs:
        for repair in repairs:
            warn(f"{path}: {repair.what}")
            code = 3 if repair.lost else code
    return code
