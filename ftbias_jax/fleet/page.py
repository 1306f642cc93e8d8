"""Report of a fleet as one self-contained HTML page: no network, no scripts, no fonts."""

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from importlib import resources
from urllib.parse import quote

import numpy as np

from ftbias_jax import __version__
from ftbias_jax.diagnosis.report.page import html_table, section, table_of, whole_page
from ftbias_jax.diagnosis.report.svg import escape
from ftbias_jax.diagnosis.report.tables import day, verdict_words
from ftbias_jax.diagnosis.result import Course
from ftbias_jax.fleet.alarms import Alarm, alarms_of, bias_trend, dates, scalars_of, size, values_of
from ftbias_jax.fleet.entry import FAILED, LOSS
from ftbias_jax.fleet.history import Fleet, FleetLog
from ftbias_jax.fleet.manifest import damaged_in_words
from ftbias_jax.fleet.plots import plot_history, plot_marks
from ftbias_jax.io.remote import is_url
from ftbias_jax.types import AXES, AXIS_UNITS

MOST_ROWS = 200
"""Maximum number of logs that a table lists; the manifest has all."""
FIRST_ROWS = 15
"""Number of these logs that are not folded away."""
MOST_PLOTTED = 40
"""Maximum number of robots that have plots."""
MOST_CAUSES = 10
HOW_TO_READ = (
    "Bias and residuals are those of ftbias filter, gaps and causes those of ftbias diagnose, mistakes those of ftbias "
    "check: what was not run is not shown. The bias is that at the end of each log; corrected = reading + bias.",
    "A bias ages if it follows a line over the dates by more than five standard errors, which grow with how much "
    "neighbouring logs have in common, and by more than a random walk goes by itself. A cause appears if most logs "
    "since some date have it and few had it before; two logs at the end are the least.",
    "What logs show together is what ftbias diagnose --pool by=robot found: no single log needs to show it.",
    "Logs whose stamps are no dates stand at the time when their file was changed last.",
)

Group = tuple[str, str]


def to_page(fleet: Fleet, title: str, folder: str) -> str:
    """HTML of the page; links to reports of single logs are relative to ``folder``, where the page will be."""
    groups = fleet.by_robot()
    alarms = {group: alarms_of(records, fleet.pooled.get(group, ())) for group, records in groups.items()}
    gaps = sorted((r for r in fleet.records if r.has_gap), key=lambda r: -np.nan_to_num(r.numbers("gap_sigmas", 1)[0]))
    bad = [record for record in fleet.records if record.status in (FAILED, LOSS)]
    sections = (
        section("Alarms", _alarms(alarms)),
        section("Robots and sensors", _overview(groups, alarms)),
        section(f"Logs with a gap ({len(gaps)})", _gaps(gaps, folder)),
        *(
            section(f"{name(group)}, over time", _plots(number, records, fleet.pooled.get(group, ())))
            for number, (group, records) in enumerate(groups.items())
            if number < MOST_PLOTTED
        ),
        _left_out(len(groups) - MOST_PLOTTED, "robots have no plots here"),
        section(f"Logs that failed or lost samples ({len(bad)})", _troubles(bad)),
        section("Where this comes from", _origin(fleet)),
        section("How to read this", "".join(f"<p>{escape(sentence)}</p>" for sentence in HOW_TO_READ)),
    )
    style = resources.files("ftbias_jax.fleet").joinpath("fleet.css").read_text(encoding="utf-8")
    return whole_page(title, f"{_header(fleet, alarms, title)}\n{''.join(sections)}", style=style)


def name(group: Group) -> str:
    """Name of a robot and its sensor."""
    robot, sensor = group
    return f"{robot}, sensor {sensor}" if sensor else robot


def _header(fleet: Fleet, alarms: Mapping[Group, Sequence[Alarm]], title: str) -> str:
    records, count = fleet.records, sum(map(len, alarms.values()))
    verdicts = Counter(record.verdict for record in records if record.verdict)
    robots = f"{len(alarms)} robot{'s' if len(alarms) > 1 else ''}"
    statuses, gaps = Counter(record.status for record in records), sum(record.has_gap for record in records)
    numbers = [
        ("logs", f"{len(records)} of {robots}"),
        ("from", _days(records)),
        ("failed", statuses[FAILED]),
        ("lost samples", statuses[LOSS]),
        ("diagnosed", verdicts.total()),
        *((verdict_words(verdict), times) for verdict, times in verdicts.most_common()),
    ]
    items = "".join(f"<div><dt>{escape(term)}</dt><dd>{escape(value)}</dd></div>" for term, value in numbers)
    kinds = ((count, "alarm", ""), (statuses[FAILED], "log", " failed"), (gaps, "log", " with a gap"))
    said = [f"{times} {kind}{'s' if times > 1 else ''}{what}" for times, kind, what in kinds if times]
    words = ", ".join(said) or ("No alarm" if verdicts else "No alarm; no log was diagnosed")
    quiet = "" if said else " class='quiet'"
    return f"<header{quiet}><p class='small'>{escape(title)}</p><h1>{words}</h1><dl>{items}</dl></header>"


def _days(records: Sequence[FleetLog]) -> str:
    """First and last day of the logs by their own stamps, or by file times if no log has a date; "" = no log."""
    dated = [record.date for record in records if record.dated]
    every = dated or [record.date for record in records]
    if not every:
        return ""
    days = " to ".join(dict.fromkeys((day(every[0]), day(every[-1]))))
    return days if dated else f"{days} (files)"


def _alarms(alarms: Mapping[Group, Sequence[Alarm]]) -> str:
    every = [(name(group), alarm.text) for group, some in alarms.items() for alarm in some]
    items = "".join(f"<li><b>{escape(group)}</b>: {escape(text)}</li>" for group, text in every)
    return f"<ul class='alarms'>{items}</ul>" if items else ""


def _overview(groups: Mapping[Group, Sequence[FleetLog]], alarms: Mapping[Group, Sequence[Alarm]]) -> str:
    rows = []
    for group, records in groups.items():
        force, torque = np.moveaxis(size(values_of(records, "one_second_error")), 1, 0)
        diagnosed = [record for record in records if record.verdict]
        causes = Counter(cause for record in diagnosed for cause in record.words("causes"))
        with_gap = f"{sum(record.has_gap for record in diagnosed)} of {len(diagnosed)}" if diagnosed else ""
        ahead = f"{_median(force)} N, {_median(torque)} Nm" if np.isfinite(force).any() else ""
        gated = _median(100 * scalars_of(records, "gated_share"), " %")
        found = ", ".join(f"{cause} ({times})" for cause, times in causes.most_common(3))
        first = (name(group), str(len(records)), _days(records), _median(scalars_of(records, "nis")))
        rows.append((*first, ahead, gated, with_gap, found, str(len(alarms[group]) or "")))
    head = ("robot", "logs", "dates", "NIS", "error 1 s ahead", "gated", "with a gap", "causes", "alarms")
    return html_table(head, rows)


def _median(values: np.ndarray, unit: str = "") -> str:
    seen = values[np.isfinite(values)]
    return f"{np.median(seen):.3g}{unit}" if len(seen) else ""


def _gaps(records: Sequence[FleetLog], folder: str) -> str:
    rows = []
    for record in records[:MOST_ROWS]:
        before, shrink = record.numbers("gap_sigmas", 1)[0], record.numbers("shrink", 1)[0]
        found = (*record.words("causes"), *record.words("terms"))
        cells = (
            f"{record.robot} {record.sensor}".strip(),
            _days([record]),
            verdict_words(record.verdict),
            ", ".join(found),
            f"{before:.2f}" if np.isfinite(before) else "",
            f"{100 * shrink:.0f} %" if np.isfinite(shrink) and found else "",
        )
        log = escape(record.log)
        if record.report:
            near = is_url(record.report) == is_url(folder)
            place = os.path.relpath(record.report, folder or ".") if near else record.report
            path = quote(os.fsencode(place), safe="/:" if is_url(place) else "/")
            log = f'<a href="{escape(path)}">{log}</a>'
        rows.append(f'<tr><th scope="row">{log}</th>{"".join(f"<td>{escape(cell)}</td>" for cell in cells)}</tr>')
    head = ("log", "robot", "date", "verdict", "found", "gap [noise sigmas]", "shrinks by")
    rest = len(rows) - FIRST_ROWS
    folded = f"<details><summary>{rest} more</summary>{table_of(head, rows[FIRST_ROWS:])}</details>" if rest > 0 else ""
    more = _left_out(len(records) - MOST_ROWS, "logs with smaller gaps are in the manifest")
    return table_of(head, rows[:FIRST_ROWS]) + folded + more


def _plots(number: int, records: Sequence[FleetLog], courses: Sequence[Course]) -> str:
    whole = [record for record in records if record.quality]
    t, parts = dates(whole), []
    bias, std = values_of(whole, "bias"), values_of(whole, "bias_std")
    if np.isfinite(bias).any():
        for axis, axis_name in enumerate(AXES):
            title = f"Bias {axis_name} [{AXIS_UNITS[axis]}]"
            found = bias_trend(whole, axis)
            parts.append(plot_history(f"bias-{number}-{axis}", title, t, bias[:, axis], std[:, axis], found))
        for key, words in (("one_second_error", "Error 1 s ahead"), ("residual_std", "Residual, std")):
            values = size(values_of(whole, key))
            for column, kind in enumerate(("force [N]", "torque [Nm]")):
                parts.append(plot_history(f"{key}-{number}-{column}", f"{words}, {kind}", t, values[:, column]))
        parts.append(plot_history(f"nis-{number}", "NIS for each axis (1 = right)", t, scalars_of(whole, "nis")))
    gap = scalars_of(whole, "gap_sigmas")
    if np.isfinite(gap).any():
        parts.append(plot_history(f"gap-{number}", "Gap [noise sigmas]", t, gap))
    for place, one in enumerate(courses):
        title = f"{one.effect}, share of what it is in the latest logs"
        parts.append(plot_history(f"course-{number}-{place}", title, one.dates, one.share, one.stderr))
    figures = "".join(f"<figure>{part}</figure>" for part in parts)
    return f"<div class='grid'>{figures}</div>{_causes(number, whole)}"


def _causes(number: int, records: Sequence[FleetLog]) -> str:
    """Figure of the causes and mistakes found in each log, by date; "" = none."""
    found = [(record.date, {*record.words("causes"), *record.words("findings")}) for record in records]
    counts = Counter(name for _, names in found for name in names)
    if not counts:
        return ""
    t = np.array([date for date, _ in found])
    common = [cause for cause, _ in counts.most_common(MOST_CAUSES)]
    rows = [(cause, np.array([cause in names for _, names in found])) for cause in common]
    drawn = plot_marks(f"causes-{number}", "Causes and mistakes by date", t, rows)
    caption = "<figcaption>Causes and mistakes that were found, log by log.</figcaption>"
    return f"<figure class='wide'>{drawn}{caption}</figure>"


def _troubles(records: Sequence[FleetLog]) -> str:
    rows = [(record.log, record.status, "; ".join(record.troubles)) for record in records[:MOST_ROWS]]
    more = _left_out(len(records) - MOST_ROWS, "more are in the manifest")
    return html_table(("log", "status", "why"), rows) + more


def _left_out(count: int, words: str) -> str:
    return f"<p>{count} {words}.</p>" if count > 0 else ""


def _origin(fleet: Fleet) -> str:
    rows = [(one.job, one.robot, one.setup, one.setup_sha256[:12], one.version) for one in fleet.settings]
    damaged = f" {damaged_in_words(fleet.damaged).capitalize()}." if fleet.damaged else ""
    folders = f"<p>Folders: {escape(', '.join(fleet.folders))}.{damaged} Page made by ftbias {escape(__version__)}.</p>"
    return html_table(("command", "robot", "setup", "SHA-256", "version"), sorted(rows)) + folders
