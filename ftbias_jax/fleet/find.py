"""Which logs arguments name, where the result of each goes, and what machines share them."""

from __future__ import annotations

import glob
import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from ftbias_jax.errors import LogError, UsageError
from ftbias_jax.io import READERS
from ftbias_jax.io.ros.record import PACKED, SUFFIXES

BAG_FOLDER = "metadata.yaml"
"""A folder with this file is one ROS 2 bag; any other is searched."""


class Task(NamedTuple):
    """One log of many."""

    log: str
    """Its path, as found."""
    output: str
    """Path of the result, from the output folder."""


def is_folder(output: str) -> bool:
    """Whether an output is meant to be a folder: it is one, or has no suffix."""
    return output.endswith(("/", os.sep)) or Path(output).is_dir() or not Path(output).suffix


def expand(arguments: Sequence[str]) -> list[str]:
    """The logs that arguments name, in their order: folders and patterns become what is in them.

    Raises:
        UsageError: an argument names no log. LogError: a folder cannot be read.
    """
    logs = [log for argument in arguments for log in _named_by(argument, "")[1]]
    return list({os.path.abspath(log): log for log in logs}.values())


def find_logs(arguments: Sequence[str], folder: str, suffix: str) -> list[Task]:
    """The logs that paths, folders and patterns name, sorted; each has its own result.

    Args:
        arguments: as given to the command.
        folder: of the results, which is not searched.
        suffix: of the results.

    Raises:
        UsageError: an argument names no log, or two logs would have one result. LogError: a folder cannot be read.
    """
    found: dict[str, str] = {}
    roots = []
    for argument in arguments:
        root, logs = _named_by(argument, os.path.realpath(folder))
        roots.append(root)
        found |= {os.path.abspath(log): log for log in logs}
    base = os.path.commonpath([os.path.abspath(root) for root in roots])
    tasks: dict[str, Task] = {}
    for path, log in sorted(found.items()):
        output = _without_suffix(os.path.relpath(path, base)) + suffix
        if output in tasks:
            message = f"{tasks[output].log!r} and {log!r} would both be written to {output!r}"
            raise UsageError(message, field="LOG", remedy="give them two folders of results")
        tasks[output] = Task(log, output)
    return list(tasks.values())


def shard(tasks: Sequence[Task], index: int, count: int) -> list[Task]:
    """The share of one of ``count`` machines, ``index`` from 1."""
    return list(tasks[index - 1 :: count])


def _named_by(argument: str, folder: str) -> tuple[str, list[str]]:
    """The folder under which an argument's results keep their places, and its logs, of which there are some."""
    root, logs = _logs_of(argument, folder)
    if not logs:
        raise UsageError(f"no log in {argument!r}", field="LOG", remedy="give a log, a folder of logs, or a pattern")
    return root, logs


def _logs_of(argument: str, folder: str) -> tuple[str, list[str]]:
    """The folder under which an argument's results keep their places, and its logs."""
    if not glob.has_magic(argument) or os.path.exists(argument):
        is_log = not os.path.isdir(argument) or _is_bag(argument)
        return (os.path.dirname(os.path.abspath(argument)) if is_log else argument), _walk(argument, folder)
    root = argument
    while glob.has_magic(root):
        root = os.path.dirname(root)
    return root or ".", [log for match in glob.iglob(argument, recursive=True) for log in _walk(match, folder)]


def _walk(path: str, folder: str, seen: set[str] | None = None) -> list[str]:
    """A log itself, or the logs in a folder and those below it; a folder that links lead to again is seen once."""
    if not os.path.isdir(path) or _is_bag(path):
        return [path]
    seen, place = set() if seen is None else seen, os.path.realpath(path)
    if place == folder or place in seen:
        return []
    seen.add(place)
    try:
        within = [os.path.join(path, name) for name in sorted(os.listdir(path)) if not name.startswith(".")]
    except OSError as error:
        raise LogError(
            f"cannot be read: {error.strerror}", file=path, remedy="check who may read the folder"
        ) from error
    return [log for inner in within if os.path.isdir(inner) or _is_log(inner) for log in _walk(inner, folder, seen)]


def _is_bag(path: str) -> bool:
    return os.path.isfile(os.path.join(path, BAG_FOLDER))


def _is_log(path: str) -> bool:
    return path.lower().removesuffix(PACKED).endswith((*READERS, *SUFFIXES))


def _without_suffix(path: str) -> str:
    name = path.removesuffix(PACKED)
    return os.path.splitext(name)[0] if _is_log(name) else name
