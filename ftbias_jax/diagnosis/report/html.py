"""A diagnosis as one HTML file that needs nothing else: no network, no fonts, and no script but its own."""

from __future__ import annotations

import os
import shlex
from collections.abc import Sequence
from pathlib import PurePath

import numpy as np

from ftbias_jax.diagnosis.report.interactive import MAX_NUMBERS, data_block, script
from ftbias_jax.diagnosis.report.origin import origin_rows
from ftbias_jax.diagnosis.report.plots import (
    channel_title,
    plot_gap,
    plot_regressor,
    plot_shares,
    plot_time,
)
from ftbias_jax.diagnosis.report.plotted import Series
from ftbias_jax.diagnosis.report.ranking import ranking
from ftbias_jax.diagnosis.report.skeleton import section, whole_page
from ftbias_jax.diagnosis.report.svg import escape
from ftbias_jax.diagnosis.report.tables import (
    log_lines,
    nominal_words,
    parameter_words,
    percent,
    share_words,
    shrink_words,
    twin_words,
    verdict_words,
)
from ftbias_jax.diagnosis.report.terms import capital, html_table, show_terms, typeset
from ftbias_jax.diagnosis.result import Candidate, Diagnosis, Where
from ftbias_jax.io.atomic import write_atomic
from ftbias_jax.types import AXES

MAX_LOGS = 3
"""Logs whose time plots are drawn."""
HOW_TO_READ = (
    "The gap is what the corrected wrench differs from the model of the setup, beyond bias, drift and the stated noise;"
    " 1 noise sigma means that noise alone is left.",
    "Every effect of the catalogue was fitted to a part of the data and judged on the rest: the gain says how much more"
    " likely it makes data that it has not seen (nats per second), and a gain within two or three standard errors of"
    " zero, or of another effect's gain, decides nothing.",
    "Effects that this log cannot tell apart are named together, with the measurement that would separate them. What is"
    " not in the catalogue is described by what drives it, if a few such terms hold on data that they have not seen.",
)


def save_html(diagnosis: Diagnosis, path: str | os.PathLike[str], title: str = "") -> None:
    """Write a report with plots, one file, whole or not at all; ``Diagnosis.to_html`` is this.

    Args:
        diagnosis: what to show.
        path: the file.
        title: of the report; "" = the names of logs and setup.

    Raises:
        OutputError: the file cannot be written there.
    """
    setup = f" with {diagnosis.setup_name}" if diagnosis.setup_name else ""
    text = to_html(diagnosis, title or f"Gap of {', '.join(diagnosis.logs)}{setup}")
    write_atomic(path, lambda file: file.write(text.encode()))


def to_html(diagnosis: Diagnosis, title: str) -> str:
    """The report.

    Args:
        diagnosis: what to show.
        title: such as the names of the logs; any text.
    """
    sections = (
        section("What to do", _remedies(diagnosis)),
        section("Causes", _causes(diagnosis.causes)),
        section("Not in the catalogue", show_terms(diagnosis.terms)),
        section("The gap before and after" if _has_after(diagnosis) else "The gap", _gap(diagnosis)),
        section("Log by log", "".join(f"<p>{escape(line)}</p>" for line in log_lines(diagnosis))),
        section("What is left, against time", _times(diagnosis)),
        section("What is left, against the cause", _regressor(diagnosis)),
        section("How well each effect explains it", ranking(diagnosis)),
        section("Twins: what the data do not tell apart", _twins(diagnosis.causes)),
        section("Where the gap is", _where(diagnosis.where, diagnosis.verdict)),
        section("Samples that were lost", html_table(("what",), [(loss,) for loss in diagnosis.losses])),
        section("What was not tested", html_table(("effect", "why"), diagnosis.not_tested)),
        section("Where this comes from", html_table(("what", "value"), origin_rows(diagnosis))),
        section("How to read this", "".join(f"<p>{escape(sentence)}</p>" for sentence in HOW_TO_READ)),
    )
    body = f"{_header(diagnosis, title)}\n{''.join(sections)}"
    return whole_page(title, body, script() if diagnosis.series else "")


def _header(diagnosis: Diagnosis, title: str) -> str:
    gap = diagnosis.gap
    numbers = [("gap", f"{gap.before_sigmas:.2f} noise sigmas")]
    if _has_after(diagnosis):
        numbers += [
            ("with what was found" if diagnosis.terms else "with the causes", f"{gap.after_sigmas:.2f} noise sigmas"),
            ("shrinks by", shrink_words(gap)),
        ]
    items = "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in numbers)
    note = f"<p>{typeset(diagnosis.note)}</p>" if diagnosis.note else ""
    logs = f"<p class='small'>Logs: {escape(', '.join(diagnosis.logs))}</p>" if diagnosis.logs else ""
    return (
        f"<header><p class='small'>{escape(title)}</p>"
        f"<h1><span class='badge'>{escape(verdict_words(diagnosis.verdict))}</span> {typeset(diagnosis.sentence)}</h1>"
        f"{note}<dl>{items}</dl>{logs}</header>"
    )


def _causes(causes: Sequence[Candidate]) -> str:
    parts = []
    for cause in causes:
        head = f"{escape(cause.title)}<small>{escape(cause.stage)}, {share_words(cause)}</small>"
        parts.append(f"<h3>{head}</h3><p>{escape(capital(cause.explanation))}</p>")
        found = parameter_words(cause)
        nominal = nominal_words(cause)
        if any(nominal.values()):
            rows = [(name, nominal[name], words) for name, words in found]
            parts.append(html_table(("parameter", "in the setup", "found ± standard error"), rows))
        else:
            parts.append(html_table(("parameter", "found ± standard error"), found))
    return "".join(parts)


def _command(diagnosis: Diagnosis) -> str:
    """What makes a setup with the causes, in the user's own names."""
    logs, setup = diagnosis.logs or ("LOG",), diagnosis.setup_name or "SETUP.toml"
    made = diagnosis.command or shlex.join(("ftbias", "diagnose", *logs, "--setup", setup))
    return f"{made} --apply -o {shlex.quote(f'{PurePath(setup).stem}_fixed.toml')}"


def _has_after(diagnosis: Diagnosis) -> bool:
    """Whether anything was found that the reading after it is shown with."""
    return bool(diagnosis.causes or diagnosis.terms)


def _legend(with_after: bool, noise: bool) -> str:
    entries = [("before", "with the setup as it is")]
    entries += [("after", "with the causes in the model")] if with_after else []
    entries += [("noise", "95 % of what noise alone leaves")] if noise else []
    keys = "".join(f"<span class='key {style}'>{words}</span>" for style, words in entries)
    return f"<p class='legend'>{keys}</p>"


def _gap(diagnosis: Diagnosis) -> str:
    gap, after = diagnosis.gap, _has_after(diagnosis)
    columns = {"before": gap.before_rms, "after": gap.after_rms, "noise alone": gap.noise_floor}
    shown = {name: rms for name, rms in columns.items() if after or name != "after"}
    rows = [(channel_title(i), *(f"{rms[i]:.3g}" for rms in shown.values())) for i in range(len(AXES))]
    table = html_table(("held-out rms", *shown), rows)
    figure = f"<figure>{plot_gap(gap, after)}<figcaption>Dashed: what noise alone leaves (1).</figcaption></figure>"
    return f"{_legend(after, noise=False)}<div class='pair'>{figure}{table}</div>"


def _times(diagnosis: Diagnosis) -> str:
    after = _has_after(diagnosis)
    parts = [_legend(after, noise=True)] if diagnosis.series else []
    drawn = diagnosis.series[:MAX_LOGS]
    for number, series in enumerate(drawn):
        if len(diagnosis.series) > 1:
            parts.append(f"<h3>{escape(diagnosis.logs[number])}</h3>")
        plots = (plot_time(series, channel, f"time-{number}-{channel}", after) for channel in range(6))
        figures = "".join(f"<figure>{plot}</figure>" for plot in plots)
        parts.append(f"<div class='grid' data-series='series-{number}'>{figures}</div>")
        parts.append(data_block(series, f"series-{number}", after, MAX_NUMBERS // len(drawn)))
    if len(diagnosis.series) > MAX_LOGS:
        parts.append(f"<p>The plots of {len(diagnosis.series) - MAX_LOGS} more logs are left out.</p>")
    return "".join(parts)


def _regressor(diagnosis: Diagnosis) -> str:
    series = [one for one in diagnosis.series if np.isfinite(one.regressor).any()]
    if not (diagnosis.causes and series):
        return ""
    caption = (
        "Large markers: means of bins with their standard errors. Small dots: single values before. The bias is that of"
        " the model with the causes."
    )
    plot = plot_regressor(series, _responsible_channel(series))
    legend = _legend(with_after=True, noise=False)
    return f"{legend}<figure class='wide'>{plot}<figcaption>{caption}</figcaption></figure>"


def _responsible_channel(series: Sequence[Series]) -> int:
    """The channel that follows the regressor most, in units of its noise."""
    x = np.concatenate([one.regressor for one in series])[:, None]
    with np.errstate(invalid="ignore", divide="ignore"):
        y = np.concatenate([one.whole / one.noise for one in series])
    seen = np.isfinite(x) & np.isfinite(y)
    x_centred = np.where(seen, x - np.nanmean(x), 0.0)
    return int(np.argmax(np.abs(np.sum(x_centred * np.where(seen, y, 0.0), axis=0))))


def _twins(causes: Sequence[Candidate]) -> str:
    items = "".join(
        f"<li><b>{escape(cause.title)}</b> could as well be <b>{escape(twin)}</b>; {escape(how)}.</li>"
        for cause in causes
        for twin, how in twin_words(cause)
    )
    return f"<ul>{items}</ul>" if items else ""


def _remedies(diagnosis: Diagnosis) -> str:
    if diagnosis.verdict == "none":
        return "<p>Nothing: the setup describes these logs.</p>"
    items = [f"<li><b>{escape(c.title)}</b>: {escape(capital(c.remedy))}</li>" for c in diagnosis.causes if c.remedy]
    items += [f"<li>{escape(capital(term.check))}</li>" for term in diagnosis.terms if term.check]
    if _has_after(diagnosis):
        items.append(
            f"<li>{'Or let' if items else 'Let'} the model know: <code>{escape(_command(diagnosis))}</code></li>"
        )
    if diagnosis.verdict not in ("explained", "described"):
        items.append("<li>For what is not explained, start with the channels, times and regimes below.</li>")
    return f"<ul>{''.join(items)}</ul>"


def _where(where: Where, verdict: str) -> str:
    if verdict == "none":
        return ""
    stages = f"<p>Stages, most likely first: {escape(', '.join(where.stages))}.</p>" if where.stages else ""
    caption = "Share of each channel in the gap, in noise units."
    shares = f"<figure>{plot_shares(where.channels)}<figcaption>{caption}</figcaption></figure>"
    regimes = [(regime.name, percent(regime.share), percent(regime.expected)) for regime in where.regimes]
    intervals = [(f"{start:.2f}", f"{end:.2f}", f"{sigmas:.1f}") for start, end, sigmas in where.intervals]
    bands = [(f"{low:.3g}", f"{high:.3g}", percent(share)) for low, high, share in where.bands]
    tables = (
        html_table(("regime", "of the gap", "of the time"), regimes),
        html_table(("from [s]", "to [s]", "noise sigmas"), intervals),
        html_table(("from [Hz]", "to [Hz]", "of the gap"), bands),
    )
    return f"{stages}<div class='grid'>{shares if where.channels else ''}{''.join(tables)}</div>"
