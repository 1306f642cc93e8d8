"""Atomic writing of files, reading and writing of JSON, and folders for results."""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ftbias_jax.errors import FtbiasError, LogError, OutputError
from ftbias_jax.setup.save import refuse_link as refuse_link
from ftbias_jax.setup.save import write_atomic as write_atomic
from ftbias_jax.setup.save import write_text

MAX_JSON = 64 << 20
"""Maximum size in bytes of a JSON file that is read."""


def write_json(path: str | os.PathLike[str], content: Mapping[str, Any] | list[Any]) -> None:
    """Write plain dicts, lists, strings and numbers as JSON."""
    write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def plain(value: Any) -> Any:
    """Convert a value recursively to what ``write_json`` writes: arrays to lists, non-finite numbers to None."""
    match value:
        case Mapping():
            return {str(key): plain(item) for key, item in value.items()}
        case list() | tuple():
            return [plain(item) for item in value]
        case None | bool() | int() | str():
            return value
        case float():
            return float(value) if np.isfinite(value) else None
    return plain(np.asarray(value).tolist())


def read_json(path: str, what: str, refusal: type[FtbiasError] = LogError) -> Any:
    """Read the content of a JSON file; ``what`` is the expected content, for messages.

    Raises:
        FtbiasError: a ``refusal``, if the file cannot be read, is larger than MAX_JSON, or is no JSON.
    """
    try:
        with open(path, "rb") as file:
            content = file.read(MAX_JSON + 1)
        if len(content) > MAX_JSON:
            raise refusal(f"is larger than {MAX_JSON >> 20} MiB", file=path, remedy=f"give {what}")
        return json.loads(content)
    except OSError as error:
        raise refusal(f"cannot be read: {error.strerror}", file=path, remedy="check the path") from error
    except (ValueError, RecursionError) as error:
        raise refusal(f"is not valid JSON: {error}", file=path, remedy=f"give {what}") from error


def make_folder_inside(folder: str, path: str) -> None:
    """Make the folder ``path`` of a result inside ``folder``; no folder between them may be a link."""
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
