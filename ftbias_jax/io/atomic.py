"""Files that are there whole or not at all, and the folders for them."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, BinaryIO

from ftbias_jax.errors import OutputError
from ftbias_jax.files import replace_whole


def write_atomic(path: str | os.PathLike[str], write: Callable[[BinaryIO], object]) -> None:
    """Write a file through a temporary one beside it: written, flushed to disk, then renamed.

    On any failure the temporary file is removed, and what stood at ``path`` before still stands there.

    Args:
        path: the file to make or replace.
        write: called once with the open temporary file. What it raises, but for OSError, passes through.

    Raises:
        OutputError: the file cannot be written there, or it is a symbolic link.
    """
    name = os.fspath(path)
    refuse_link(name)
    if os.path.exists(name) and not os.path.isfile(name):
        raise OutputError("is not a regular file", file=name, remedy="give the path of a file to write")
    try:
        replace_whole(os.path.abspath(name), write)
    except OSError as error:
        remedy = "check that the folder exists, may be written to and has room"
        raise OutputError(f"cannot be written: {error.strerror or error}", file=name, remedy=remedy) from error


def write_json(path: str | os.PathLike[str], content: Mapping[str, Any]) -> None:
    """Write plain dicts, lists, strings and numbers as JSON."""
    text = json.dumps(content, indent=1, allow_nan=False) + "\n"
    write_atomic(path, lambda file: file.write(text.encode()))


def refuse_link(path: str | os.PathLike[str]) -> None:
    """Refuse an output that is a symbolic link: what it leads to was not named, and may be a recording."""
    if os.path.islink(path):
        raise OutputError("is a symbolic link", file=path, remedy="remove it, or name the file that it leads to")


def make_folder_inside(folder: str, path: str) -> None:
    """Make the folder of a result in a folder of results; no folder between them may be a link."""
    place = folder
    for part in Path(os.path.relpath(path, folder)).parts:
        place = os.path.join(place, part)
        refuse_link(place)
    make_folder(path)


def make_folder(path: str | os.PathLike[str]) -> None:
    """Make a folder for results, if it is not there."""
    try:
        os.makedirs(path, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot make the folder: {error.strerror}", file=path, remedy="name another") from error
