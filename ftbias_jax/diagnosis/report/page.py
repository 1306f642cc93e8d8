"""Building blocks of all pages: a head that loads nothing, sections, tables, figures, and values under the pointer.

The drawings are complete without the script: a browser without scripts, a printer and a screen reader get the same SVG.
"""

import base64
import hashlib
import json
import re
from collections.abc import Iterable, Sequence
from importlib import resources

import numpy as np

from ftbias_jax.diagnosis.report.svg import escape
from ftbias_jax.diagnosis.result import Series
from ftbias_jax.diagnosis.samples.bins import mean_of_bins

MAX_NUMBERS = 1500
"""Largest number of times of all logs together whose values are in the page; longer series are averaged."""
DIGITS = 4
STYLE_POLICY = "default-src 'none'; style-src 'unsafe-inline'"
"""Content security policy with which the browser itself refuses to load anything."""
PRINTED = {r" \+- ": " ± ", r"(?<=[a-z])\^2\b(?!\.)": "²", r"(?<=[a-z])\^3\b": "³", r"\bdeg C\b": "°C"}
"""Pattern in plain text -> its typographic form."""


def whole_page(title: str, body: str, runs: str = "", style: str = "") -> str:
    """A self-contained HTML file: no network, no fonts, and no script but its own, whose source is ``runs``.

    The title is any text, the body HTML of the header and the sections, the style CSS in addition to that of all pages.
    """
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{policy(runs)}">'
        '<meta name="generator" content="ftbias_jax">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta name="color-scheme" content="light dark">'
        f"<title>{escape(title)}</title><style>{_own_file('report.css')}{style}</style></head>\n"
        f"<body><main>{body}</main>{f'<script>{runs}</script>' if runs else ''}</body></html>\n"
    )


def script() -> str:
    """Source of the script of the page."""
    return _own_file("report.js")


def _own_file(name: str) -> str:
    return resources.files("ftbias_jax.diagnosis.report").joinpath(name).read_text(encoding="utf-8")


def policy(text: str) -> str:
    """A Content-Security-Policy that permits the script of this text, "" = none, and forbids loading anything."""
    if not text:
        return STYLE_POLICY
    digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
    return f"{STYLE_POLICY}; script-src 'sha256-{digest}'"


def section(title: str, content: str) -> str:
    """A section of the page with a plain-text title and HTML content; empty without content."""
    return f"<section><h2>{escape(title)}</h2>{content}</section>\n" if content else ""


def html_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table whose first column is the header of each row; empty without rows."""
    lines = [
        f'<tr><th scope="row">{typeset(first)}</th>{"".join(f"<td>{typeset(cell)}</td>" for cell in rest)}</tr>'
        for first, *rest in rows
    ]
    return table_of(head, lines)


def table_of(head: Sequence[str], rows: Sequence[str]) -> str:
    """A table of rows that are already HTML; empty without rows."""
    columns = "".join(f'<th scope="col">{escape(name)}</th>' for name in head)
    table = f"<table><thead><tr>{columns}</tr></thead><tbody>{''.join(rows)}</tbody></table>"
    return f'<div class="scroll" tabindex="0">{table}</div>' if rows else ""


def paragraphs(texts: Iterable[str]) -> str:
    """Plain texts as paragraphs."""
    return "".join(f"<p>{escape(text)}</p>" for text in texts)


def bullets(items: Iterable[str]) -> str:
    """A bulleted list of HTML texts; empty without items."""
    lines = "".join(f"<li>{item}</li>" for item in items)
    return f"<ul>{lines}</ul>" if lines else ""


def figure(plot: str, caption: str, style: str = "") -> str:
    """A drawing above its plain-text caption; style: a class of the page's style sheet."""
    kind = f" class='{style}'" if style else ""
    return f"<figure{kind}>{plot}<figcaption>{caption}</figcaption></figure>"


def capital(text: str) -> str:
    """The text with an initial capital letter and a full stop."""
    return f"{text[:1].upper()}{text[1:].removesuffix('.')}." if text else ""


def typeset(text: str) -> str:
    """Text for terminals of any encoding as HTML, with signs and powers of units in typographic form."""
    for plain, printed in PRINTED.items():
        text = re.sub(plain, printed, text)
    return escape(text)


def data_block(series: Series, name: str, with_after: bool, most: int = MAX_NUMBERS) -> str:
    """Values of one log's time plots, averaged to at most ``most`` times, as a block of JSON that no browser runs."""
    series = averaged(series, most)
    content: dict[str, object] = {"t": [round(float(t), 4) for t in series.t]}
    for key in ("before", "after", "noise") if with_after else ("before", "noise"):
        content[key] = [[_short(x) for x in column] for column in getattr(series, key).T]
    text = json.dumps(content, separators=(",", ":"), allow_nan=False)
    return f'<script type="application/json" id="{name}">{text}</script>'


def averaged(series: Series, most: int) -> Series:
    """Series at up to ``most`` times: means of neighbours without NaN, with the standard deviation of their noise."""
    pieces = min(len(series.t), max(most, 1))
    if pieces == len(series.t):
        return series
    starts = np.linspace(0, len(series.t), pieces, endpoint=False).astype(int)
    lengths = np.diff(np.r_[starts, len(series.t)])
    index = np.repeat(np.arange(pieces), lengths)
    arrays = (series.t, series.before, series.after, series.noise**2, series.regressor)
    t, before, after, variance, regressor = (mean_of_bins(index, x) for x in arrays)
    noise = np.sqrt(variance / lengths[:, None])
    return series._replace(t=t, before=before, after=after, noise=noise, regressor=regressor)


def _short(number: float) -> float | None:
    return float(f"{number:.{DIGITS}g}") if np.isfinite(number) else None
