"""What the manifest says about one log, and what a result depends on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ftbias_jax import __version__
from ftbias_jax.io.remote import is_url, size_and_time
from ftbias_jax.io.write.provenance import sha256_of, sha256_of_all
from ftbias_jax.setup import Setup, dump_setup

OK, LOSS, MISTAKES, FAILED = "ok", "data loss", "mistakes", "failed"
"""What became of a log; MISTAKES: the check found some in its setup."""
DONE = (OK, LOSS, MISTAKES)
"""There is a result, which need not be made again."""
LATEST_NS = 2**63 - 1
"""ns since 1970, the year 2262: what tables can hold. File systems know later times, which owners may set."""


class Settings(NamedTuple):
    """What all logs of a run are worked on with; another result would come out if the first four changed."""

    job: str
    """The command, such as "filter"."""
    setup_sha256: str
    """Of the setup with all that it takes from a URDF, and without its comments."""
    choices: dict[str, Any]
    """Options of the command, and the sums of files with effects of one's own."""
    version: str
    setup: str = ""
    """Path of the setup, for readers."""
    robot: str = ""
    """Which robot it is, for readers."""
    sensor: str = ""
    """Which sensor it is, for readers."""

    @property
    def key(self) -> str:
        """By which the entries of a manifest name their settings."""
        text = json.dumps(self[:4], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


class LogState(NamedTuple):
    """By what one sees that a log is another one than before."""

    bytes: int
    modified_ns: int
    """Time of its last change, as its owner may set it."""
    changed_ns: int
    """Time of the last change of it or of its name, by the operating system's clock; 0 = not known."""
    sha256: str
    """Of its content; "" = not known."""


class Entry(NamedTuple):
    """What the manifest says about one log."""

    log: str
    output: str
    """Path of the result, from the output folder; "" of a log that has none."""
    job: str = "filter"
    status: str = FAILED
    """OK, LOSS, MISTAKES or FAILED."""
    error: str = ""
    """One line, if it failed."""
    repairs: tuple[str, ...] = ()
    """What was mended or left out, and what the check says."""
    samples: int = 0
    """Of the wrench."""
    output_bytes: int = 0
    seconds: float = 0.0
    """That it took."""
    done: float = 0.0
    """s since 1970 when it was done; of two entries for one result the later one holds."""
    state: LogState = LogState(0, 0, 0, "")
    """Of the log when it was read."""
    settings: str = ""
    """``Settings.key``."""
    quality: Mapping[str, Any] = {}
    """How good the log and its model are (``quality``); {} = not known."""
    files: tuple[str, ...] = ()
    """Its files, if it has several; () = the log itself."""
    sums: Mapping[str, str] = {}
    """SHA-256 of every file that was written for it, by its path from the output folder; {} = not known."""


def settings_of(job: str, setup: Setup, choices: Mapping[str, Any], own: Iterable[str] = ()) -> Settings:
    """What a run works with, plain ``choices`` and ``own`` effects in files; the setup is hashed once for all logs."""
    sums = {f"effects {path}": sha256_of(path) for path in own if Path(path).is_file()}
    setup_sha256 = hashlib.sha256(dump_setup(setup).encode()).hexdigest()
    robot = setup.robot.name or f"{setup.robot.model} ({setup.path})"
    return Settings(job, setup_sha256, {**choices, **sums}, __version__, setup.path, robot, setup.sensor.name or "")


def state_of(paths: Sequence[str]) -> LogState:
    """Size and times of the files of a log together, without their sum; a folder stands for its files."""
    there = [size_and_time(path) for path in paths if is_url(path)]
    local = [Path(path) for path in paths if not is_url(path)]
    files = [file for path in local for file in (path.rglob("*") if path.is_dir() else [path])]
    states = [file.stat() for file in files if file.is_file()]
    return LogState(
        sum(state.st_size for state in states) + sum(size for size, _ in there),
        min(max((*(state.st_mtime_ns for state in states), *(at for _, at in there)), default=0), LATEST_NS),
        max((state.st_ctime_ns for state in states), default=0),
        "",
    )


def with_sum(state: LogState, paths: Sequence[str]) -> LogState:
    """The state with the SHA-256 of the log's content."""
    return state._replace(sha256=sha256_of_all(paths) or "")


def is_same(before: LogState, now: LogState, paths: Sequence[str]) -> LogState | None:
    """The state of a log as it is now, if its content is that of an earlier state; None if it is another.

    Nobody can change a file and keep the operating system's time of change, so a log with the same times is not read.
    With others it is: a copy or a restored backup has other times and the same content.
    """
    if now.bytes != before.bytes:
        return None
    if (now.modified_ns, now.changed_ns) == (before.modified_ns, before.changed_ns):
        return before
    if not before.sha256:  # of a manifest without sums
        return before if now.modified_ns == before.modified_ns and not before.changed_ns else None
    summed = with_sum(now, paths)
    return summed if summed.sha256 == before.sha256 else None
