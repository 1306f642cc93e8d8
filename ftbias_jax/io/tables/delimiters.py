"""Tables whose cells are not separated by commas, as if they were."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TextIO

LONGEST = 1 << 16
"""Characters of the first line that are looked at."""


def with_commas(stream: TextIO) -> TextIO | Commas:
    """A text with cells separated by commas, semicolons, tabs or spaces, by what stands in its first line.

    Between semicolons a comma is the decimal one.
    """
    header = stream.readline(LONGEST)
    stream.seek(0)
    if "," in header:
        return stream
    if ";" in header:
        return Commas(stream, lambda text: text.translate(_SEMICOLONS))
    if "\t" in header:
        return Commas(stream, lambda text: text.replace("\t", ","))
    if " " in header.strip().removeprefix("#").strip():
        return Commas(stream, _from_spaces)
    return stream


class Commas:
    """A text stream that is converted line by line."""

    def __init__(self, stream: TextIO, convert: Callable[[str], str]) -> None:
        self._stream, self._convert = stream, convert

    def readline(self, limit: int = -1) -> str:
        """The next line."""
        return self._convert(self._stream.readline(limit))

    def readlines(self, hint: int = -1) -> list[str]:
        """Whole lines of about so many characters."""
        return self.read(hint).splitlines(keepends=True)

    def read(self, size: int = -1) -> str:
        """Whole lines of about so many characters, as one text."""
        return self._convert("".join(self._stream.readlines(size)))


_SEMICOLONS = str.maketrans({",": ".", ";": ","})


def _from_spaces(text: str) -> str:
    tidy = re.sub(r"^#?[ \t]+|[ \t]+$", "", text, flags=re.MULTILINE)
    return re.sub(r"[ \t]+", ",", tidy)
