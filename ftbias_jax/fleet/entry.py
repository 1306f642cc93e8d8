"""What the manifest says about one log, and what a result depends on; a line is checked when it is read.

A manifest can be damaged, edited or made by somebody else. Whatever passes here can be compared, drawn, written as a
table and shown as a date without further checks. A check raises ValueError, TypeError, KeyError, AttributeError or
OverflowError on a line that the program does not write.
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


MOST = 1e100
"""Of other numbers, so that their squares are numbers, too."""
SIX = (
    "one_second_error", "residual_std", "raw_std",
    "bias", "bias_std", "drift", "drift_std",
    "noise_density", "noise_std",
)  # fmt: skip
THREE = ("center_of_mass", "center_of_mass_std")
VECTORS = {**dict.fromkeys(SIX, 6), **dict.fromkeys(THREE, 3)}
"""Quantities of a log's quality that are lists of so many numbers."""
WORDS = ("verdict", "sentence")
LISTS = ("findings", "causes", "doubtful", "terms")
"""Quantities that are lists of words; all others but the date are numbers."""


def read_entry(content: Mapping[str, Any]) -> Entry:
    """An entry from plain dicts, lists, numbers and words; a field that later versions brought may be missing."""
    _need("state" in content)
    return Entry(**_checked(content, _ENTRY))


def read_settings(content: Mapping[str, Any]) -> Settings:
    """Settings from plain dicts, lists, numbers and words."""
    return Settings(**_checked(content, _SETTINGS))


def _checked(content: Mapping[str, Any], checks: Mapping[str, Callable[[Any], Any]]) -> dict[str, Any]:
    return {name: checks[name](value) for name, value in content.items()}


def seconds_of(date: str) -> float:
    """s since 1970 of a date in ISO 8601."""
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
