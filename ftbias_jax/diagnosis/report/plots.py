"""The plots of a diagnosis as SVG. What is in the result is drawn: series are thinned, nothing else is computed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ftbias_jax.diagnosis.report.plotted import Curve, Series
from ftbias_jax.diagnosis.report.svg import (
    WIDTH,
    Axes,
    band,
    box,
    curve,
    data_range,
    dots,
    drawing,
    error_bars,
    frame,
    label,
    line,
    x_axis,
)
from ftbias_jax.diagnosis.report.tables import percent, sigmas_by_channel
from ftbias_jax.diagnosis.result import Gap
from ftbias_jax.types import AXES, AXIS_UNITS

MAX_BUCKETS = 230
"""Pieces of a time plot; each shows its smallest and its largest value, so that no peak is lost."""
MAX_NOISE = 60
"""Points of the band of noise, which is smooth."""
MAX_DOTS = 900
MEAN_BINS = 12
NAMES = 158
"""Drawing units for the names of effects."""
ROW = 24
"""Drawing units from one horizontal bar to the next."""


def channel_title(channel: int) -> str:
    """Such as "Force x [N]"."""
    return f"{'Force' if channel < 3 else 'Torque'} {'xyz'[channel % 3]} [{AXIS_UNITS[channel]}]"


def plot_gap(gap: Gap, with_after: bool) -> str:
    """Bars of the held-out rms by channel in units of the noise.

    Args:
        gap: of the diagnosis.
        with_after: whether there is a cause, and so an after.
    """
    before, after = (sigmas_by_channel(rms, gap.noise_floor) for rms in (gap.before_rms, gap.after_rms))
    rows = [*zip(AXES, before, after, strict=True), ("all", gap.before_sigmas, gap.after_sigmas)]
    top = data_range(before, after, np.array([gap.before_sigmas, gap.after_sigmas, 1.0]), zero=True)[1]
    height = len(rows) * (ROW + 6)
    axes = Axes((0.0, max(top, 1.5)), (0.0, 1.0), top=6, width=WIDTH - 46 - 44, height=height)
    parts = [x_axis(axes, "held-out rms in noise sigmas")]
    one = float(axes.across(np.array(1.0)))
    for row, (name, was, now) in enumerate(rows):
        y = axes.top + row * (ROW + 6) + 4
        bars = [("before", was), ("after", now)] if with_after else [("before", was)]
        thickness = 22 / len(bars)
        parts.append(label(axes.left - 8, y + 15, name, "end", "name"))
        for place, (style, value) in enumerate(bars):
            if np.isfinite(value):
                end, below = float(axes.across(np.array(value))), y + place * thickness
                parts.append(box(axes.left, below, end - axes.left, thickness - 1, f"fill-{style}"))
                beside = one if one - 30 < end < one else end  # not on the dashed line
                parts.append(label(beside + 4, below + thickness / 2 + 3.5, f"{value:.2f}"))
    parts.append(line(one, axes.top, one, axes.top + height, "reference"))
    words = "; ".join(f"{name}: {was:.2g} before, {now:.2g} after" for name, was, now in rows)
    return drawing("gap", axes.top + height + 36, "Gap before and after, by channel", words, parts)


def plot_time(series: Series, channel: int, name: str, with_after: bool) -> str:
    """One channel against time, before and after, over the band that noise alone would fill.

    Args:
        series: of one log.
        channel: 0 to 5.
        name: of the drawing, unique in the page.
        with_after: draw the after too.
    """
    before, after, noise = (part[:, channel] for part in (series.before, series.after, series.noise))
    shown = [("before", before), ("after", after)] if with_after else [("before", before)]
    axes = Axes(_time_range(series.t), data_range(*(y for _, y in shown), 2 * noise, -2 * noise), top=24)
    some = np.unique(np.linspace(0, len(noise) - 1, min(len(noise), MAX_NOISE)).astype(int))  # with both ends
    t, noise = series.t[some], noise[some]
    parts = [
        frame(axes, "time [s]", channel_title(channel)),
        band(axes, t, -2 * noise, 2 * noise, "noise"),
        *(curve(axes, *thin(series.t, y, MAX_BUCKETS), f"line-{style}") for style, y in shown),
        *(curve(axes, t, edge * noise, "noise-edge") for edge in (-2, 2)),
    ]
    rms = ", ".join(f"rms {style} {np.sqrt(_mean(y**2)):.3g}" for style, y in shown)
    data = {**axes.data, "channel": channel, "name": channel_title(channel)}
    return drawing(name, axes.top + axes.height + 34, f"{channel_title(channel)} against time", rms, parts, data)


def plot_regressor(series: Sequence[Series], channel: int) -> str:
    """What is left in one channel against the quantity that the first cause acts through, with means of bins.

    Args:
        series: of all logs.
        channel: 0 to 5.
    """
    x = np.concatenate([one.regressor for one in series])
    before = np.concatenate([one.whole[:, channel] for one in series])
    after = np.concatenate([one.after[:, channel] for one in series])
    sparse = slice(None, None, max(1, len(x) // MAX_DOTS))
    axes = Axes(data_range(x), data_range(before[sparse], after[sparse]), top=24, height=190)
    parts = [
        frame(axes, series[0].regressor_name, channel_title(channel)),
        dots(axes, x[sparse], before[sparse], "dots-before"),
    ]
    for style, y in (("after", after), ("before", before)):
        middles, means, errors = binned_means(x, y, MEAN_BINS)
        parts.append(curve(axes, middles, means, f"line-{style} thick"))
        parts.append(error_bars(axes, middles, means, errors, f"mean-{style}"))
    words = f"Means of {MEAN_BINS} bins with standard errors; a flat line at zero: nothing is left to explain."
    title = f"{channel_title(channel)} against {series[0].regressor_name}"
    return drawing("regressor", axes.top + axes.height + 34, title, words, parts)


def plot_term(found: Curve, name: str) -> str:
    """What was left against the drive of a term, with the means of the term itself.

    Args:
        found: of the term.
        name: unique in the page.
    """
    sparse = slice(None, None, max(1, len(found.drive) // MAX_DOTS))
    axes = Axes(data_range(found.drive), data_range(found.left[sparse], found.fitted[sparse]), top=24, height=190)
    parts = [
        frame(axes, found.drive_name, found.left_name),
        dots(axes, found.drive[sparse], found.left[sparse], "dots-before"),
    ]
    for style, y in (("before", found.left), ("after", found.fitted)):
        middles, means, errors = binned_means(found.drive, y, MEAN_BINS)
        parts.append(curve(axes, middles, means, f"line-{style} thick"))
        parts.append(error_bars(axes, middles, means, errors, f"mean-{style}"))
    title = f"{found.left_name} against {found.drive_name}"
    return drawing(name, axes.top + axes.height + 34, title, f"Means of {MEAN_BINS} bins with standard errors.", parts)


def plot_shares(shares: dict[str, float]) -> str:
    """Shares that sum to 1 as horizontal bars.

    Args:
        shares: name -> share.
    """
    height = len(shares) * ROW
    axes = Axes((0.0, 1.0), (0.0, 1.0), top=2, width=WIDTH - 46 - 50, height=height)
    parts = []
    for row, (name, share) in enumerate(shares.items()):
        middle, length = axes.top + (row + 0.5) * ROW, axes.width * float(np.clip(np.nan_to_num(share), 0, 1))
        parts += [
            label(axes.left - 8, middle + 4, name, "end", "name"),
            box(axes.left, middle - 8, axes.width, 16, "fill-rest"),
            box(axes.left, middle - 8, length, 16, "fill-before"),
            label(WIDTH - 4, middle + 4, percent(share), "end"),
        ]
    words = "; ".join(f"{name}: {percent(share)}" for name, share in shares.items())
    return drawing("channels", axes.top + height + 2, "Share of each channel in the gap", words, parts)


def thin(t: np.ndarray, y: np.ndarray, buckets: int) -> tuple[np.ndarray, np.ndarray]:
    """At most two points a bucket: its smallest and its largest value, in the order of time; NaN where all is NaN.

    Args:
        t: (B,) s.
        y: (B,) values, NaN = none.
        buckets: how many.
    """
    if len(t) <= 2 * buckets:
        return t, y
    kept: list[int] = []
    for part in np.array_split(np.arange(len(t)), buckets):
        seen = part[np.isfinite(y[part])]
        kept += sorted({seen[np.argmin(y[seen])], seen[np.argmax(y[seen])]}) if len(seen) else [part[0]]
    return t[kept], y[kept]


def binned_means(x: np.ndarray, y: np.ndarray, bins: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Middles, means of y and their standard errors, in bins of x that hold equally many points.

    Args:
        x: (N,) abscissae.
        y: (N,) values.
        bins: at most how many.
    """
    kept = np.isfinite(x) & np.isfinite(y)
    order = np.argsort(x[kept], kind="stable")
    parts = [part for part in np.array_split(order, bins) if len(part) > 1]
    columns = [(x[kept][p].mean(), y[kept][p].mean(), y[kept][p].std(ddof=1) / np.sqrt(len(p))) for p in parts]
    middles, means, errors = np.array(columns).reshape(-1, 3).T
    return middles, means, errors


def _time_range(t: np.ndarray) -> tuple[float, float]:
    return (float(t[0]), float(t[-1])) if len(t) and t[-1] > t[0] else data_range(t)


def _mean(values: np.ndarray) -> float:
    seen = values[np.isfinite(values)]
    return float(seen.mean()) if len(seen) else float("nan")
