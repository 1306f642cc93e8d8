"""Small drawings as SVG text: axes, lines, bands, points and bars. Colours are classes of the page's style sheet."""

import html
import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

WIDTH = 360
"""Width of every drawing in drawing units: that of a phone's screen, so that letters keep their size there."""


class Axes(NamedTuple):
    """A plotting area in drawing units and the data ranges it shows."""

    x: tuple[float, float]
    y: tuple[float, float]
    left: float = 46
    top: float = 12
    width: float = WIDTH - 46 - 10
    height: float = 130

    @property
    def data(self) -> dict[str, object]:
        """Attributes for the page's script: left, top, width and height."""
        numbers = (self.left, self.top, self.width, self.height)
        return {"axes": " ".join(f"{number:.6g}" for number in numbers)}

    def across(self, values: np.ndarray) -> np.ndarray:
        """Convert x from data to drawing units."""
        low, high = self.x
        return self.left + self.width * (np.asarray(values, float) - low) / (high - low)

    def down(self, values: np.ndarray) -> np.ndarray:
        """Convert y from data to drawing units, which SVG counts downwards."""
        low, high = self.y
        return self.top + self.height * (high - np.asarray(values, float)) / (high - low)


def escape(text: object) -> str:
    """Text with markup escaped and control characters replaced; safe in attributes too."""
    visible = "".join(c if c.isprintable() or c == "\n" else "\N{REPLACEMENT CHARACTER}" for c in str(text))
    return html.escape(visible, quote=True)


def drawing(name: str, height: float, title: str, description: str, parts: Iterable[str], /, **data: object) -> str:
    """A whole drawing of SVG elements, already escaped, with a plain-text title and description for screen readers.

    The name, unique in the page, has letters, digits and hyphens; data are attributes for the page's script.
    """
    further = "".join(f' data-{key}="{escape(value)}"' for key, value in data.items())
    return (
        f'<svg viewBox="0 0 {WIDTH} {height:g}" role="img" aria-labelledby="{name}-t {name}-d"{further}>'
        f'<title id="{name}-t">{escape(title)}</title><desc id="{name}-d">{escape(description)}</desc>'
        f"{''.join(parts)}</svg>"
    )


def label(x: float, y: float, text: str, anchor: str = "start", style: str = "") -> str:
    """Text at a point."""
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" class="{style}">{escape(text)}</text>'


def line(x1: float, y1: float, x2: float, y2: float, style: str) -> str:
    """A straight line in drawing units."""
    return f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" class="{style}"/>'


def box(x: float, y: float, width: float, height: float, style: str) -> str:
    """A rectangle in drawing units."""
    return f'<rect x="{x:.1f}" y="{y:.1f}" width="{max(width, 0):.1f}" height="{height:.1f}" class="{style}"/>'


def curve(axes: Axes, x: np.ndarray, y: np.ndarray, style: str) -> str:
    """A polyline through the data, broken where it is not finite."""
    points = np.column_stack([axes.across(x), axes.down(y)])
    runs = np.split(points, np.flatnonzero(~np.isfinite(points).all(axis=1)))
    pieces = (_steps(run[np.isfinite(run).all(axis=1)]) for run in runs)
    return f'<path class="{style}" d="{"".join(pieces)}"/>'


def band(axes: Axes, x: np.ndarray, low: np.ndarray, high: np.ndarray, style: str) -> str:
    """The area between two curves; points that are not finite are left out."""
    kept = np.isfinite(x) & np.isfinite(low) & np.isfinite(high)
    outline = np.r_[np.c_[x, low][kept], np.c_[x, high][kept][::-1]]
    return f'<path class="{style}" d="{_steps(np.c_[axes.across(outline[:, 0]), axes.down(outline[:, 1])])}Z"/>'


def _steps(points: np.ndarray) -> str:
    """Path commands through (N, 2) points, in short relative steps of a tenth of a unit."""
    if not len(points):
        return ""
    tenths = np.round(10 * points).astype(int)
    steps = np.diff(tenths, axis=0) / 10
    return f"M{tenths[0, 0] / 10:g} {tenths[0, 1] / 10:g}l" + " ".join(f"{x:g} {y:g}" for x, y in steps)


def dots(axes: Axes, x: np.ndarray, y: np.ndarray, style: str) -> str:
    """A cloud of points as one path; the style sheet gives its round stroke."""
    points = np.column_stack([axes.across(x), axes.down(y)])
    marks = "".join(f"M{a:.1f} {b:.1f}h0" for a, b in points[np.isfinite(points).all(axis=1)])
    return f'<path class="{style}" d="{marks}"/>'


def error_bars(axes: Axes, x: np.ndarray, y: np.ndarray, error: np.ndarray, style: str) -> str:
    """Markers with vertical error bars."""
    kept = np.isfinite(x) & np.isfinite(y) & np.isfinite(error)
    across, low, high = axes.across(x[kept]), axes.down((y - error)[kept]), axes.down((y + error)[kept])
    bars = "".join(line(a, b, a, c, style) for a, b, c in zip(across, low, high, strict=True))
    middles = zip(across, axes.down(y[kept]), strict=True)
    return bars + "".join(f'<circle cx="{a:.1f}" cy="{b:.1f}" r="3" class="{style}"/>' for a, b in middles)


def frame(axes: Axes, y_name: str, below: str) -> str:
    """Horizontal grid lines with their labels, the name of the values, and the axis below, such as ``x_axis``."""
    right, values = axes.left + axes.width, ticks(*axes.y, round(axes.height / 26))
    parts = [label(2, axes.top - 10, y_name, "start", "name")]
    for value, y in zip(values, axes.down(np.array(values)), strict=True):
        parts += [line(axes.left, y, right, y, "grid"), label(axes.left - 5, y + 3.5, tick_words(value, values), "end")]
    return "".join([*parts, below])


def x_axis(axes: Axes, name: str) -> str:
    """The horizontal axis below the plotting area; it takes 34 drawing units."""
    bottom, right = axes.top + axes.height, axes.left + axes.width
    values = ticks(*axes.x, round(axes.width / 50))
    parts = [line(axes.left, bottom, right, bottom, "axis"), label(right, bottom + 30, name, "end", "name")]
    for value, x in zip(values, axes.across(np.array(values)), strict=True):
        parts += [line(x, bottom, x, bottom + 4, "axis"), label(x, bottom + 15, tick_words(value, values), "middle")]
    return "".join(parts)


def ticks(low: float, high: float, count: int) -> list[float]:
    """At most ``count`` + 1 round numbers from low to high."""
    rough = (high - low) / max(count, 1)
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(factor * power for factor in (1, 2, 5, 10) if factor * power >= rough * (1 - 1e-9))
    return [float(step * i) for i in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)]


def tick_words(tick: float, all_ticks: Sequence[float]) -> str:
    """A tick with as many decimals as the step needs, and a minus sign that is as wide as a digit."""
    step = all_ticks[1] - all_ticks[0] if len(all_ticks) > 1 else abs(tick) or 1.0
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    largest = max(abs(t) for t in all_ticks)
    text = f"{tick:.{decimals}f}" if decimals <= 4 and largest < 1e5 else f"{tick:.2g}"
    return text.replace("-", "\N{MINUS SIGN}") if float(text) else "0"


def data_range(*series: np.ndarray, zero: bool = False) -> tuple[float, float]:
    """A range that holds all finite values of arrays, and 0 if it must, with a small margin; never empty."""
    values = np.concatenate([np.ravel(part) for part in series] + [np.zeros(int(zero))])
    values = values[np.isfinite(values)]
    if not len(values):
        return -1.0, 1.0
    low, high = float(values.min()), float(values.max())
    margin = 0.05 * (high - low) if high > low else abs(high) / 2 or 1.0
    return low - margin, high + margin


def thin(t: np.ndarray, y: np.ndarray, buckets: int) -> tuple[np.ndarray, np.ndarray]:
    """The smallest and the largest value (B,) of every bucket, in the order of time; NaN where all values are NaN."""
    if len(t) <= 2 * buckets:
        return t, y
    kept: list[int] = []
    for part in np.array_split(np.arange(len(t)), buckets):
        seen = part[np.isfinite(y[part])]
        kept += sorted({seen[np.argmin(y[seen])], seen[np.argmax(y[seen])]}) if len(seen) else [part[0]]
    return t[kept], y[kept]


def binned_means(x: np.ndarray, y: np.ndarray, bins: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Middles, means of y (N,) and their standard errors, in bins of x (N,) that hold equally many points."""
    kept = np.isfinite(x) & np.isfinite(y)
    order = np.argsort(x[kept], kind="stable")
    parts = [part for part in np.array_split(order, bins) if len(part) > 1]
    columns = [(x[kept][p].mean(), y[kept][p].mean(), y[kept][p].std(ddof=1) / np.sqrt(len(p))) for p in parts]
    middles, means, errors = np.array(columns).reshape(-1, 3).T
    return middles, means, errors
