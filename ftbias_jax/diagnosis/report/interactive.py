"""What makes the plots against time answer to the pointer: their numbers and one small script, both in the page.

The drawings are whole without it: a browser without scripts, a printer and a screen reader get the same SVG.
"""

from __future__ import annotations

import base64
import hashlib
import json
from importlib import resources

import numpy as np

from ftbias_jax.diagnosis.report.plotted import Series

MAX_NUMBERS = 1500
"""Times of all logs together whose numbers are in the page; longer series are averaged."""
DIGITS = 4
STYLE_POLICY = "default-src 'none'; style-src 'unsafe-inline'"
"""The browser itself refuses to load anything."""


def script() -> str:
    """The script, as it stands in the page."""
    return resources.files("ftbias_jax.diagnosis.report").joinpath("report.js").read_text(encoding="utf-8")


def policy(text: str) -> str:
    """A Content-Security-Policy that lets one script run and nothing load.

    Args:
        text: of the script; "" = none may run.
    """
    if not text:
        return STYLE_POLICY
    digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
    return f"{STYLE_POLICY}; script-src 'sha256-{digest}'"


def data_block(series: Series, name: str, with_after: bool, most: int = MAX_NUMBERS) -> str:
    """The numbers of one log's plots against time, as a block of JSON that no browser runs.

    Args:
        series: of the log.
        name: of the block, unique in the page.
        with_after: whether the after is drawn.
        most: times; more are averaged.
    """
    series = averaged(series, most)
    content: dict[str, object] = {"t": [round(float(t), 4) for t in series.t]}
    channels = {"before": series.before, "after": series.after, "noise": series.noise}
    for key, values in channels.items():
        if with_after or key != "after":
            content[key] = [[_short(x) for x in column] for column in values.T]
    text = json.dumps(content, separators=(",", ":"), allow_nan=False)
    return f'<script type="application/json" id="{name}">{text}</script>'


def averaged(series: Series, most: int) -> Series:
    """At most so many times: means of neighbours, NaN left out, with the standard deviation that noise gives them."""
    pieces = min(len(series.t), max(most, 1))
    if pieces == len(series.t):
        return series
    starts = np.linspace(0, len(series.t), pieces, endpoint=False).astype(int)
    lengths = np.diff(np.r_[starts, len(series.t)])[:, None]

    def mean(values: np.ndarray) -> np.ndarray:
        seen = np.isfinite(values)
        count = np.add.reduceat(seen, starts)
        with np.errstate(invalid="ignore", divide="ignore"):
            means: np.ndarray = np.add.reduceat(np.where(seen, values, 0.0), starts) / count
        return means

    return series._replace(
        t=mean(series.t[:, None])[:, 0],
        before=mean(series.before),
        after=mean(series.after),
        noise=np.sqrt(mean(series.noise**2) / lengths),
        regressor=mean(series.regressor[:, None])[:, 0],
    )


def _short(number: float) -> float | None:
    return float(f"{number:.{DIGITS}g}") if np.isfinite(number) else None
