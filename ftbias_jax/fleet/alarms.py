"""What somebody should look at: a bias that ages, predictions that get worse, causes and mistakes that appear."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np

from ftbias_jax.fleet.history import FleetLog
from ftbias_jax.fleet.trends import Trend, appears, trend
from ftbias_jax.types import AXES, AXIS_UNITS, Array

MONTH = 30 * 86400.0
LEAST_BIAS = 3.0
"""Standard deviations of the bias itself that it must have changed by."""
LEAST_WORSE = 1.2
"""Factor by which errors of prediction must have grown."""


class Alarm(NamedTuple):
    """One change of one robot and sensor."""

    kind: str
    """"ages", "worse" or "appears"."""
    about: str
    """The axis, or the name of the cause."""
    text: str
    """In words and numbers."""
    since: float
    """s since 1970."""


def alarms_of(records: Sequence[FleetLog]) -> list[Alarm]:
    """The alarms of one robot and sensor.

    Args:
        records: in the order of time.
    """
    whole = [record for record in records if record.quality]
    return [*_ageing(whole), *_worse(whole), *_appearing(whole)]


def bias_trend(records: Sequence[FleetLog], axis: int) -> Trend | None:
    """The trend of the bias of an axis, if it ages."""
    bias, std = (values_of(records, name)[:, axis] for name in ("bias", "bias_std"))
    found = trend(dates(records), bias)
    if found is None or not found.is_sure or not np.isfinite(std).any():
        return None
    return found if abs(found.change) > LEAST_BIAS * np.nanmedian(std) else None


def values_of(records: Sequence[FleetLog], name: str) -> Array:
    """(N, 6) numbers of the quality of all logs."""
    return np.array([record.numbers(name) for record in records]).reshape(-1, 6)


def scalars_of(records: Sequence[FleetLog], name: str) -> Array:
    """(N,) numbers of the quality of all logs."""
    return np.array([record.numbers(name, 1)[0] for record in records])


def dates(records: Sequence[FleetLog]) -> Array:
    """(N,) s since 1970."""
    return np.array([record.date for record in records])


def size(values: Array) -> Array:
    """(N, 2) sizes of force and torque of (N, 6) numbers by axis."""
    return np.stack([np.sqrt((values[:, axes] ** 2).sum(1)) for axes in (slice(0, 3), slice(3, 6))], 1)


def day(date: float) -> str:
    """Such as 2026-03-14."""
    return datetime.fromtimestamp(date, UTC).strftime("%Y-%m-%d")


def _ageing(records: Sequence[FleetLog]) -> Iterator[Alarm]:
    for axis, unit in enumerate(AXIS_UNITS):
        found = bias_trend(records, axis)
        if found is not None:
            rate = f"{MONTH * found.slope:+.2g} ± {MONTH * found.stderr:.1g} {unit} in 30 days"
            text = f"the bias of {AXES[axis]} ages: {rate}, {found.change:+.2g} {unit} since {day(found.first)}"
            yield Alarm("ages", AXES[axis], text, found.first)


def _worse(records: Sequence[FleetLog]) -> Iterator[Alarm]:
    errors = size(values_of(records, "one_second_error"))
    for column, name in enumerate(("force", "torque")):
        with np.errstate(divide="ignore", invalid="ignore"):
            found = trend(dates(records), np.log(errors[:, column]))
        if found is not None and found.is_sure and found.change > np.log(LEAST_WORSE):
            factor = np.exp(found.change)
            text = f"the {name} is predicted worse: {factor:.2g} times the error one second ahead of the first logs"
            yield Alarm("worse", name, text, found.first)


def _appearing(records: Sequence[FleetLog]) -> Iterator[Alarm]:
    diagnosed = [record for record in records if record.verdict]
    checked = [record for record in records if "findings" in record.quality]
    kinds = (
        (diagnosed, "causes", "the cause {} appears"),
        (checked, "findings", "the mistake {} appears"),
    )
    for some, field, words in kinds:
        for name in dict.fromkeys(name for record in some for name in record.words(field)):
            yield from _from(some, [name in record.words(field) for record in some], name, words.format(name))
    unknown = [record.verdict in ("unknown", "partly_explained") for record in diagnosed]
    yield from _from(diagnosed, unknown, "unexplained gap", "a gap that no cause explains appears")


def _from(records: Sequence[FleetLog], flags: Sequence[bool], name: str, words: str) -> Iterator[Alarm]:
    first = appears(flags)
    if first is not None:
        before, after = (f"{sum(part)} of {len(part)}" for part in (flags[:first], flags[first:]))
        text = f"{words} on {day(records[first].date)}: in {before} logs before, in {after} since"
        yield Alarm("appears", name, text, records[first].date)
