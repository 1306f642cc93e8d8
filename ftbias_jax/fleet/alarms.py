"""What somebody should look at: a bias that ages, predictions that get worse, causes and mistakes that appear.

Changes over many logs count where they are more than their scatter.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.report.tables import course_words, day
from ftbias_jax.diagnosis.result import ALL_ALONG, Course
from ftbias_jax.fleet.history import FleetLog
from ftbias_jax.types import AXES, AXIS_UNITS, Array

MONTH = 30 * 86400.0
LEAST_BIAS = 3.0
"""Standard deviations of the bias itself that it must have changed by."""
LEAST_WORSE = 1.2
"""Factor by which errors of prediction must have grown."""
LEAST_LOGS = 12
"""That a trend is looked for in."""
MOST_BINS = 60
"""Medians of more logs are fitted, so that single ones do not matter."""
SIGMAS = 5.0
"""Standard errors from which a slope is one: many axes are looked at, and errors of few logs are not well known."""
WALKS, WALK_SHARE = 0.5, 0.6
"""Correlation of neighbouring residuals from which they may be a random walk, as biases are, and share of SIGMAS that a
slope must then have of what such a walk makes by itself. Of 2,000 made histories each of white noise, of correlated
noise (0.7) and of random walks, with 12 to 400 logs, at most 2 in 100 have a slope then."""
FEW = 30
"""Bins in which a random walk is indistinguishable from other scatter."""
LEAST_GAIN = 3.3
"""nats from which something has appeared: 3 logs with it after 2 without, 2 after 3."""


class Alarm(NamedTuple):
    """One change of one robot and sensor."""

    kind: str
    """"ages", "worse", "appears" or "pooled"."""
    about: str
    """The axis, or the name of the cause."""
    text: str
    """In words and numbers."""
    since: float
    """s since 1970."""


def alarms_of(records: Sequence[FleetLog], courses: Sequence[Course] = ()) -> list[Alarm]:
    """The alarms of one robot and sensor, whose records are in the order of time, and its causes of pooled logs."""
    whole = [record for record in records if record.quality]
    began = [course for course in courses if course.begins != ALL_ALONG]
    pooled = [Alarm("pooled", one.effect, f"logs together show {course_words(one)}", one.since) for one in began]
    return [*_ageing(whole), *_worse(whole), *_appearing(whole), *pooled]


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
    for some, field, kind in ((diagnosed, "causes", "cause"), (checked, "findings", "mistake")):
        for name in dict.fromkeys(name for record in some for name in record.words(field)):
            yield from _from(some, [name in record.words(field) for record in some], name, f"the {kind} {name} appears")
    unknown = [record.verdict in ("unknown", "partly_explained") for record in diagnosed]
    yield from _from(diagnosed, unknown, "unexplained gap", "a gap that no cause explains appears")


def _from(records: Sequence[FleetLog], flags: Sequence[bool], name: str, words: str) -> Iterator[Alarm]:
    first = appears(flags)
    if first is not None:
        before, after = (f"{sum(part)} of {len(part)}" for part in (flags[:first], flags[first:]))
        text = f"{words} on {day(records[first].date)}: in {before} logs before, in {after} since"
        yield Alarm("appears", name, text, records[first].date)


class Trend(NamedTuple):
    """A straight line through a quantity over time."""

    slope: float
    """Units of the quantity per second."""
    stderr: float
    change: float
    """From the first to the last log along the line."""
    first: float
    """s, the first log."""
    end: float
    """s, the last log."""
    start: float
    """The line's value at the first log."""

    @property
    def is_sure(self) -> bool:
        """Whether it is more than scatter, also if that is correlated from log to log."""
        return bool(abs(self.slope) > SIGMAS * self.stderr)


def trend(t: Array, y: Array) -> Trend | None:
    """The line through medians of neighbouring logs; its error grows with what its residuals have in common.

    Neighbours in time have the same temperature and the same load, so their residuals are correlated; with correlation
    r from one to the next, n of them count as n (1 - r) / (1 + r) (Santer et al. 2000). Stamps (N,) s are in order;
    values (N,) may be NaN, not known. None of too few logs, or if all are of one time.
    """
    seen = np.isfinite(t) & np.isfinite(y)
    t, y = t[seen], y[seen]
    if len(t) < LEAST_LOGS or t[-1] <= t[0]:
        return None
    parts = np.array_split(np.arange(len(t)), min(MOST_BINS, len(t)))
    x, m = (np.array([np.median(values[part]) for part in parts]) for values in (t, y))
    count, centred = len(x), x - x.mean()
    spread = float(centred @ centred)
    slope = float(centred @ m) / spread
    left = m - m.mean() - slope * centred
    square = float(left @ left)
    line = slope * (t[-1] - t[0]), t[0], t[-1], float(m.mean() + slope * (t[0] - x.mean()))
    if square <= 0:
        return Trend(slope, 0.0, *line)
    r = float(left[1:] @ left[:-1]) / square
    r = float(np.clip(r + (1 + 4 * r) / count, 0.0, 0.99))  # what is fitted to n points is less correlated by 1/n
    effective = max(count * (1 - r) / (1 + r), 2.5)
    stderr = float(np.sqrt(square / (effective - 2) / spread))
    if r > WALKS or count < FEW:
        steps = np.diff(m)
        usual = 1.4826 * float(np.median(np.abs(steps - np.median(steps))))  # one jump makes no walk
        walked = np.sqrt(1.2 * count) * usual / (t[-1] - t[0])
        stderr = max(stderr, WALK_SHARE * walked)
    return Trend(slope, stderr, *line)


def appears(flags: Sequence[bool]) -> int | None:
    """From which log on something is there that was not there before; None = it is not, or it has always been.

    The split into before and after that makes the flags likeliest must beat one share for all by LEAST_GAIN nats, most
    logs after it and few before it must have the flag, and so must the last one or the one before.
    """
    values = np.asarray(flags, bool)
    count = len(values)
    if count < 4 or not values[-2:].any():
        return None
    before = np.cumsum(values)[:-1]
    sizes = np.arange(1, count)
    after = values.sum() - before
    gains = _nats(before, sizes) + _nats(after, count - sizes) - _nats(values.sum(), count)
    rising = (after / (count - sizes) > 0.5) & (before / sizes < 0.2) & (after >= 2)
    gains = np.where(rising, gains, -np.inf)
    best = int(np.argmax(gains))
    return best + 1 if gains[best] > LEAST_GAIN else None


def _nats(hits: Array, count: Array) -> Array:
    """Largest log-likelihood of so many hits."""
    share = np.asarray(hits) / count
    with np.errstate(divide="ignore", invalid="ignore"):
        terms = np.where(share > 0, share * np.log(share), 0) + np.where(share < 1, (1 - share) * np.log1p(-share), 0)
    return np.asarray(count * terms)
