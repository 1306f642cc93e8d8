"""Figures of a filtered log. Needs matplotlib, the extra 'plot'."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ftbias_jax.errors import OutputError
from ftbias_jax.io.atomic import write_atomic
from ftbias_jax.types import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ftbias_jax.filtering.result import Filtered

BLUE, ORANGE, GREEN = "#0072B2", "#D55E00", "#009E73"
"""Blue, vermilion and green by Okabe and Ito, distinguishable by colour-blind readers."""
BANDS = (
    "Bands: ± 2 standard deviations (95 %). Of the bias: given the readings so far, with the errors of the tool that "
    "the setup states. Dashed: of one reading, by its noise and the bias's error together."
)
FORMATS = ("png", "svg", "pdf")
MAX_POINTS = 4000
"""A figure has about a thousand pixels across; more points cost time and change nothing."""


def plot_filtered(filtered: Filtered, title: str, true_bias: Array | None = None) -> Figure:
    """One panel per axis: the bias with its 2 sigma band, and below it the corrected wrench minus the tool model.

    The band of this residual is what noise and the bias's own error fill in 95 % of the samples; samples not used
    (gated, or something touched the tool) are marked. The true bias is (T, 6) N, Nm if it is known.
    """
    figure = new_figure()
    axes = figure.subplots(4, 3, sharex=True)
    # The first samples, in which the bias is still unknown, would set the scale of everything.
    known = (filtered.bias_std < 10 * np.median(filtered.bias_std, 0)).all(1).nonzero()[0]
    thin = known[:: max(1, len(known) // MAX_POINTS)]
    t = filtered.t[thin] - filtered.t[0]
    residual = (filtered.wrench_unbiased - filtered.wrench_tool)[thin]
    noise = filtered.innovation_std if filtered.reading_std is None else filtered.reading_std
    noise = np.hypot(noise[thin], filtered.bias_std[thin])
    left_out = np.zeros(len(t), bool) if filtered.used is None else ~np.asarray(filtered.used, bool)[thin]
    for channel in range(6):
        kind, unit = ("force", "N") if channel < 3 else ("torque", "Nm")
        above, below = axes[channel // 3 * 2 : channel // 3 * 2 + 2, channel % 3]
        name = f"{kind} {'xyz'[channel % 3]}"
        above.set(title=f"Bias, {name}", ylabel=f"bias [{unit}]")
        below.set(title=f"Corrected - tool model, {name}", ylabel=f"residual [{unit}]")
        if true_bias is not None:
            above.plot(t, true_bias[thin, channel], color="0.75", linewidth=5, label="truth")
        bias, std = filtered.bias[thin, channel], filtered.bias_std[thin, channel]
        above.plot(t, bias, color=BLUE, linewidth=1.1, label="bias")
        above.fill_between(t, bias - 2 * std, bias + 2 * std, color=BLUE, alpha=0.2, lw=0, label="± 2 std")
        kept = np.where(left_out, np.nan, residual[:, channel])
        below.plot(t, kept, color=BLUE, linewidth=0.7, label="used")
        if left_out.any():
            marks = residual[left_out, channel]
            below.plot(t[left_out], marks, ".", color=ORANGE, markersize=2, label="not used")
        for side in (-2, 2):
            label = "± 2 std of noise" if side > 0 else None
            below.plot(t, side * noise[:, channel], color=GREEN, linewidth=1.2, linestyle="--", label=label)
        for panel in (above, below):
            panel.grid(color="0.9", linewidth=0.6)
    for panel in axes[:2, 0]:
        panel.legend(loc="best", fontsize=8, ncols=3)
    for panel in axes[3]:
        panel.set_xlabel("time [s]")
    figure.suptitle(title, fontsize=11)
    figure.supxlabel(BANDS, fontsize=8)
    return figure


def save_figure(path: str, figure: Figure) -> None:
    """Write a figure atomically, in the format that its suffix names."""
    suffix = figure_format(path)
    origin = {"Software" if suffix == "png" else "Creator": "ftbias_jax"}
    write_atomic(path, lambda file: figure.savefig(file, format=suffix, dpi=150, metadata=origin))


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
    return Figure(figsize=(12, 10), layout="constrained")
