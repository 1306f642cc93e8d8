"""Which files are one log, where every stream is a file of its own: [log.files] of the setup."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping

from ftbias_jax.errors import LogError
from ftbias_jax.io.remote import exists, is_url

MAIN = "wrench"
"""The stream whose file names the log; every setup with [log.files] states it."""


def files_of(path: str | os.PathLike[str], patterns: Mapping[str, str]) -> dict[str, str]:
    """The files that make up one log, by quantity."""
    found = list(_readings(os.fspath(path).rstrip("/" + os.sep), patterns))
    if not found:
        remedy = f"give a log whose name fits one of {', '.join(patterns.values())}"
        raise LogError("is none of the files that log.files of the setup names", file=path, remedy=remedy)
    # A name may fit several patterns, such as "*.csv" and "*_wrench.csv": one of them leads to files that are there.
    return next((files for files in found if all(map(exists, files.values()))), found[0])


def inputs_of(path: str | os.PathLike[str], patterns: Mapping[str, str]) -> tuple[str, ...]:
    """All files of a log; of one that is a single file, or that fits no pattern, the path itself."""
    try:
        return tuple(dict.fromkeys(files_of(path, patterns).values())) if patterns else (os.fspath(path),)
    except LogError:
        return (os.fspath(path),)


def main_file(path: str, patterns: Mapping[str, str]) -> str | None:
    """The file that names the log which a file belongs to; None if it belongs to none.

    That of the wrench, so that all files of a log give one name. If it is missing, the first of the others that is
    there, so that whoever reads the log says what is missing.
    """
    try:
        files = files_of(path, patterns)
    except LogError:
        return None
    ordered = (files[MAIN], *files.values())
    return next((file for file in ordered if exists(file)), path)


def _readings(path: str, patterns: Mapping[str, str]) -> Iterator[dict[str, str]]:
    """The files of the log that a path belongs to, as each pattern that it fits has it."""
    folder, name = os.path.split(path)
    for pattern in patterns.values():
        before, star, after = pattern.partition("*")
        shared = re.fullmatch(f"{re.escape(before)}(.*){re.escape(after)}", name) if star else None
        if shared:
            names = {key: other.replace("*", shared[1], 1) for key, other in patterns.items()}
        elif name == pattern:
            names = dict(patterns)
        else:
            continue
        yield {key: other if is_url(other) else os.path.join(folder, other) for key, other in names.items()}
