"""Manifest entry of one log, and the settings on which its result depends; every line is validated when it is read.

A manifest can be damaged, edited or made by somebody else. Whatever passes validation can be compared, plotted, written
as a table and shown as a date without further checks. Validation raises ValueError, TypeError, KeyError, AttributeError
or OverflowError on a line that this program does not write.
"""

import hashlib
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path, PurePath
from typing import Any, NamedTuple

from ftbias_jax import __version__
from ftbias_jax.io.remote import is_url, size_and_time
from ftbias_jax.io.write.provenance import FIRST_DATE, LAST_DATE, sha256_of, sha256_of_all
from ftbias_jax.setup import Setup, dump_setup

OK, LOSS, MISTAKES, FAILED = "ok", "data loss", "mistakes", "failed"
"""Status of a log; MISTAKES: the check found mistakes in its setup."""
DONE = (OK, LOSS, MISTAKES)
"""Statuses of logs that have a result, which need not be made again."""
LATEST_NS = 2**63 - 1
"""ns since 1970, latest time that tables can hold, in the year 2262; file systems allow owners to set later ones."""


class Settings(NamedTuple):
    """Settings of a run, common to all its logs; the results depend on the first four fields."""

    job: str
    """The command, such as "filter"."""
    setup_sha256: str
    """SHA-256 of the setup, including what it takes from a URDF, without its comments."""
    choices: dict[str, Any]
    """Options of the command, and the SHA-256 of files with the user's own effects."""
    version: str
    setup: str = ""
    """Path of the setup; informative only."""
    robot: str = ""
    """Name of the robot; not part of the key."""
    sensor: str = ""
    """Name of the sensor; not part of the key."""

    @property
    def key(self) -> str:
        """Hash by which the entries of a manifest refer to their settings."""
        text = json.dumps(self[:4], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


class LogState(NamedTuple):
    """State of a log's files, by which a changed log is recognised."""

    bytes: int
    modified_ns: int
    """Time of the last change, ns since 1970; the owner of the file may set it."""
    changed_ns: int
    """Time of the last change of content or name by the operating system's clock, ns since 1970; 0 = unknown."""
    sha256: str
    """SHA-256 of the content; "" = unknown."""


class Entry(NamedTuple):
    """Manifest entry of one log."""

    log: str
    output: str
    """Path of the result relative to the output folder; "" = no result."""
    job: str = "filter"
    status: str = FAILED
    """OK, LOSS, MISTAKES or FAILED."""
    error: str = ""
    """Error message in one line, if the log failed."""
    repairs: tuple[str, ...] = ()
    """Repairs and losses of samples, and findings of the check."""
    samples: int = 0
    """Number of wrench samples."""
    output_bytes: int = 0
    seconds: float = 0.0
    """s, processing time."""
    done: float = 0.0
    """s since 1970, time of completion; of two entries for one result, the later one is valid."""
    state: LogState = LogState(0, 0, 0, "")
    """State of the log when it was read."""
    settings: str = ""
    """``Settings.key`` of the run."""
    quality: Mapping[str, Any] = {}
    """Quality metrics of the log and its model (module ``quality``); {} = unknown."""
    files: tuple[str, ...] = ()
    """Files of the log, if it has several; () = the log itself."""
    sums: Mapping[str, str] = {}
    """Path relative to the output folder -> SHA-256, of every file written for the log; {} = unknown."""


def settings_of(job: str, setup: Setup, choices: Mapping[str, Any], own: Iterable[str] = ()) -> Settings:
    """Settings of a run with plain ``choices`` and ``own`` files of effects; the setup is hashed once for all logs."""
    sums = {f"effects {path}": sha256_of(path) for path in own if Path(path).is_file()}
    setup_sha256 = hashlib.sha256(dump_setup(setup).encode()).hexdigest()
    robot = setup.robot.name or f"{setup.robot.model} ({setup.path})"
    return Settings(job, setup_sha256, {**choices, **sums}, __version__, setup.path, robot, setup.sensor.name or "")


def state_of(paths: Sequence[str]) -> LogState:
    """Total size and latest times of the files of a log, without their SHA-256; a folder stands for its files."""
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
    """Current state of a log if its content is that of an earlier state, else None.

    A file cannot be changed without a new change time of the operating system, so a log with the same times is not
    read. Otherwise it is read, because a copy or a restored backup has other times but the same content.
    """
    if now.bytes != before.bytes:
        return None
    if (now.modified_ns, now.changed_ns) == (before.modified_ns, before.changed_ns):
        return before
    if not before.sha256:  # an earlier version wrote the entry
        return before if now.modified_ns == before.modified_ns and not before.changed_ns else None
    summed = with_sum(now, paths)
    return summed if summed.sha256 == before.sha256 else None


MOST = 1e100
"""Maximum absolute value of other numbers, so that their squares are finite."""
SIX = (
    "one_second_error", "residual_std", "raw_std",
    "bias", "bias_std", "drift", "drift_std",
    "noise_density", "noise_std",
)  # fmt: skip
THREE = ("center_of_mass", "center_of_mass_std")
VECTORS = {**dict.fromkeys(SIX, 6), **dict.fromkeys(THREE, 3)}
"""Quality metrics that are lists of numbers -> their length."""
WORDS = ("verdict", "sentence")
LISTS = ("findings", "causes", "doubtful", "terms")
"""Quality metrics that are lists of strings; all others but WORDS and the date are numbers."""


def read_entry(content: Mapping[str, Any]) -> Entry:
    """Validated entry from plain dicts, lists, numbers and strings; fields that later versions added may be missing."""
    _need("state" in content)
    return Entry(**_checked(content, _ENTRY))


def read_settings(content: Mapping[str, Any]) -> Settings:
    """Validated settings from plain dicts, lists, numbers and strings."""
    return Settings(**_checked(content, _SETTINGS))


def _checked(content: Mapping[str, Any], checks: Mapping[str, Callable[[Any], Any]]) -> dict[str, Any]:
    return {name: checks[name](value) for name, value in content.items()}


def seconds_of(date: str) -> float:
    """Date in ISO 8601 -> s since 1970; UTC if it has no time zone."""
    parsed = datetime.fromisoformat(date)
    return ((parsed if parsed.tzinfo else parsed.replace(tzinfo=UTC)) - datetime.fromtimestamp(0, UTC)).total_seconds()


def _need(holds: bool) -> None:
    if not holds:
        raise ValueError("not what the program writes")


def _text(value: Any) -> str:
    _need(isinstance(value, str))
    return str(value)


def _texts(value: Any) -> tuple[str, ...]:
    _need(isinstance(value, list))
    return tuple(map(_text, value))


def _place(value: Any) -> str:
    """A path that stays inside the folder of results."""
    path = PurePath(_text(value))
    _need(not path.is_absolute() and ".." not in path.parts and "\0" not in value)
    return str(value)


def _count(value: Any) -> int:
    _need(type(value) is int and abs(value) <= LATEST_NS)
    return int(value)


def _number(value: Any) -> float:
    _need(type(value) in (int, float) and math.isfinite(value) and abs(value) < MOST)
    return float(value)


def _status(value: Any) -> str:
    _need(value in (OK, LOSS, MISTAKES, FAILED))
    return str(value)


def _state(value: Any) -> LogState:
    return LogState(**_checked(value, {**dict.fromkeys(LogState._fields, _count), "sha256": _text}))


def _sums(value: Any) -> dict[str, str]:
    return {_place(name): _text(item) for name, item in value.items()}


def _quality(value: Any) -> dict[str, Any]:
    for name, item in value.items():
        if item is not None:
            _quantity(name, item)
    return value


def _quantity(name: str, value: Any) -> None:
    if name == "date":
        _need(FIRST_DATE - 1 < seconds_of(_text(value)) < LAST_DATE + 1)
    elif name in VECTORS:
        _need(isinstance(value, list) and len(value) == VECTORS[name])
        for number in value:
            _need(number is None or math.isfinite(_number(number)))
    else:
        (_texts if name in LISTS else _text if name in WORDS else _number)(value)


def _choices(value: Any) -> dict[str, Any]:
    for choice in value.values():
        for item in choice if isinstance(choice, list) else [choice]:
            _need(item is None or isinstance(item, bool | str) or math.isfinite(_number(item)))
    return value


_SETTINGS: dict[str, Callable[[Any], Any]] = {**dict.fromkeys(Settings._fields, _text), "choices": _choices}
_ENTRY: dict[str, Callable[[Any], Any]] = {
    **dict.fromkeys(("log", "job", "error", "settings"), _text),
    **dict.fromkeys(("samples", "output_bytes"), _count),
    **dict.fromkeys(("seconds", "done"), _number),
    **dict.fromkeys(("repairs", "files"), _texts),
    "output": _place,
    "status": _status,
    "state": _state,
    "quality": _quality,
    "sums": _sums,
}
