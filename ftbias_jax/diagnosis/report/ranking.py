"""The part of the report that compares the candidates: what each gains on unseen data, and how sure the order is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.report.plots import NAMES, ROW
from ftbias_jax.diagnosis.report.svg import WIDTH, Axes, box, data_range, drawing, label, line, x_axis
from ftbias_jax.diagnosis.report.tables import behind_words, percent
from ftbias_jax.diagnosis.report.terms import html_table
from ftbias_jax.diagnosis.result import Diagnosis
from ftbias_jax.model.effects.statements import value_words

MAX_RANKED = 12


class Bar(NamedTuple):
    """One candidate of the ranking."""

    name: str
    nats: float
    """nats/s, held out."""
    stderr: float
    """Of its difference to the best one where the two were compared block by block, else of the gain itself."""
    words: str
    named: bool
    """Whether it is named as a cause, or is the term that was found."""


def plot_ranking(bars: Sequence[Bar]) -> str:
    """Held-out gain of each candidate as horizontal bars, best first, with the error by which it differs from the best.

    Args:
        bars: in order, with finite gains.
    """
    gains = np.array([bar.nats for bar in bars])
    errors = np.nan_to_num(np.array([bar.stderr for bar in bars]))
    height = len(bars) * ROW
    x_range = data_range(gains - errors, gains + errors, zero=True)
    axes = Axes(x_range, (0.0, 1.0), left=NAMES, top=4, width=WIDTH - NAMES - 74, height=height)
    parts = [x_axis(axes, "held-out gain [nats/s]")]
    zero = float(axes.across(np.array(0.0)))
    for row, (bar, gain, error) in enumerate(zip(bars, gains, errors, strict=True)):
        middle = axes.top + (row + 0.5) * ROW
        low, end, high = (float(axes.across(np.array(x))) for x in (gain - error, gain, gain + error))
        cause = bar.named
        name = f"● {bar.name}" if cause else bar.name
        parts += [
            label(axes.left - 6, middle + 4, name, "end", "name" if cause else ""),
            box(min(zero, end), middle - 7, abs(end - zero), 14, "fill-after" if cause else "fill-other"),
            line(low, middle, high, middle, "whisker"),
            line(low, middle - 4, low, middle + 4, "whisker"),
            line(high, middle - 4, high, middle + 4, "whisker"),
            label(WIDTH - 2, middle + 4, bar.words, "end"),
        ]
    parts.append(line(zero, axes.top, zero, axes.top + height, "axis"))
    words = "; ".join(f"{bar.name}: {bar.words}" for bar in bars)
    return drawing("ranking", axes.top + height + 36, "Held-out gain of the candidates", words, parts)


def ranking(diagnosis: Diagnosis) -> str:
    """How well each candidate, and each term that was found, explains the gap: a chart, and a table of all."""
    ranked = [candidate for candidate in diagnosis.candidates if np.isfinite(candidate.held_out_gain)]
    if not ranked:
        return ""
    named = {cause.title for cause in diagnosis.causes}
    bars = [Bar(c.title, c.held_out_gain, c.behind_stderr, behind_words(c), c.title in named) for c in ranked]
    found = [Bar(f"term: {t.drive}", t.held_out_gain, t.held_out_gain_stderr, "", True) for t in diagnosis.terms]
    shown = sorted([*bars[:MAX_RANKED], *found], key=lambda bar: -bar.nats)
    plot = plot_ranking(shown)
    rows = [
        (c.title, c.stage, value_words(c.held_out_gain, c.held_out_gain_stderr), behind_words(c), percent(c.shrink))
        for c in ranked
    ]
    head = ("effect", "stage", "held-out gain [nats/s]", "less than the best [nats/s]", "of the gap")
    table = html_table(head, rows)
    caption = (
        f"{'● named or found; ' if any(bar.named for bar in shown) else ''}numbers and whiskers: how much less than the"
        " best, compared block by block, with one standard error. Judged on data the fit has not seen."
    )
    figure = f"<figure class='wide'>{plot}<figcaption>{caption}</figcaption></figure>"
    return f"{figure}<details><summary>All {len(ranked)} as a table</summary>{table}</details>"
