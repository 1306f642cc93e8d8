"""HTML page of one filtered log: the bias with its error, the residual of the corrected wrench, and the provenance."""

import json
from collections.abc import Mapping

import numpy as np

from ftbias_jax.diagnosis.report.page import html_table, section, typeset, whole_page
from ftbias_jax.diagnosis.report.plots import MAX_BUCKETS, channel_title
from ftbias_jax.diagnosis.report.svg import Axes, band, curve, data_range, drawing, escape, frame, thin, x_axis
from ftbias_jax.errors import LogError
from ftbias_jax.io.tables.array_files import load_arrays
from ftbias_jax.model.effects.statements import value_words
from ftbias_jax.types import AXES, AXIS_UNITS, Array

NEEDED = ("t", "bias", "bias_std", "wrench_unbiased", "wrench_tool")
OPTIONAL = ("used", "provenance")
BAND = "Band: ± 2 standard deviations of the bias, given the readings so far and the errors of the tool as stated."


def read_result(path: str) -> dict[str, Array]:
    """Read the arrays of a result that the page shows.

    Raises:
        LogError: the file cannot be read, or is not a complete result.
    """
    arrays = load_arrays(path, (*NEEDED, *OPTIONAL))
    rows = np.shape(arrays.get("t", 0))
    for name in NEEDED:
        shape = rows if name == "t" else (*rows, len(AXES))
        if name not in arrays or len(rows) != 1 or np.shape(arrays[name]) != shape or not rows[0]:
            remedy = "give what ftbias filter wrote as .npz, with all of these fields"
            raise LogError(f"is no result: it needs {', '.join(NEEDED)}", file=path, field=name, remedy=remedy)
    return arrays


def result_page(arrays: Mapping[str, Array], title: str) -> str:
    """HTML page of the arrays that ``read_result`` returned."""
    t, bias, std = (np.asarray(arrays[name], float) for name in ("t", "bias", "bias_std"))
    left = np.asarray(arrays["wrench_unbiased"], float) - np.asarray(arrays["wrench_tool"], float)
    used = np.asarray(arrays.get("used", np.ones(len(t))), bool)
    ends = [
        f"{value_words(float(b), float(s))} {unit}" for b, s, unit in zip(bias[-1], std[-1], AXIS_UNITS, strict=True)
    ]
    head = f"Bias at the end: fx {ends[0]}, fy {ends[1]}, fz {ends[2]}; {100 * used.mean():.0f} % of the samples used"
    with np.errstate(invalid="ignore"):
        spread = np.sqrt(np.nanmean(left**2, 0))
    rows = [
        (channel_title(i), ends[i].rpartition(" ")[0], f"{np.ptp(bias[:, i]):.3g}", f"{spread[i]:.3g}")
        for i in range(len(AXES))
    ]
    table = html_table(("channel", "bias at the end", "range of the bias", "corrected - tool model, rms"), rows)
    plots = "".join(f"<figure>{_plot(t - t[0], bias[:, i], std[:, i], i)}</figure>" for i in range(len(AXES)))
    return whole_page(
        title,
        f"<header><p class='small'>{escape(title)}</p><h1>{typeset(head)}</h1></header>"
        + section("Channel by channel", table)
        + section("The bias over time", f"<p class='small'>{BAND}</p><div class='grid'>{plots}</div>")
        + section("Where this comes from", html_table(("what", "value"), _origin(arrays))),
    )


def _plot(t: Array, bias: Array, std: Array, channel: int) -> str:
    known = std < 10 * np.nanmedian(std)  # otherwise the first samples would set the scale
    t, bias, std = t[known], bias[known], std[known]
    axes = Axes((float(t[0]), float(max(t[-1], t[0] + 1e-9))), data_range(bias - 2 * std, bias + 2 * std), top=24)
    some = np.unique(np.linspace(0, len(t) - 1, min(len(t), MAX_BUCKETS)).astype(int))
    parts = [
        frame(axes, channel_title(channel), x_axis(axes, "time [s]")),
        band(axes, t[some], (bias - 2 * std)[some], (bias + 2 * std)[some], "noise"),
        curve(axes, *thin(t, bias, MAX_BUCKETS), "line-after"),
    ]
    words = f"from {bias[0]:.3g} to {bias[-1]:.3g} {AXIS_UNITS[channel]}"
    return drawing(f"bias-{channel}", axes.top + axes.height + 34, f"Bias, {channel_title(channel)}", words, parts)


def _origin(arrays: Mapping[str, Array]) -> list[tuple[str, str]]:
    """Rows with the provenance of a result; empty if it cannot be read."""
    try:
        origin = json.loads(str(arrays["provenance"]))
        logs = ", ".join(str(log["name"]) for log in origin["logs"])
        rows = [("ftbias_jax", origin["version"]), ("log", logs), ("date", origin["date"] or "not known")]
        setup = origin["setup"]
        return [*((what, str(value)) for what, value in rows), ("setup", f"{setup['name']}, SHA-256 {setup['sha256']}")]
    except (KeyError, TypeError, ValueError, RecursionError):
        return []
