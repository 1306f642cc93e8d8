"""The plots of a diagnosis as SVG, drawn from its result: series are thinned, nothing else is computed."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.report import svg
from ftbias_jax.diagnosis.report.tables import course_words, day, percent, sigmas_by_channel
from ftbias_jax.diagnosis.result import ALL_ALONG, Course, Curve, Gap, Series
from ftbias_jax.types import AXES, AXIS_UNITS

MAX_BUCKETS = 230
"""Segments of a time plot; each shows its smallest and its largest value, so that no peak is lost."""
MAX_NOISE = 60
"""Largest number of points of the noise band, which is smooth."""
MAX_DOTS = 900
MEAN_BINS = 12
NAMES = 158
"""Width of the names of effects in drawing units."""
ROW = 24
"""Drawing units from one horizontal bar to the next."""


def channel_title(channel: int) -> str:
    """Name and unit of a channel, such as "Force x [N]"."""
    return f"{'Force' if channel < 3 else 'Torque'} {'xyz'[channel % 3]} [{AXIS_UNITS[channel]}]"


def plot_gap(gap: Gap, with_after: bool) -> str:
    """Bars of the held-out rms per channel in units of the noise; those after the causes only ``with_after``."""
    before, after = (sigmas_by_channel(rms, gap.noise_floor) for rms in (gap.before_rms, gap.after_rms))
    rows = [*zip(AXES, before, after, strict=True), ("all", gap.before_sigmas, gap.after_sigmas)]
    top = svg.data_range(before, after, np.array([gap.before_sigmas, gap.after_sigmas, 1.0]), zero=True)[1]
    height = len(rows) * (ROW + 6)
    axes = svg.Axes((0.0, max(top, 1.5)), (0.0, 1.0), top=6, width=svg.WIDTH - 46 - 44, height=height)
    parts = [svg.x_axis(axes, "held-out rms in noise sigmas")]
    one = float(axes.across(np.array(1.0)))
    for row, (name, was, now) in enumerate(rows):
        y = axes.top + row * (ROW + 6) + 4
        bars = [("before", was), ("after", now)] if with_after else [("before", was)]
        thickness = 22 / len(bars)
        parts.append(svg.label(axes.left - 8, y + 15, name, "end", "name"))
        for place, (style, value) in enumerate(bars):
            if np.isfinite(value):
                end, below = float(axes.across(np.array(value))), y + place * thickness
                parts.append(svg.box(axes.left, below, end - axes.left, thickness - 1, f"fill-{style}"))
                beside = one if one - 30 < end < one else end  # not on the dashed line
                parts.append(svg.label(beside + 4, below + thickness / 2 + 3.5, f"{value:.2f}"))
    parts.append(svg.line(one, axes.top, one, axes.top + height, "reference"))
    words = "; ".join(f"{name}: {was:.2g} before, {now:.2g} after" for name, was, now in rows)
    return svg.drawing("gap", axes.top + height + 36, "Gap before and after, by channel", words, parts)


def plot_time(series: Series, channel: int, name: str, with_after: bool) -> str:
    """One channel against time, before and after, over the band of noise alone; name: unique in the page."""
    before, after, noise = (part[:, channel] for part in (series.before, series.after, series.noise))
    shown = [("before", before), ("after", after)] if with_after else [("before", before)]
    axes = svg.Axes(_time_range(series.t), svg.data_range(*(y for _, y in shown), 2 * noise, -2 * noise), top=24)
    some = np.unique(np.linspace(0, len(noise) - 1, min(len(noise), MAX_NOISE)).astype(int))  # including both ends
    t, noise = series.t[some], noise[some]
    parts = [
        svg.frame(axes, channel_title(channel), svg.x_axis(axes, "time [s]")),
        svg.band(axes, t, -2 * noise, 2 * noise, "noise"),
        *(svg.curve(axes, *svg.thin(series.t, y, MAX_BUCKETS), f"line-{style}") for style, y in shown),
        *(svg.curve(axes, t, edge * noise, "noise-edge") for edge in (-2, 2)),
    ]
    rms = ", ".join(f"rms {style} {np.sqrt(_mean(y**2)):.3g}" for style, y in shown)
    data = axes.data | {"channel": channel, "name": channel_title(channel)}
    return svg.drawing(name, axes.top + axes.height + 34, f"{channel_title(channel)} against time", rms, parts, **data)


def plot_regressor(series: Sequence[Series]) -> str:
    """Residuals against the regressor of the first cause, in the channel that follows it most."""
    arrays = ((one.regressor, one.whole, one.after, one.noise) for one in series)
    x, before, after, noise = (np.concatenate(parts) for parts in zip(*arrays, strict=True))
    with np.errstate(invalid="ignore", divide="ignore"):
        y = before / noise
    seen = np.isfinite(x)[:, None] & np.isfinite(y)
    follows = np.sum(np.where(seen, (x - np.nanmean(x))[:, None] * y, 0.0), axis=0)
    channel = int(np.argmax(np.abs(follows)))
    lines = {"after": after[:, channel], "before": before[:, channel]}
    words = f"Means of {MEAN_BINS} bins with standard errors; a flat line at zero: nothing is left to explain."
    return _against("regressor", x, series[0].regressor_name, channel_title(channel), lines, words)


def plot_term(found: Curve, name: str) -> str:
    """Residuals against the drive of a term, with the means of the term itself; name: unique in the page."""
    lines = {"before": found.left, "after": found.fitted}
    words = f"Means of {MEAN_BINS} bins with standard errors."
    return _against(name, found.drive, found.drive_name, found.left_name, lines, words)


def plot_course(course: Course, name: str) -> str:
    """The share of a cause against days since the first log, and its onset; name: unique in the page."""
    days, began = ((x - course.dates[0]) / 86400 for x in (course.dates, np.array(course.since)))
    shown = (course.share - course.stderr, course.share + course.stderr)
    axes = svg.Axes(svg.data_range(days), svg.data_range(*shown, zero=True), top=24)
    below = svg.x_axis(axes, f"days since {day(course.dates[0])}")
    parts = [svg.frame(axes, f"{course.effect}, share of what it is in the latest logs", below)]
    parts.append(svg.error_bars(axes, days, course.share, course.stderr, "mean-after"))
    if course.begins != ALL_ALONG:
        x = float(axes.across(began))
        parts.append(svg.line(x, axes.top, x, axes.top + axes.height, "reference"))
    return svg.drawing(name, axes.top + axes.height + 34, f"{course.effect} by date", course_words(course), parts)


def _against(name: str, x: np.ndarray, x_name: str, y_name: str, lines: dict[str, np.ndarray], words: str) -> str:
    """Binned means of the residuals before and after against x, with the single values before as dots."""
    sparse = slice(None, None, max(1, len(x) // MAX_DOTS))
    axes = svg.Axes(svg.data_range(x), svg.data_range(*(y[sparse] for y in lines.values())), top=24, height=190)
    below = svg.x_axis(axes, x_name)
    parts = [svg.frame(axes, y_name, below), svg.dots(axes, x[sparse], lines["before"][sparse], "dots-before")]
    for style, y in lines.items():
        middles, means, errors = svg.binned_means(x, y, MEAN_BINS)
        parts.append(svg.curve(axes, middles, means, f"line-{style} thick"))
        parts.append(svg.error_bars(axes, middles, means, errors, f"mean-{style}"))
    return svg.drawing(name, axes.top + axes.height + 34, f"{y_name} against {x_name}", words, parts)


def plot_shares(shares: dict[str, float]) -> str:
    """Shares by name, which sum to 1, as horizontal bars."""
    height = len(shares) * ROW
    axes = svg.Axes((0.0, 1.0), (0.0, 1.0), top=2, width=svg.WIDTH - 46 - 50, height=height)
    parts = []
    for row, (name, share) in enumerate(shares.items()):
        middle, length = axes.top + (row + 0.5) * ROW, axes.width * float(np.clip(np.nan_to_num(share), 0, 1))
        parts += [
            svg.label(axes.left - 8, middle + 4, name, "end", "name"),
            svg.box(axes.left, middle - 8, axes.width, 16, "fill-rest"),
            svg.box(axes.left, middle - 8, length, 16, "fill-before"),
            svg.label(svg.WIDTH - 4, middle + 4, percent(share), "end"),
        ]
    words = "; ".join(f"{name}: {percent(share)}" for name, share in shares.items())
    return svg.drawing("channels", axes.top + height + 2, "Share of each channel in the gap", words, parts)


class Bar(NamedTuple):
    """One candidate of the ranking."""

    name: str
    nats: float
    """nats/s, held out."""
    stderr: float
    """Standard error of the difference to the best one if compared block by block, else of the gain itself."""
    words: str
    named: bool
    """Whether it is named as a cause, or is the term that was found."""


def plot_ranking(bars: Sequence[Bar]) -> str:
    """Held-out gains of candidates as horizontal bars, best first, with the errors of the differences to the best."""
    gains = np.array([bar.nats for bar in bars])
    errors = np.nan_to_num(np.array([bar.stderr for bar in bars]))
    height = len(bars) * ROW
    x_range = svg.data_range(gains - errors, gains + errors, zero=True)
    axes = svg.Axes(x_range, (0.0, 1.0), left=NAMES, top=4, width=svg.WIDTH - NAMES - 74, height=height)
    parts = [svg.x_axis(axes, "held-out gain [nats/s]")]
    zero = float(axes.across(np.array(0.0)))
    for row, (bar, gain, error) in enumerate(zip(bars, gains, errors, strict=True)):
        middle = axes.top + (row + 0.5) * ROW
        low, end, high = (float(axes.across(np.array(x))) for x in (gain - error, gain, gain + error))
        name, style, fill = (f"● {bar.name}", "name", "fill-after") if bar.named else (bar.name, "", "fill-other")
        parts += [
            svg.label(axes.left - 6, middle + 4, name, "end", style),
            svg.box(min(zero, end), middle - 7, abs(end - zero), 14, fill),
            svg.line(low, middle, high, middle, "whisker"),
            svg.line(low, middle - 4, low, middle + 4, "whisker"),
            svg.line(high, middle - 4, high, middle + 4, "whisker"),
            svg.label(svg.WIDTH - 2, middle + 4, bar.words, "end"),
        ]
    parts.append(svg.line(zero, axes.top, zero, axes.top + height, "axis"))
    words = "; ".join(f"{bar.name}: {bar.words}" for bar in bars)
    return svg.drawing("ranking", axes.top + height + 36, "Held-out gain of the candidates", words, parts)


def _time_range(t: np.ndarray) -> tuple[float, float]:
    return (float(t[0]), float(t[-1])) if len(t) and t[-1] > t[0] else svg.data_range(t)


def _mean(values: np.ndarray) -> float:
    seen = values[np.isfinite(values)]
    return float(seen.mean()) if len(seen) else np.nan
