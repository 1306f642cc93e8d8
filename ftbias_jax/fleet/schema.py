"""What a line of a manifest may say, checked at one place: a manifest can be damaged, edited or made by somebody else.

Whatever passes here can be compared, drawn, written as a table and shown as a date without further checks.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import PurePath
from typing import Any

from ftbias_jax.fleet.entry import FAILED, LATEST_NS, LOSS, MISTAKES, OK, Entry, LogState, Settings
from ftbias_jax.io.write.provenance import FIRST_DATE, LAST_DATE

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


class BadLine(ValueError):
    """A line is not what the program writes."""


def read_entry(content: Mapping[str, Any]) -> Entry:
    """An entry from plain dicts, lists, numbers and words.

    Args:
        content: fields by name; a field that later versions brought may be missing.

    Raises:
        BadLine: a field is unknown, or its value is not of its kind. TypeError: a required field is missing.
    """
    lists = {name: tuple(_list(content.get(name, []), _text)) for name in ("repairs", "files")}
    state = LogState(**_table(content["state"]))
    _all(state[:3], _count)
    _text(state.sha256)
    entry = Entry(**{**content, **lists, "state": state})
    _all((entry.log, entry.job, entry.error, entry.settings), _text)
    _all((entry.samples, entry.output_bytes), _count)
    _all((entry.seconds, entry.done), _number)
    _need(entry.status in (OK, LOSS, MISTAKES, FAILED))
    _all((entry.output, *_table(entry.sums)), _place)
    _all(entry.sums.values(), _text)
    for name, value in _table(entry.quality).items():
        _need(value is None or _fits(name, value))
    return entry._replace(seconds=float(entry.seconds), done=float(entry.done))


def read_settings(content: Mapping[str, Any]) -> Settings:
    """Settings from plain dicts, lists, numbers and words.

    Raises:
        BadLine: a field is unknown, or its value is not of its kind. TypeError: a required field is missing.
    """
    settings = Settings(**content)
    _all((value for name, value in settings._asdict().items() if name != "choices"), _text)
    for value in _table(settings.choices).values():
        _all(value if isinstance(value, list) else [value], _plain)
    return settings


def _fits(name: str, value: Any) -> bool:
    """Whether a quantity of the quality is of its kind."""
    if name == "date":
        date = datetime.fromisoformat(_text(value))
        date = date if date.tzinfo else date.replace(tzinfo=UTC)
        return FIRST_DATE - 1 < (date - datetime.fromtimestamp(0, UTC)).total_seconds() < LAST_DATE + 1
    if name in VECTORS:
        return len(_list(value, _number_or_none)) == VECTORS[name]
    if name in LISTS:
        return bool(_list(value, _text)) or value == []
    return isinstance(value, str) if name in WORDS else _number(value) is not None


def _need(holds: bool) -> None:
    if not holds:
        raise BadLine


def _all(values: Any, check: Callable[[Any], Any]) -> None:
    for value in values:
        check(value)


def _list(value: Any, check: Callable[[Any], Any]) -> list[Any]:
    _need(isinstance(value, list))
    _all(value, check)
    found: list[Any] = value
    return found


def _table(value: Any) -> dict[str, Any]:
    _need(isinstance(value, dict))
    found: dict[str, Any] = value
    return found


def _text(value: Any) -> str:
    _need(isinstance(value, str))
    return str(value)


def _place(value: Any) -> None:
    """A path that stays inside the folder of results."""
    path = PurePath(_text(value))
    _need(not path.is_absolute() and ".." not in path.parts and "\0" not in value)


def _count(value: Any) -> None:
    _need(type(value) is int and abs(value) <= LATEST_NS)


def _number(value: Any) -> float:
    _need(type(value) in (int, float) and math.isfinite(value) and abs(value) < MOST)
    return float(value)


def _number_or_none(value: Any) -> None:
    if value is not None:
        _number(value)


def _plain(value: Any) -> None:
    if not (value is None or isinstance(value, bool | str)):
        _number(value)
