"""Find the logs that arguments name, the path of each result, and the share of each machine."""

import glob
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from ftbias_jax.errors import LogError, UsageError
from ftbias_jax.io.remote import check_planned, is_url, listed, without_credentials
from ftbias_jax.io.ros.record import PACKED, SUFFIXES
from ftbias_jax.io.tables.arrays import TABLES
from ftbias_jax.io.tables.streams import inputs_of, main_file

BAG_FOLDER = "metadata.yaml"
"""A folder with this file is one ROS 2 bag; any other is searched."""
Patterns = Mapping[str, str]
"""[log.files] of the setup: quantity -> pattern of the name of its file; {} = every log is one file."""
ONE_FILE: Patterns = MappingProxyType({})


class Task(NamedTuple):
    """One log of an archive."""

    log: str
    """Path of the log, as found."""
    output: str
    """Path of the result relative to the output folder."""
    files: tuple[str, ...] = ()
    """Files of the log, if it has several; () = the log itself."""

    @property
    def paths(self) -> tuple[str, ...]:
        """Paths of all files of the log."""
        return self.files or (self.log,)


def is_folder(output: str) -> bool:
    """Whether an output is meant to be a folder: it is one, or has no suffix."""
    return output.endswith(("/", os.sep)) or Path(output).is_dir() or not Path(output).suffix


def expand(arguments: Sequence[str], patterns: Patterns = ONE_FILE) -> list[str]:
    """Paths of the logs that arguments name, in their order, with folders and patterns expanded.

    Raises:
        UsageError: an argument names no log. LogError: a folder cannot be read.
    """
    logs = [log for argument in arguments for log in _named_by(argument, "", patterns)[1]]
    return list({os.path.abspath(log): log for log in logs}.values())


def inputs(logs: Sequence[str], patterns: Patterns) -> list[str]:
    """All files of the logs that ``expand`` returned."""
    return [path for log in logs for path in inputs_of(log, patterns)]


def find_logs(arguments: Sequence[str], folder: str, suffix: str, patterns: Patterns = ONE_FILE) -> list[Task]:
    """Tasks for the logs that paths, folders and patterns name, sorted by path, each with its own result.

    The folder of the results, a path or a URL, is not searched. With ``patterns``, [log.files] of the setup, a log and
    its result are named after the file of the wrench.

    Raises:
        UsageError: an argument names no log, or two logs would have the same result. LogError: a folder cannot be read,
            or a result would lie outside the folder.
    """
    results = f"{folder.rstrip('/')}/" if is_url(folder) else os.path.realpath(folder)
    named = [_named_by(argument, results, patterns) for argument in arguments]
    found = {os.path.abspath(log): log for _, logs in named for log in logs}
    base = os.path.commonpath([os.path.abspath(root) for root, _ in named])
    tasks: dict[str, Task] = {}
    for path, log in sorted(found.items()):
        place = os.path.abspath(without_credentials(log)) if is_url(log) else path
        name = os.path.relpath(place, base).removesuffix(PACKED)
        output = (os.path.splitext(name)[0] if _is_log(name) else name) + suffix
        check_planned(output, without_credentials(log))
        if output in tasks:
            first, second = map(without_credentials, (tasks[output].log, log))
            message = f"{first!r} and {second!r} would both be written to {output!r}"
            raise UsageError(message, field="LOG", remedy="give them two folders of results")
        tasks[output] = Task(log, output, inputs_of(log, patterns) if patterns else ())
    return list(tasks.values())


def shard(tasks: Sequence[Task], index: int, count: int) -> list[Task]:
    """Share of the logs of machine ``index``, counted from 1, of ``count`` machines."""
    return list(tasks[index - 1 :: count])


def _named_by(argument: str, folder: str, patterns: Patterns) -> tuple[str, list[str]]:
    """Folder relative to which an argument's results are placed, and its logs; no log is an error."""
    root, logs = _logs_of(argument, folder)
    if patterns:
        named = {path: main_file(path, patterns) for path in logs}
        # A path that the user names counts as a log, so that errors are reported; a file that is found need not be one.
        logs = list(dict.fromkeys(log or path for path, log in named.items() if log or path == argument))
    if not logs:
        remedy = "give a log, a folder of logs, or a pattern"
        remedy += f" of files that log.files names: {', '.join(patterns.values())}" if patterns else ""
        raise UsageError(f"no log in {argument!r}", field="LOG", remedy=remedy)
    return root, logs


def _logs_of(argument: str, folder: str) -> tuple[str, list[str]]:
    """Folder relative to which an argument's results are placed, and its logs."""
    if is_url(argument):
        root, slash, _ = without_credentials(argument).partition("*")
        single = not slash and _is_log(root)
        results = (folder, without_credentials(folder)) if is_url(folder) else ()
        found = [argument] if single else [x for x in listed(argument) if _is_log(x) and not x.startswith(results)]
        return os.path.dirname(root) if slash or found == [argument] else root, found
    if not glob.has_magic(argument) or os.path.exists(argument):
        is_log = not os.path.isdir(argument) or _is_bag(argument)
        return (os.path.dirname(os.path.abspath(argument)) if is_log else argument), _walk(argument, folder)
    root = argument
    while glob.has_magic(root):
        root = os.path.dirname(root)
    return root or ".", [log for match in glob.iglob(argument, recursive=True) for log in _walk(match, folder)]


def _walk(path: str, folder: str, seen: set[str] | None = None) -> list[str]:
    """The path if it is a log, else the logs in and below the folder; one that links lead to again is visited once."""
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
    return path.lower().removesuffix(PACKED).endswith((*TABLES, *SUFFIXES))
