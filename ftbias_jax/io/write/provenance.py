"""Provenance of a result: program, setup, robot, logs and options. The same inputs give the same text."""

import hashlib
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ftbias_jax import __version__
from ftbias_jax.errors import LogError
from ftbias_jax.files import no_regular_file
from ftbias_jax.io.health import sample_rate
from ftbias_jax.io.log import Log
from ftbias_jax.io.remote import exists, is_url, sha256_of_url, without_credentials
from ftbias_jax.io.tables.poses import Poses
from ftbias_jax.io.tables.streams import inputs_of
from ftbias_jax.setup.dump import dump_setup
from ftbias_jax.setup.types import SCREWS, Setup
from ftbias_jax.types import Array

FIRST_DATE, LAST_DATE = 946684800.0, 4102444800.0
"""s since 1970, the years 2000 and 2100: only stamps between them are dates; other clocks start anywhere."""

Provenance = dict[str, Any]
"""Provenance as stored in JSON."""


class Source(NamedTuple):
    """One log from which a result was made."""

    file: str
    """Its path; "" = from memory."""
    wrench_t: Array
    """(W,) s, stamps of the wrench."""
    start: float
    """s, stamp of the first sample, to be added to the stamps."""


def source_of(log: Log | Poses, path: str = "") -> Source:
    """Source of a log in memory; for static poses, ``path`` is their file."""
    if isinstance(log, Poses):
        return Source(path, log.t, 0.0)
    return Source(log.file, log.t[~np.isnan(log.wrench).all(1)], log.start)


def provenance(
    setup: Setup, sources: Sequence[Source], options: Mapping[str, Any], names: Sequence[str] = ()
) -> Provenance:
    """Provenance of a result of these logs: plain dicts for JSON.

    It contains the version, the date (of the first log's start by its own stamps, None if these are no dates), the
    setup and the logs with the SHA-256 of their files (None if from memory; for a log of several files that of all
    together, and of each separately as "files"), the robot, the options, and over all logs their duration in s, mean
    rate in Hz and number of samples of the wrench. ``names`` are those of the logs; () = their files' names.
    """
    logs = [_of_log(source, setup.log.files) for source in sources]
    for log, name in zip(logs, names, strict=bool(names)):
        log["name"] = name
    # Hash of the text that was read, not of the file as it is now; a setup made in a program has no such text.
    text = (setup.source or dump_setup(setup)).encode()
    built_in = setup.robot.model if setup.robot.model != SCREWS else ""
    return {
        "version": __version__,
        "date": logs[0]["date"] if logs else None,
        "setup": {"name": os.path.basename(setup.path), "sha256": hashlib.sha256(text).hexdigest()},
        "urdf": _of_file(setup.description) if setup.description else None,
        "robot": built_in or f"{len(setup.robot.joint_names)} joints",
        "logs": logs,
        "duration": sum(log["duration"] for log in logs),
        "rate": float(np.mean([log["rate"] or 0.0 for log in logs])) if logs else 0.0,
        "samples": sum(log["samples"] for log in logs),
        "options": dict(options),
    }


def as_text(origin: Provenance) -> str:
    """Provenance as JSON on one line."""
    return json.dumps(origin, allow_nan=False)


def in_words(origin: Provenance) -> str:
    """Provenance as one line for a comment in a file."""
    setup, logs = origin["setup"], ", ".join(log["name"] for log in origin["logs"])
    name = setup["name"] or "a setup in memory"
    return f"by ftbias_jax {origin['version']} from {logs} with {name}, sha256 {setup['sha256']}"


def sha256_of(path: str) -> str | None:
    """SHA-256 of a file; for a folder, which is a recording, that of the checksums of its files by name.

    None if it cannot be read any more: a result in memory may outlive the file of its log.
    """
    try:
        if is_url(path):
            return sha256_of_url(path)
        if os.path.isdir(path):
            files = sorted(file for file in Path(path).iterdir() if file.is_file() and not no_regular_file(file))
            return _sum_of_sums(map(os.fspath, files))
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except (OSError, LogError):
        return None


def sha256_of_all(paths: Sequence[str]) -> str | None:
    """SHA-256 of a log: of its file, or of the checksums of its files by name; None if one cannot be read any more."""
    if len(paths) == 1:
        return sha256_of(paths[0])
    return _sum_of_sums(paths) if all(map(exists, paths)) else None


def _sum_of_sums(files: Iterable[str]) -> str:
    lines = "".join(f"{sha256_of(file)}  {os.path.basename(file)}\n" for file in files)
    return hashlib.sha256(lines.encode()).hexdigest()


def _of_file(path: str) -> dict[str, Any]:
    name = without_credentials(path) if is_url(path) else os.path.basename(os.path.normpath(path))
    return {"name": name, "sha256": sha256_of(path)}


def _of_log(source: Source, patterns: Mapping[str, str]) -> dict[str, Any]:
    t, rate = source.wrench_t, sample_rate(source.wrench_t)
    first = source.start + float(t[0]) if len(t) else 0.0
    dated = FIRST_DATE < first < LAST_DATE
    date = datetime.fromtimestamp(round(first, 3), UTC).isoformat(timespec="milliseconds") if dated else None
    file: dict[str, Any] = _of_file(source.file) if source.file else {"name": "", "sha256": None}
    paths = inputs_of(source.file, patterns)
    if len(paths) > 1:
        file |= {"sha256": sha256_of_all(paths), "files": [_of_file(path) for path in paths]}
    duration = float(t[-1] - t[0]) if len(t) else 0.0
    return {**file, "date": date, "duration": duration, "rate": rate if np.isfinite(rate) else None, "samples": len(t)}
