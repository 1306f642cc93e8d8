"""What a line of a manifest may say, checked at one place: a manifest can be damaged, edited or made by somebody else.

Whatever passes here can be compared, drawn, written as a table and shown as a date without further checks. A check
raises ValueError, TypeError, KeyError, AttributeError or OverflowError on a line that the program does not write.
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
    found: dict[str, Any] = value
    return found


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
    found: dict[str, Any] = value
    return found


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
