"""A diagnosis as one self-contained HTML file: no network, no fonts, and no script but its own."""

import os
import shlex
from collections.abc import Sequence
from pathlib import PurePath

import numpy as np

from ftbias_jax.diagnosis.report import page, plots
from ftbias_jax.diagnosis.report import tables as words
from ftbias_jax.diagnosis.report.svg import escape
from ftbias_jax.diagnosis.result import Candidate, Course, Diagnosis, FoundTerm, Where
from ftbias_jax.io.atomic import write_atomic
from ftbias_jax.model.effects.statements import value_words
from ftbias_jax.types import AXES

MAX_RANKED = 12
"""Largest number of candidates in the chart of the ranking."""
MAX_LOGS = 3
"""Largest number of logs whose time plots are drawn."""
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
    """Write a report with plots as one file, atomically; ``Diagnosis.to_html`` is bound to this.

    An empty title is replaced by the names of logs and setup.

    Raises:
        OutputError: the file cannot be written there.
    """
    setup = f" with {diagnosis.setup_name}" if diagnosis.setup_name else ""
    text = to_html(diagnosis, title or f"Gap of {', '.join(diagnosis.logs)}{setup}")
    write_atomic(path, lambda file: file.write(text.encode()))


def to_html(diagnosis: Diagnosis, title: str) -> str:
    """The report as HTML; its title may be any text."""
    sections = (
        page.section("What to do", _remedies(diagnosis)),
        page.section("Causes", _causes(diagnosis.causes)),
        page.section("Since when", _courses(diagnosis.courses)),
        page.section("Not in the catalogue", _terms(diagnosis.terms)),
        page.section("The gap before and after" if _has_after(diagnosis) else "The gap", _gap(diagnosis)),
        page.section("Log by log", page.paragraphs(words.log_lines(diagnosis))),
        page.section("Residual against time", _times(diagnosis)),
        page.section("What is left, against the cause", _regressor(diagnosis)),
        page.section("How well each effect explains it", _ranking(diagnosis)),
        page.section("Twins: what the data do not tell apart", _twins(diagnosis.causes)),
        page.section("Where the gap is", _where(diagnosis.where, diagnosis.verdict)),
        page.section("Samples that were lost", page.html_table(("what",), [(loss,) for loss in diagnosis.losses])),
        page.section("What was not tested", page.html_table(("effect", "why"), diagnosis.not_tested)),
        page.section("Where this comes from", page.html_table(("what", "value"), words.origin_rows(diagnosis))),
        page.section("How to read this", page.paragraphs(HOW_TO_READ)),
    )
    body = f"{_header(diagnosis, title)}\n{''.join(sections)}"
    return page.whole_page(title, body, page.script() if diagnosis.series else "")


def _header(diagnosis: Diagnosis, title: str) -> str:
    gap = diagnosis.gap
    numbers = [("gap", f"{gap.before_sigmas:.2f} noise sigmas")]
    if _has_after(diagnosis):
        numbers += [
            ("with what was found" if diagnosis.terms else "with the causes", f"{gap.after_sigmas:.2f} noise sigmas"),
            ("shrinks by", words.shrink_words(gap)),
        ]
    items = "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in numbers)
    note = f"<p>{page.typeset(diagnosis.note)}</p>" if diagnosis.note else ""
    logs = f"<p class='small'>Logs: {escape(', '.join(diagnosis.logs))}</p>" if diagnosis.logs else ""
    badge = f"<span class='badge'>{escape(words.verdict_words(diagnosis.verdict))}</span>"
    head = f"<p class='small'>{escape(title)}</p><h1>{badge} {page.typeset(diagnosis.sentence)}</h1>"
    return f"<header>{head}{note}<dl>{items}</dl>{logs}</header>"


def _causes(causes: Sequence[Candidate]) -> str:
    parts = []
    for cause in causes:
        head = f"{escape(cause.title)}<small>{escape(cause.stage)}, {words.share_words(cause)}</small>"
        parts.append(f"<h3>{head}</h3><p>{escape(page.capital(cause.explanation))}</p>")
        nominal, found = words.nominal_words(cause), words.parameter_words(cause)
        if any(nominal.values()):
            rows = [(name, nominal[name], value) for name, value in found]
            parts.append(page.html_table(("parameter", "in the setup", "found ± standard error"), rows))
        else:
            parts.append(page.html_table(("parameter", "found ± standard error"), found))
    return "".join(parts)


def _courses(courses: Sequence[Course]) -> str:
    """Onset and time course of each cause."""
    caption = "Every log with the standard error of its share; dashed: the first log that has the cause."
    return "".join(
        f"<p>{page.typeset(page.capital(words.course_words(one)))}.</p>"
        + page.figure(plots.plot_course(one, f"course-{number}"), caption)
        for number, one in enumerate(courses)
    )


def _terms(terms: Sequence[FoundTerm]) -> str:
    """What no effect of the catalogue explains, described by its drive."""
    parts = []
    caption = "Orange: what was left of the reading; blue: the term. Markers: means with standard errors."
    for number, term in enumerate(terms):
        plot = page.figure(plots.plot_term(term.curve, f"term-{number}"), caption) if term.curve is not None else ""
        table = page.html_table(("number", "value ± standard error"), words.term_numbers(term))
        rows = [("Looks like", ", ".join(term.resembles)), ("What to check", term.check)]
        rows += [(f"Could as well be {d}", how) for d, how in zip(term.equivalent_to, term.separate_by, strict=True)]
        items = page.bullets(f"<b>{escape(head)}</b>: {escape(text)}." for head, text in rows if text)
        parts.append(
            f"<h3>{page.typeset(page.capital(term.text))}</h3><div class='pair'>{plot}<div>{table}{items}</div></div>"
        )
    return "".join(parts)


def _command(diagnosis: Diagnosis) -> str:
    """The command that writes a setup with the causes, with the user's own names of files."""
    logs, setup = diagnosis.logs or ("LOG",), diagnosis.setup_name or "SETUP.toml"
    made = diagnosis.command or shlex.join(("ftbias", "diagnose", *logs, "--setup", setup))
    return f"{made} --apply -o {shlex.quote(f'{PurePath(setup).stem}_fixed.toml')}"


def _has_after(diagnosis: Diagnosis) -> bool:
    """Whether anything was found, so that the gap after it can be shown."""
    return bool(diagnosis.causes or diagnosis.terms)


def _legend(with_after: bool, noise: bool) -> str:
    entries = [("before", "with the setup as it is")]
    entries += [("after", "with the causes in the model")] if with_after else []
    entries += [("noise", "95 % of what noise alone leaves")] if noise else []
    keys = "".join(f"<span class='key {style}'>{meaning}</span>" for style, meaning in entries)
    return f"<p class='legend'>{keys}</p>"


def _gap(diagnosis: Diagnosis) -> str:
    gap, after = diagnosis.gap, _has_after(diagnosis)
    columns = {"before": gap.before_rms, "after": gap.after_rms, "noise alone": gap.noise_floor}
    shown = {name: rms for name, rms in columns.items() if after or name != "after"}
    rows = [(plots.channel_title(i), *(f"{rms[i]:.3g}" for rms in shown.values())) for i in range(len(AXES))]
    table = page.html_table(("held-out rms", *shown), rows)
    plot = page.figure(plots.plot_gap(gap, after), "Dashed: what noise alone leaves (1).")
    return f"{_legend(after, noise=False)}<div class='pair'>{plot}{table}</div>"


def _times(diagnosis: Diagnosis) -> str:
    after = _has_after(diagnosis)
    parts = [_legend(after, noise=True)] if diagnosis.series else []
    drawn = diagnosis.series[:MAX_LOGS]
    for number, series in enumerate(drawn):
        if len(diagnosis.series) > 1:
            parts.append(f"<h3>{escape(diagnosis.logs[number])}</h3>")
        drawings = (plots.plot_time(series, channel, f"time-{number}-{channel}", after) for channel in range(6))
        figures = "".join(f"<figure>{drawing}</figure>" for drawing in drawings)
        parts.append(f"<div class='grid' data-series='series-{number}'>{figures}</div>")
        parts.append(page.data_block(series, f"series-{number}", after, page.MAX_NUMBERS // len(drawn)))
    if len(diagnosis.series) > MAX_LOGS:
        parts.append(f"<p>The plots of {len(diagnosis.series) - MAX_LOGS} more logs are left out.</p>")
    return "".join(parts)


def _regressor(diagnosis: Diagnosis) -> str:
    series = [one for one in diagnosis.series if np.isfinite(one.regressor).any()]
    if not (diagnosis.causes and series):
        return ""
    caption = "Large markers: means of bins with their standard errors. Small dots: single values before."
    caption += " The bias is that of the model with the causes."
    return _legend(with_after=True, noise=False) + page.figure(plots.plot_regressor(series), caption, "wide")


def _ranking(diagnosis: Diagnosis) -> str:
    """How well each candidate, and each term that was found, explains the gap: a chart, and a table of all."""
    ranked = [candidate for candidate in diagnosis.candidates if np.isfinite(candidate.held_out_gain)]
    if not ranked:
        return ""
    named = {cause.title for cause in diagnosis.causes}
    behind = [words.gain_deficit_words(candidate) for candidate in ranked]
    pairs = zip(ranked, behind, strict=True)
    bars = [plots.Bar(c.title, c.held_out_gain, c.behind_stderr, less, c.title in named) for c, less in pairs]
    found = [plots.Bar(f"term: {t.drive}", t.held_out_gain, t.held_out_gain_stderr, "", True) for t in diagnosis.terms]
    shown = sorted([*bars[:MAX_RANKED], *found], key=lambda bar: -bar.nats)
    gains = [value_words(c.held_out_gain, c.held_out_gain_stderr) for c in ranked]
    columns = zip(ranked, gains, behind, strict=True)
    rows = [(c.title, c.stage, gain, less, words.percent(c.shrink)) for c, gain, less in columns]
    head = ("effect", "stage", "held-out gain [nats/s]", "less than the best [nats/s]", "of the gap")
    table = page.html_table(head, rows)
    caption = (
        f"{'● named or found; ' if any(bar.named for bar in shown) else ''}numbers and whiskers: how much less than the"
        " best, compared block by block, with one standard error. Judged on data the fit has not seen."
    )
    plot = page.figure(plots.plot_ranking(shown), caption, "wide")
    return f"{plot}<details><summary>All {len(ranked)} as a table</summary>{table}</details>"


def _twins(causes: Sequence[Candidate]) -> str:
    return page.bullets(
        f"<b>{escape(cause.title)}</b> could as well be <b>{escape(twin)}</b>; {escape(how)}."
        for cause in causes
        for twin, how in words.twin_words(cause)
    )


def _remedies(diagnosis: Diagnosis) -> str:
    if diagnosis.verdict == "none":
        return "<p>Nothing: the setup describes these logs.</p>"
    items = [f"<b>{escape(c.title)}</b>: {escape(page.capital(c.remedy))}" for c in diagnosis.causes if c.remedy]
    items += [escape(page.capital(term.check)) for term in diagnosis.terms if term.check]
    if _has_after(diagnosis):
        items.append(f"{'Or let' if items else 'Let'} the model know: <code>{escape(_command(diagnosis))}</code>")
    if diagnosis.verdict not in ("explained", "described"):
        items.append("For what is not explained, start with the channels, times and regimes below.")
    return page.bullets(items)


def _where(where: Where, verdict: str) -> str:
    if verdict == "none":
        return ""
    stages = f"<p>Stages, most likely first: {escape(', '.join(where.stages))}.</p>" if where.stages else ""
    shares = page.figure(plots.plot_shares(where.channels), "Share of each channel in the gap, in noise units.")
    regimes = [(regime.name, words.percent(regime.share), words.percent(regime.expected)) for regime in where.regimes]
    intervals = [(f"{start:.2f}", f"{end:.2f}", f"{sigmas:.1f}") for start, end, sigmas in where.intervals]
    bands = [(f"{low:.3g}", f"{high:.3g}", words.percent(share)) for low, high, share in where.bands]
    tables = (
        page.html_table(("regime", "of the gap", "of the time"), regimes),
        page.html_table(("from [s]", "to [s]", "noise sigmas"), intervals),
        page.html_table(("from [Hz]", "to [Hz]", "of the gap"), bands),
    )
    return f"{stages}<div class='grid'>{shares if where.channels else ''}{''.join(tables)}</div>"
