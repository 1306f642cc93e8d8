"""Files that are there whole or not at all, and the folders for them."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ftbias_jax.errors import OutputError
from ftbias_jax.setup.save import refuse_link as refuse_link
from ftbias_jax.setup.save import write_atomic as write_atomic
from ftbias_jax.setup.save import write_text


def write_json(path: str | os.PathLike[str], content: Mapping[str, Any]) -> None:
    """Write plain dicts, lists, strings and numbers as JSON."""
    write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


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
