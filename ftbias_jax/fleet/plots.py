"""The plots of a fleet's page as SVG: quantities and causes against the date."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np

from ftbias_jax.diagnosis.report.svg import (
    WIDTH,
    Axes,
    curve,
    data_range,
    dots,
    drawing,
    error_bars,
    label,
    line,
    thin,
    tick_words,
    ticks,
)
from ftbias_jax.fleet.alarms import day
from ftbias_jax.fleet.trends import MOST_BINS, Trend
from ftbias_jax.types import Array

MINUTE, HOUR, DAY, YEAR = 60, 3600, 86400, 365.25 * 86400
STEPS = (
    (MINUTE, "%H:%M"), (5 * MINUTE, "%H:%M"), (15 * MINUTE, "%H:%M"), (HOUR, "%H:%M"), (4 * HOUR, "%d. %H:%M"),
    (12 * HOUR, "%d. %H:%M"), (DAY, "%m-%d"), (2 * DAY, "%m-%d"), (7 * DAY, "%m-%d"), (14 * DAY, "%m-%d"),
)  # fmt: skip
"""s between ticks, and how they are written."""
MONTHS = (1, 2, 3, 6, 12, 24, 60, 120)
WITH_BARS = 80
"""Logs up to which each has an error bar."""
MOST_DOTS = 400
MARK_ROW = 22


def plot_history(
    name: str, title: str, t: Array, y: Array, error: Array | None = None, line_of: Trend | None = None
) -> str:
    """A quantity of every log against its date: dots with error bars, or dots and medians where there are many.

    Args:
        name: unique in the page.
        title: with the unit.
        t: (N,) s since 1970.
        y: (N,), NaN = not known.
        error: (N,) its standard deviation; None = not known.
        line_of: drawn dashed.
    """
    seen = np.isfinite(y)
    t, y = t[seen], y[seen]
    few = len(t) <= WITH_BARS
    bars = error[seen] if few and error is not None else np.zeros(len(t))
    axes = Axes(_span(t), data_range(y - bars, y + bars), top=24)
    parts = [_frame(axes, title)]
    if few:
        parts.append(error_bars(axes, t, y, bars, "mean-after"))
    else:
        parts.append(dots(axes, *thin(t, y, MOST_DOTS // 2), "dots-after"))
        groups = np.array_split(np.arange(len(t)), MOST_BINS)
        middles, medians = (np.array([np.median(values[group]) for group in groups]) for values in (t, y))
        parts.append(curve(axes, middles, medians, "line-after thick"))
    if line_of is not None:
        ends = np.array([line_of.first, line_of.end])
        parts.append(curve(axes, ends, line_of.start + np.array([0.0, line_of.change]), "trend"))
    words = f"{len(t)} logs from {day(t[0])} to {day(t[-1])}, median {np.median(y):.3g}" if len(t) else "no log"
    return drawing(name, axes.top + axes.height + 22, f"{title} by date", words, parts)


def plot_marks(name: str, title: str, t: Array, rows: Sequence[tuple[str, Array]]) -> str:
    """In which logs something was found: a row each, with a mark at the date of every log that has it.

    Args:
        name: unique in the page.
        title: of the drawing.
        t: (N,) s since 1970.
        rows: names, and (N,) whether the log has it.
    """
    axes = Axes(_span(t), (0.0, 1.0), left=130, top=4, width=WIDTH - 130 - 10, height=MARK_ROW * len(rows))
    parts = [_dates(axes)]
    for number, (words, flags) in enumerate(rows):
        middle = axes.top + (number + 0.5) * MARK_ROW
        parts.append(line(axes.left, middle, axes.left + axes.width, middle, "grid"))
        parts.append(label(axes.left - 6, middle + 4, words if len(words) < 22 else f"{words[:20]}…", "end", "name"))
        places = sorted({round(float(x), 1) for x in axes.across(t[np.asarray(flags, bool)])})
        parts += [line(x, middle - 7, x, middle + 7, "mark") for x in places]
    said = "; ".join(f"{words}: {int(np.sum(flags))} of {len(t)} logs" for words, flags in rows)
    return drawing(name, axes.top + axes.height + 22, title, said, parts)


def date_ticks(low: float, high: float, most: int) -> list[tuple[float, str]]:
    """At most about so many round dates from low to high, s since 1970, and how they are written (UTC)."""
    for step, form in STEPS:
        if (high - low) / step <= most:
            stamps = step * np.arange(np.ceil(low / step), np.floor(high / step) + 1)
            return [(float(stamp), datetime.fromtimestamp(stamp, UTC).strftime(form)) for stamp in stamps]
    months = next((x for x in MONTHS if (high - low) / (x * YEAR / 12) <= most), MONTHS[-1])
    found = []
    first = datetime.fromtimestamp(low, UTC)
    for number in range(12 * first.year, 12 * first.year + 12 * int((high - low) / YEAR + 2)):
        if number % months == 0:
            date = datetime(number // 12, number % 12 + 1, 1, tzinfo=UTC)
            if low <= date.timestamp() <= high:
                found.append((date.timestamp(), date.strftime("%Y" if months >= 12 else "%Y-%m")))
    return found


def _frame(axes: Axes, title: str) -> str:
    """The grid with the values, the dates and the title."""
    right, values = axes.left + axes.width, ticks(*axes.y, round(axes.height / 26))
    parts = [label(2, axes.top - 10, title, "start", "name")]
    for value, y in zip(values, axes.down(np.array(values)), strict=True):
        parts += [line(axes.left, y, right, y, "grid"), label(axes.left - 5, y + 3.5, tick_words(value, values), "end")]
    return "".join([*parts, _dates(axes)])


def _dates(axes: Axes) -> str:
    """The axis below the plot; it takes 22 drawing units."""
    bottom, right = axes.top + axes.height, axes.left + axes.width
    parts = [line(axes.left, bottom, right, bottom, "axis")]
    for stamp, words in date_ticks(*axes.x, max(round(axes.width / 62), 1)):
        x = float(axes.across(np.array(stamp)))
        parts.append(line(x, bottom, x, bottom + 4, "axis"))
        if axes.left + 16 < x < right - 12:
            parts.append(label(x, bottom + 15, words, "middle"))
    return "".join(parts)


def _span(t: Array) -> tuple[float, float]:
    """Of dates, with a margin; a day around a single one."""
    if not len(t):
        return 0.0, float(DAY)
    margin = 0.03 * (t[-1] - t[0]) or DAY / 2
    return float(t[0] - margin), float(t[-1] + margin)
