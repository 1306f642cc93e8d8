"""Whole archives of logs: which logs there are, what is done already, and the manifest that says so."""

from __future__ import annotations

import glob
import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ftbias_jax import __version__
from ftbias_jax.errors import LogError, UsageError
from ftbias_jax.files import no_regular_file
from ftbias_jax.io import READERS
from ftbias_jax.io.atomic import write_atomic
from ftbias_jax.io.ros.record import PACKED, SUFFIXES
from ftbias_jax.setup import Setup, dump_setup

BAG_FOLDER = "metadata.yaml"
"""A folder with this file is one ROS 2 bag; any other is searched."""
SCHEMA = 1
WAITING, OK, LOSS, FAILED = "waiting", "ok", "data loss", "failed"


class Task(NamedTuple):
    """One log to filter."""

    log: str
    """Its path, as found."""
    output: str
    """Path of the result, from the output folder."""


class Entry(NamedTuple):
    """What the manifest says of one log."""

    log: str
    output: str
    status: str = WAITING
    """WAITING, OK, LOSS or FAILED."""
    error: str = ""
    """One line, if it failed."""
    repairs: tuple[str, ...] = ()
    samples: int = 0
    """Of the result."""
    output_bytes: int = 0
    made_from: Mapping[str, Any] = {}
    """Size and time of the log, and what it was filtered with: another result would come out if this changes."""


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
        root, logs = _logs_of(argument, os.path.realpath(folder))
        if not logs:
            raise UsageError(
                f"no log in {argument!r}", field="LOG", remedy="give a log, a folder of logs, or a pattern"
            )
        roots.append(root)
        found |= {os.path.abspath(log): log for log in logs}
    base = os.path.commonpath([os.path.abspath(root) for root in roots])
    tasks: dict[str, Task] = {}
    for path, log in sorted(found.items()):
        output = _without_suffix(os.path.relpath(path, base)) + suffix
        if output in tasks:
            message = f"{tasks[output].log!r} and {log!r} would both be written to {output!r}"
            raise UsageError(message, field="LOG", remedy="filter them into two folders")
        tasks[output] = Task(log, output)
    return list(tasks.values())


def shard(tasks: Sequence[Task], index: int, count: int) -> list[Task]:
    """The share of one of ``count`` machines, ``index`` from 1."""
    return list(tasks[index - 1 :: count])


def manifest_name(index: int, count: int) -> str:
    """Every machine writes its own, so that none waits for another."""
    return "manifest.json" if count == 1 else f"manifest-{index}-of-{count}.json"


def hashes(own: Iterable[str]) -> dict[str, str]:
    """What results depend on of the files of effects of one's own; {} without any."""
    files = [Path(path) for path in own if Path(path).is_file()]
    return {f"effects {path}": hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def provenance(task: Task, setup: Setup, choices: Mapping[str, Any]) -> dict[str, Any]:
    """What a result is made from; the setup with all that it takes from a URDF."""
    files = sorted(path for path in Path(task.log).rglob("*") if path.is_file()) or [Path(task.log)]
    states = [path.stat() for path in files if path.exists()]
    return {
        "log_bytes": sum(state.st_size for state in states),
        "log_modified_ns": max((state.st_mtime_ns for state in states), default=0),
        "setup_sha256": hashlib.sha256(dump_setup(setup).encode()).hexdigest(),
        "choices": dict(choices),
        "version": __version__,
    }


def done_before(folder: str) -> dict[str, list[Entry]]:
    """Results that are there, by their paths, as manifests in a folder say; unreadable manifests say nothing."""
    known: dict[str, list[Entry]] = {}
    for path in sorted(Path(folder).glob("manifest*.json")):
        for entry in _read_manifest(path):
            output = Path(folder) / entry.output
            if entry.status in (OK, LOSS) and output.is_file() and output.stat().st_size == entry.output_bytes:
                known.setdefault(entry.output, []).append(entry)
    return known


def save_manifest(path: str, entries: Iterable[Entry]) -> None:
    """Write the manifest, whole or not at all; the same entries give the same bytes.

    Raises:
        OutputError: it cannot be written.
    """
    content = {"schema": SCHEMA, "logs": [entry._asdict() for entry in entries]}
    write_atomic(path, lambda file: file.write(json.dumps(content, indent=1).encode() + b"\n"))


def _read_manifest(path: Path) -> Iterator[Entry]:
    try:
        content = json.loads("" if no_regular_file(path) else path.read_text())
        entries = [Entry(**fields) for fields in content["logs"]] if content["schema"] == SCHEMA else []
        yield from (entry._replace(repairs=tuple(entry.repairs)) for entry in entries)
    except (OSError, ValueError, TypeError, KeyError):
        return


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
