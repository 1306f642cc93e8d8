"""A diagnosis as a table for the terminal."""

from collections.abc import Iterable
from datetime import UTC, datetime
from importlib.metadata import version
from platform import python_version

import numpy as np

from ftbias_jax import __version__
from ftbias_jax.diagnosis.report.sentence import SMALL
from ftbias_jax.diagnosis.result import ALL_ALONG, AT_ONCE, Candidate, Course, Diagnosis, FoundTerm, Gap, Where
from ftbias_jax.model.effects.statements import value_words
from ftbias_jax.types import AXES

SHOWN_OF_LONG = 3
"""Numbers that a table shows of a parameter with more than LONGEST_LIST, the most significant first."""
SUREST = ": the surest of"
LONGEST_LIST = 6
"""Largest number of values of one parameter that a table shows; the JSON has all."""


def to_table(diagnosis: Diagnosis) -> str:
    """The diagnosis for a reader at a terminal: plain text, verdict first."""
    first = (f"{verdict_words(diagnosis.verdict)}: {diagnosis.sentence}", diagnosis.note)
    parts = [
        [line for line in first if line],
        *(_cause_lines(cause) for cause in diagnosis.causes),
        *(_term_lines(term) for term in diagnosis.terms),
        _gap_lines(diagnosis.gap),
        list(map(course_words, diagnosis.courses)),
        log_lines(diagnosis),
        _where_lines(diagnosis.where) if diagnosis.verdict != "none" else [],
        [f"lost: {loss}" for loss in diagnosis.losses],
        [f"not tested: {effect} ({why})" for effect, why in diagnosis.not_tested],
    ]
    return "\n\n".join("\n".join(map(one_line, lines)) for lines in parts if lines)


def verdict_words(verdict: str) -> str:
    """The verdict's short name for readers."""
    return {"none": "no gap", "unknown": "not explained"}.get(verdict, verdict.replace("_", " "))


def _cause_lines(cause: Candidate) -> list[str]:
    gain = f"{value_words(cause.held_out_gain, cause.held_out_gain_stderr)} nats/s held out"
    lines = [f"cause: {cause.title} ({cause.stage}), {share_words(cause)}, {gain}"]
    nominal = nominal_words(cause)
    for name, value in parameter_words(cause):
        lines.append(f"  {name} = {value}" + (f" (setup: {nominal[name]})" if nominal[name] else ""))
    lines += [f"  doubtful: {cause.doubt}"] if cause.doubt else []
    lines += [f"  or {twin}: {how}" for twin, how in twin_words(cause)]
    return [*lines, f"  what to do: {cause.remedy}"] if cause.remedy else lines


def _term_lines(term: FoundTerm) -> list[str]:
    gain = f"{value_words(term.held_out_gain, term.held_out_gain_stderr)} nats/s held out"
    lines = [f"not in the catalogue: {term.text}, {gain}", f"  driven by: {term.drive} ({term.form})"]
    lines += [f"  {name} = {value}" for name, value in term_numbers(term)]
    pairs = zip(term.equivalent_to, term.separate_by, strict=True)
    lines += [f"  or {drive}; to tell them apart: {how}" for drive, how in pairs]
    return [*lines, f"  looks like: {', '.join(term.resembles)}", f"  what to check: {term.check}"]


def term_numbers(term: FoundTerm) -> list[tuple[str, str]]:
    """(name, value ± standard error) of a term's numbers."""
    rows = [(name, _numbers_words(value, term.stderr[name])) for name, value in term.coefficients.items()]
    known = term.parameters_stderr
    rows += [(name, _numbers_words(value, known.get(name, np.nan))) for name, value in term.parameters.items()]
    point = [("point [m]", ", ".join(f"{x:.3f}" for x in term.point))] if term.point else []
    return rows + point


def gain_deficit_words(candidate: Candidate) -> str:
    """How much less a candidate gains than the best of the ranking, compared block by block; "" = not compared."""
    if not np.isfinite(candidate.behind):
        return ""
    return "best" if candidate.behind_stderr == 0 else f"-{value_words(candidate.behind, candidate.behind_stderr)}"


def share_words(cause: Candidate) -> str:
    """The share of the gap that a cause removes; a finding in single samples has none."""
    return f"{percent(cause.shrink)} of the gap" if cause.shrink > 0 else "seen in single samples"


def parameter_words(candidate: Candidate) -> list[tuple[str, str]]:
    """(name, value ± standard error and unit) of the parameters of a candidate."""
    return [
        (name, _with_unit(candidate, name, _numbers_words(value, candidate.stderr.get(name))))
        for name, value in candidate.parameters.items()
    ]


def nominal_words(candidate: Candidate) -> dict[str, str]:
    """Name -> what the setup states of a parameter, with its unit; "" where it states nothing."""
    shown = {
        name: _with_unit(candidate, name, _numbers_words(value, None))
        for name, value in candidate.nominal.items()
        if np.isfinite(np.asarray(value, float)).all() and np.size(value) <= LONGEST_LIST
    }
    return {name: shown.get(name, "") for name in candidate.parameters}


def _with_unit(candidate: Candidate, name: str, numbers: str) -> str:
    """Numbers of a parameter with their unit, where there is one."""
    unit = candidate.units.get(name, "1")
    if unit in ("", "1"):
        return numbers
    return f"{numbers}, in {unit}" if SUREST in numbers else f"{numbers} {unit}"


def _numbers_words(value: object, stderr: object) -> str:
    values = np.asarray(value, float)
    errors = np.asarray(np.nan if stderr is None else stderr, float)
    errors = errors if errors.shape == values.shape else np.full(values.shape, np.nan)
    if values.size <= LONGEST_LIST:
        return ", ".join(value_words(x, e) for x, e in zip(values.ravel(), errors.ravel(), strict=True))
    worth = np.divide(np.abs(np.nan_to_num(values)), errors, out=np.zeros(values.shape), where=errors > 0)
    order = np.argsort(-(worth if worth.any() else np.abs(np.nan_to_num(values))), axis=None)[:SHOWN_OF_LONG]
    shown = []
    for k in order[values.flat[order] != 0]:
        place = ", ".join(str(i + 1) for i in np.unravel_index(k, values.shape))
        shown.append(f"{value_words(float(values.flat[k]), float(errors.flat[k]))} at ({place})")
    return f"{', '.join(shown)}{SUREST} {values.size}"


def twin_words(candidate: Candidate) -> list[tuple[str, str]]:
    """(twin, the measurement that would separate it) of a candidate."""
    known = (*candidate.separate_by, *[""] * len(candidate.indistinguishable_from))
    return [
        (twin, f"to tell them apart: {how}" if how else "no measurement is known that tells them apart")
        for twin, how in zip(candidate.indistinguishable_from, known, strict=False)
    ]


def _gap_lines(gap: Gap) -> list[str]:
    before, after = (sigmas_by_channel(rms, gap.noise_floor) for rms in (gap.before_rms, gap.after_rms))
    rows: list[tuple[str, Iterable[float]]] = [
        ("before [N, Nm]", gap.before_rms),
        ("after  [N, Nm]", gap.after_rms),
        ("noise  [N, Nm]", gap.noise_floor),
        ("before [noise sigmas]", [*before, gap.before_sigmas]),
        ("after  [noise sigmas]", [*after, gap.after_sigmas]),
    ]
    head = f"{'held-out rms':22s}" + "".join(f"{name:>9s}" for name in (*AXES, "all"))
    lines = [f"{name:22s}" + "".join(f"{number:9.3g}" for number in numbers) for name, numbers in rows]
    unit = "1 noise sigma = the white noise of the readings alone, averaged over each bin"
    return [head, *lines, f"the gap shrinks by {shrink_words(gap)} ({unit})"]


def log_lines(diagnosis: Diagnosis) -> list[str]:
    """One line for each of several logs: its gap, and the causes as fitted to this log alone."""
    lines = []
    for log in diagnosis.by_log:
        gap = f"{log.before_sigmas:.3g} -> {log.after_sigmas:.3g} noise sigmas"
        own = [
            cause._replace(parameters=log.parameters[cause.effect], stderr=log.stderr[cause.effect])
            for cause in diagnosis.causes
            if cause.effect in log.parameters
        ]
        alone = [f"{name} = {words}" for cause in own for name, words in parameter_words(cause)]
        says = f"; alone it says {', '.join(alone)}, {log.own_gain:.2g} nats/s better" if alone else ""
        lines.append(one_line(f"{log.name}: {gap}{says}"))
    return lines


def course_words(course: Course) -> str:
    """Onset and time course of a cause in words."""
    varies = f"; it varies by {percent(course.scatter)} from log to log" if course.scatter else ""
    if course.begins == ALL_ALONG:
        return f"{course.effect}: in all {len(course.dates)} logs since {day(course.since)}{varies}"
    dates = dict.fromkeys(map(day, (course.earliest, course.latest)))
    begins = "there at once" if course.begins == AT_ONCE else "growing since"
    before = f"{percent(course.before)} of it before"
    return f"{course.effect}: since {day(course.since)} (95 %: {' to '.join(dates)}), {begins}, {before}{varies}"


def day(date: float) -> str:
    """Date of a time in s since 1970, such as 2026-03-14."""
    return datetime.fromtimestamp(date, UTC).strftime("%Y-%m-%d")


def shrink_words(gap: Gap) -> str:
    """How far the gap shrinks, in percent with its standard error; for a small gap no share is stated."""
    if gap.before_sigmas - 1 < SMALL:
        return "nothing to speak of: it is small"
    error = f" ± {100 * gap.shrink_stderr:.2g}" if np.isfinite(gap.shrink_stderr) else ""
    return f"{100 * gap.shrink:.0f}{error} %" if np.isfinite(gap.shrink) else "an unknown share"


def sigmas_by_channel(rms: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """(6,) rms N, Nm in units of the noise (6,) N, Nm; NaN where there is no noise to compare with."""
    return np.asarray(rms, float) / np.where(np.asarray(noise) > 0, noise, np.nan)


def _where_lines(where: Where) -> list[str]:
    channels = sorted(where.channels.items(), key=lambda item: -item[1])
    listed = {
        "stages": list(where.stages),
        "channels": [f"{name} {percent(share)}" for name, share in channels if share >= 0.05],
        "times": [f"{start:.1f} to {end:.1f} s ({sigmas:.1f} sigmas)" for start, end, sigmas in where.intervals],
        "regimes": [
            f"{regime.name}: {percent(regime.share)} of the gap in {percent(regime.expected)} of the time"
            for regime in where.regimes
        ],
        "bands": [f"{low:.3g} to {high:.3g} Hz {percent(share)}" for low, high, share in where.bands],
    }
    return [f"{name}: {'; '.join(entries)}" for name, entries in listed.items() if entries]


def percent(share: float) -> str:
    """A share in percent."""
    return f"{100 * share:.0f} %" if np.isfinite(share) else "?"


def one_line(text: str) -> str:
    """The text with every character replaced that would move a terminal's cursor or break the line."""
    return "".join(character if character.isprintable() else "?" for character in text)


def origin_rows(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    """(what, value) of the provenance: one row per file, and the entries common to all."""
    origin = diagnosis.provenance
    if origin is None:
        return []
    rows = [("made at", datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z"))]
    rows += [("command", diagnosis.command)] if diagnosis.command else []
    rows += [("versions", _versions()), ("robot", origin["robot"])]
    for kind, file in (("setup", origin["setup"]), ("URDF or MJCF", origin["urdf"])):
        rows += [(f"{kind} {file['name']}", f"SHA-256 {file['sha256']}")] if file else []
    for log in origin["logs"]:
        measured = f"{log['samples']} samples of the wrench in {log['duration']:.6g} s, {log['rate'] or 0:.4g} Hz"
        known = [log["date"], measured, f"SHA-256 {log['sha256']}" if log["sha256"] else "from memory"]
        rows.append((f"log {log['name']}", ", ".join(filter(None, known))))
    options = ", ".join(f"{name} = {value}" for name, value in origin["options"].items() if value)
    return [*rows, ("options", options)] if options else rows


def _versions() -> str:
    """Versions of all packages that the results depend on."""
    others = ", ".join(f"{name} {version(name)}" for name in ("jax", "jaxlib", "numpy"))
    return f"ftbias_jax {__version__}, {others}, Python {python_version()}"
