"""Figures of a filtered log. Needs matplotlib, the extra 'plot'."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ftbias_jax.errors import OutputError
from ftbias_jax.types import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ftbias_jax.filtering.result import Filtered

COLORS = ("#0072B2", "#D55E00", "#009E73")
"""Okabe and Ito's blue, vermilion and green: told apart by colour-blind readers."""
MARKS = ("-", "--", ":")
FORMATS = ("png", "svg", "pdf")
MAX_POINTS = 4000
"""A figure has about a thousand pixels across; more points cost time and change nothing."""


def plot_filtered(filtered: Filtered, title: str, true_bias: Array | None = None) -> Figure:
    """Bias with its 2 sigma band, and what the corrected wrench leaves beyond the tool model.

    Args:
        filtered: what ``filter_with_params`` or ``filter_log`` gives.
        title: above the figure.
        true_bias: (T, 6) N, Nm if it is known.
    """
    figure = new_figure()
    axes = figure.subplots(2, 2, sharex=True)
    # The first samples, in which the bias is still unknown, would set the scale of everything.
    known = (filtered.bias_std < 10 * np.median(filtered.bias_std, 0)).all(1).nonzero()[0]
    thin = known[:: max(1, len(known) // MAX_POINTS)]
    t = filtered.t[thin] - filtered.t[0]
    residual = filtered.wrench_unbiased - filtered.wrench_tool
    for column, (name, unit, rows) in enumerate((("force", "N", slice(0, 3)), ("torque", "Nm", slice(3, 6)))):
        top, bottom = axes[0, column], axes[1, column]
        top.set(title=f"Bias, {name}", ylabel=f"bias [{unit}]")
        bottom.set(title=f"Corrected wrench - tool model, {name}", ylabel=f"residual [{unit}]", xlabel="time [s]")
        if true_bias is not None:
            top.plot(t, true_bias[thin, rows], color="0.75", linewidth=5, label=["truth", None, None])
        _lines(top, t, filtered.bias[thin, rows], 2 * filtered.bias_std[thin, rows])
        _lines(bottom, t, residual[thin, rows], None)
        bottom.axhline(0, color="black", linewidth=0.6)
        top.legend(loc="best", fontsize=8, ncols=2)
    figure.suptitle(title, fontsize=11)
    return figure


def save_figure(path: str, figure: Figure) -> None:
    """Write a figure atomically, in the format that its suffix names."""
    from ftbias_jax.io.atomic import write_atomic

    suffix = figure_format(path)
    write_atomic(path, lambda file: figure.savefig(file, format=suffix, dpi=150))


def figure_format(path: str) -> str:
    """The format that the suffix of a path names: png, svg or pdf."""
    suffix = path.rsplit(".", 1)[-1].lower()
    if suffix not in FORMATS:
        raise OutputError(f"cannot draw a '.{suffix}' file", file=path, remedy="end the name in .png, .svg or .pdf")
    return suffix


def new_figure() -> Figure:
    """An empty figure.

    Raises:
        OutputError: matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise OutputError(
            "drawing needs matplotlib, which is not installed", remedy="pip install 'ftbias-jax[plot]'"
        ) from error
    return Figure(figsize=(11, 6.5), layout="constrained")


def _lines(axes: Axes, t: Array, values: Array, band: Array | None) -> None:
    for i, axis in enumerate("xyz"):
        style: dict[str, Any] = {"color": COLORS[i], "linestyle": MARKS[i], "linewidth": 1.1}
        axes.plot(t, values[:, i], label=axis, **style)
        if band is not None:
            axes.fill_between(t, values[:, i] - band[:, i], values[:, i] + band[:, i], color=COLORS[i], alpha=0.2, lw=0)
    axes.grid(color="0.9", linewidth=0.6)
