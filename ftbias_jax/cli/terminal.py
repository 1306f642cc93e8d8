"""Standard output and error on terminals that do not know every character."""

from __future__ import annotations

import codecs
import io
import sys

WORDS = {"±": "+-", "σ": "sigma", "×": "x", "²": "^2", "°": "deg"}
"""How to write in ASCII what tables and messages use."""


def print_what_the_terminal_can() -> None:
    """Write what an encoding lacks in other words, instead of ending in the middle of a table."""
    codecs.register_error("ftbias", _in_other_words)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="ftbias")


def _in_other_words(error: UnicodeError) -> tuple[str, int]:
    assert isinstance(error, UnicodeEncodeError)  # it is asked for writing only
    text = error.object[error.start : error.end]
    return "".join(WORDS.get(character, "?") for character in text), error.end
