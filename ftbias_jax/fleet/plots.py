"""Plots of a fleet's page as SVG: quantities and causes against the date."""

from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np

from ftbias_jax.diagnosis.report import svg
from ftbias_jax.diagnosis.report.tables import day
from ftbias_jax.fleet.alarms import MOST_BINS, Trend
from ftbias_jax.types import Array

SECONDS = {"m": 60.0, "h": 3600.0, "D": 86400.0, "M": 365.25 * 86400 / 12}
"""NumPy's unit of time -> its length, s."""
STEPS = (
    (1, "m", "%H:%M"), (5, "m", "%H:%M"), (15, "m", "%H:%M"), (1, "h", "%H:%M"), (4, "h", "%d. %H:%M"),
    (12, "h", "%d. %H:%M"), (1, "D", "%m-%d"), (2, "D", "%m-%d"), (7, "D", "%m-%d"), (14, "D", "%m-%d"),
    (1, "M", "%Y-%m"), (2, "M", "%Y-%m"), (3, "M", "%Y-%m"), (6, "M", "%Y-%m"),
    (12, "M", "%Y"), (24, "M", "%Y"), (60, "M", "%Y"), (120, "M", "%Y"),
)  # fmt: skip
"""Intervals between ticks, number and unit, with the format of their labels."""
WITH_BARS = 80
"""Maximum number of logs that are drawn with an error bar each."""
MOST_DOTS = 400
MARK_ROW = 22


def plot_history(
    name: str, title: str, t: Array, y: Array, error: Array | None = None, line_of: Trend | None = None
) -> str:
    """Plot a quantity of every log against its date: dots with error bars, or dots and medians of many logs.

    ``name`` is unique in the page, and ``title`` has the unit. Dates ``t`` (N,) are s since 1970; values ``y`` (N,) and
    their standard deviations ``error`` (N,) may be NaN = unknown. The trend ``line_of`` is drawn dashed.
    """
    seen = np.isfinite(y)
    t, y = t[seen], y[seen]
    few = len(t) <= WITH_BARS
    bars = error[seen] if few and error is not None else np.zeros(len(t))
    axes = svg.Axes(_span(t), svg.data_range(y - bars, y + bars), top=24)
    parts = [svg.frame(axes, title, _dates(axes))]
    if few:
        parts.append(svg.error_bars(axes, t, y, bars, "mean-after"))
    else:
        parts.append(svg.dots(axes, *svg.thin(t, y, MOST_DOTS // 2), "dots-after"))
        groups = np.array_split(np.arange(len(t)), MOST_BINS)
        middles, medians = (np.array([np.median(values[group]) for group in groups]) for values in (t, y))
        parts.append(svg.curve(axes, middles, medians, "line-after thick"))
    if line_of is not None:
        ends = np.array([line_of.first, line_of.end])
        parts.append(svg.curve(axes, ends, line_of.start + np.array([0.0, line_of.change]), "trend"))
    words = f"{len(t)} logs from {day(t[0])} to {day(t[-1])}, median {np.median(y):.3g}" if len(t) else "no log"
    return svg.drawing(name, axes.top + axes.height + 22, f"{title} by date", words, parts)


def plot_marks(name: str, title: str, t: Array, rows: Sequence[tuple[str, Array]]) -> str:
    """Plot findings by date: one row per name, with marks at the dates ``t`` (N,), s since 1970, of flagged logs."""
    axes = svg.Axes(_span(t), (0.0, 1.0), left=130, top=4, width=svg.WIDTH - 130 - 10, height=MARK_ROW * len(rows))
    parts = [_dates(axes)]
    for number, (words, flags) in enumerate(rows):
        middle = axes.top + (number + 0.5) * MARK_ROW
        parts.append(svg.line(axes.left, middle, axes.left + axes.width, middle, "grid"))
        parts.append(
            svg.label(axes.left - 6, middle + 4, words if len(words) < 22 else f"{words[:20]}…", "end", "name")
        )
        places = sorted({round(float(x), 1) for x in axes.across(t[np.asarray(flags, bool)])})
        parts += [svg.line(x, middle - 7, x, middle + 7, "mark") for x in places]
    said = "; ".join(f"{words}: {int(np.sum(flags))} of {len(t)} logs" for words, flags in rows)
    return svg.drawing(name, axes.top + axes.height + 22, title, said, parts)


def date_ticks(low: float, high: float, most: int) -> list[tuple[float, str]]:
    """About ``most`` round dates or fewer, from low to high, s since 1970, with their labels (UTC)."""
    fitting = (step for step in STEPS if (high - low) / (step[0] * SECONDS[step[1]]) <= most)
    count, unit, form = next(fitting, STEPS[-1])
    first, last = (int(np.datetime64(int(stamp), "s").astype(f"M8[{unit}]").astype(int)) for stamp in (low, high))
    dates = count * np.arange(first // count, last // count + 1)
    stamps = dates.astype(f"M8[{unit}]").astype("M8[s]").astype(int).tolist()
    shown = (stamp for stamp in stamps if low <= stamp <= high)
    return [(float(stamp), datetime.fromtimestamp(stamp, UTC).strftime(form)) for stamp in shown]


def _dates(axes: svg.Axes) -> str:
    """Date axis below the plot, which takes 22 drawing units."""
    bottom, right = axes.top + axes.height, axes.left + axes.width
    parts = [svg.line(axes.left, bottom, right, bottom, "axis")]
    for stamp, words in date_ticks(*axes.x, max(round(axes.width / 62), 1)):
        x = float(axes.across(np.array(stamp)))
        parts.append(svg.line(x, bottom, x, bottom + 4, "axis"))
        if axes.left + 16 < x < right - 12:
            parts.append(svg.label(x, bottom + 15, words, "middle"))
    return "".join(parts)


def _span(t: Array) -> tuple[float, float]:
    """Range of the dates with a margin, s since 1970; a day around a single date."""
    if not len(t):
        return 0.0, SECONDS["D"]
    margin = 0.03 * (t[-1] - t[0]) or SECONDS["D"] / 2
    return float(t[0] - margin), float(t[-1] + margin)
