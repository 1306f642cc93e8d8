"""Alarms of a fleet: a bias that ages, predictions that get worse, causes and mistakes that appear.

A change over many logs raises an alarm only if it exceeds the scatter of the logs.
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
"""Minimum change of a bias that ages, in standard deviations of the bias itself."""
LEAST_WORSE = 1.2
"""Minimum factor by which prediction errors must have grown."""
LEAST_LOGS = 12
"""Minimum number of logs for which a trend is fitted."""
MOST_BINS = 60
"""Maximum number of points of a trend; more logs are reduced to medians, so that single ones do not matter."""
SIGMAS = 5.0
"""Minimum slope in standard errors: many axes are tested, and errors from few logs are themselves poorly known."""
WALKS, WALK_SHARE = 0.5, 0.6
"""Lag-one correlation of the residuals above which they may be a random walk, as biases are, and share of the slope's
standard deviation under such a walk that is then its least standard error. Of 2,000 simulated histories each of white
noise, correlated noise (0.7) and random walks, with 12 to 400 logs, at most 2 in 100 then have a significant slope."""
FEW = 30
"""Number of bins below which a random walk is indistinguishable from other scatter."""
LEAST_GAIN = 3.3
"""Minimum gain, nats, for which something has appeared: 3 logs with it after 2 without, or 2 after 3."""


class Alarm(NamedTuple):
    """One change of one robot and sensor."""

    kind: str
    """Kind of change: "ages", "worse", "appears" or "pooled"."""
    about: str
    """The axis, or the name of the cause."""
    text: str
    """Description in words and numbers."""
    since: float
    """s since 1970, start of the change."""


def alarms_of(records: Sequence[FleetLog], courses: Sequence[Course] = ()) -> list[Alarm]:
    """Alarms of one robot and sensor, from its records in order of time and the causes found in its pooled logs."""
    whole = [record for record in records if record.quality]
    began = [course for course in courses if course.begins != ALL_ALONG]
    pooled = [Alarm("pooled", one.effect, f"logs together show {course_words(one)}", one.since) for one in began]
    return [*_ageing(whole), *_worse(whole), *_appearing(whole), *pooled]


def bias_trend(records: Sequence[FleetLog], axis: int) -> Trend | None:
    """Trend of the bias of an axis, or None if it does not age."""
    bias, std = (values_of(records, name)[:, axis] for name in ("bias", "bias_std"))
    found = trend(dates(records), bias)
    if found is None or not found.is_sure or not np.isfinite(std).any():
        return None
    return found if abs(found.change) > LEAST_BIAS * np.nanmedian(std) else None


def values_of(records: Sequence[FleetLog], name: str) -> Array:
    """(N, 6) values of one quality metric of all logs, by axis."""
    return np.array([record.numbers(name) for record in records]).reshape(-1, 6)


def scalars_of(records: Sequence[FleetLog], name: str) -> Array:
    """(N,) values of one scalar quality metric of all logs."""
    return np.array([record.numbers(name, 1)[0] for record in records])


def dates(records: Sequence[FleetLog]) -> Array:
    """(N,) s since 1970, dates of the logs."""
    return np.array([record.date for record in records])


def size(values: Array) -> Array:
    """(N, 2) norms of force and torque of (N, 6) values by axis."""
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
    """Change from the first to the last log along the line."""
    first: float
    """s, date of the first log."""
    end: float
    """s, date of the last log."""
    start: float
    """Value of the line at the first log."""

    @property
    def is_sure(self) -> bool:
        """Whether the slope exceeds the scatter, even if that is correlated from log to log."""
        return bool(abs(self.slope) > SIGMAS * self.stderr)


def trend(t: Array, y: Array) -> Trend | None:
    """Straight line through medians of neighbouring logs, with a standard error that allows for correlated residuals.

    Logs close in time share temperature and load, so their residuals are correlated; with lag-one correlation r, n of
    them count as n (1 - r) / (1 + r) (Santer et al. 2000). Stamps ``t`` (N,) s are in ascending order; values ``y``
    (N,) may be NaN = unknown. Returns None for too few logs, or if all have the same date.
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
    r = float(np.clip(r + (1 + 4 * r) / count, 0.0, 0.99))  # a fit to n points lowers the correlation by about 1/n
    effective = max(count * (1 - r) / (1 + r), 2.5)
    stderr = float(np.sqrt(square / (effective - 2) / spread))
    if r > WALKS or count < FEW:
        steps = np.diff(m)
        usual = 1.4826 * float(np.median(np.abs(steps - np.median(steps))))  # one jump is not a random walk
        walked = np.sqrt(1.2 * count) * usual / (t[-1] - t[0])
        stderr = max(stderr, WALK_SHARE * walked)
    return Trend(slope, stderr, *line)


def appears(flags: Sequence[bool]) -> int | None:
    """Index of the log at which something appeared; None = it is absent, or has always been present.

    The likeliest split into before and after must gain LEAST_GAIN nats over a common share for all logs. Most logs
    after it and few before it must have the flag, and so must one of the last two logs.
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
    """Maximum log-likelihood, nats, of ``hits`` successes in ``count`` trials."""
    share = np.asarray(hits) / count
    with np.errstate(divide="ignore", invalid="ignore"):
        terms = np.where(share > 0, share * np.log(share), 0) + np.where(share < 1, (1 - share) * np.log1p(-share), 0)
    return np.asarray(count * terms)
