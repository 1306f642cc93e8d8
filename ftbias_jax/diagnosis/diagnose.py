"""The diagnosis of one log: examine samples, search causes, judge on held-out blocks, say what is and is not known."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import NamedTuple

from ftbias_jax.check.check_setup import require_right
from ftbias_jax.diagnosis.candidates import Scored
from ftbias_jax.diagnosis.degenerate import with_typed_errors
from ftbias_jax.diagnosis.evidence.causes import causes_of, ranking_of
from ftbias_jax.diagnosis.evidence.compare import compare
from ftbias_jax.diagnosis.evidence.cross_validation import HeldOut, Judge
from ftbias_jax.diagnosis.evidence.doubts import doubt_by, is_sure
from ftbias_jax.diagnosis.evidence.nominal import with_nominal
from ftbias_jax.diagnosis.gap import is_quiet, measure_gap, verdict_of
from ftbias_jax.diagnosis.problem import Problem, make_problem
from ftbias_jax.diagnosis.recorded import not_tested
from ftbias_jax.diagnosis.regression import fit as fits
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.diagnosis.regression.precompile import compiled_ahead
from ftbias_jax.diagnosis.report.sentence import headline, note
from ftbias_jax.diagnosis.report.series import show, where
from ftbias_jax.diagnosis.result import Candidate, Diagnosis, FoundTerm, Gap
from ftbias_jax.diagnosis.samples.types import Finding, SampleFindings, together
from ftbias_jax.diagnosis.terms.describe import describe
from ftbias_jax.diagnosis.terms.found import found_terms
from ftbias_jax.diagnosis.terms.noise import louder, noise_term
from ftbias_jax.diagnosis.terms.peaks import fast_lines
from ftbias_jax.diagnosis.terms.states import state_of_problem
from ftbias_jax.diagnosis.thresholds import USEFUL_SHARE
from ftbias_jax.diagnosis.tool_first import search_causes
from ftbias_jax.errors import UsageError
from ftbias_jax.filtering.quality.at_rest import rest_in_words, weight_in_bias
from ftbias_jax.io.cleaning import cleaned, slices, survey, without_long_pauses
from ftbias_jax.io.log import Log
from ftbias_jax.io.write.provenance import provenance, source_of
from ftbias_jax.model.effects.catalogue import check_names
from ftbias_jax.model.effects.fitting import GROWTH, LEVEL
from ftbias_jax.model.effects.terms.parse import NAME as TERM
from ftbias_jax.model.effects.types import Effect
from ftbias_jax.model.own_effects import catalogue_of_setup
from ftbias_jax.model.shown import not_shown
from ftbias_jax.runtime.jax_config import in_float64
from ftbias_jax.runtime.progress import silent
from ftbias_jax.setup.types import Setup


class _Known(NamedTuple):
    """What is known of the logs before a cause is looked for."""

    problem: Problem
    hold_out: Judge
    base: Fit
    """The nominal model."""
    found: tuple[Finding, ...]
    """What single samples show."""
    loud: tuple[FoundTerm, ...]
    """The term that the noise follows, if there is one."""


class _Answer(NamedTuple):
    """What explains the logs."""

    start: Fit
    """The nominal model, with the effects of a drafted tool that stay."""
    accepted: Fit
    """The effects of the catalogue that stay."""
    rounds: list[list[Scored]]
    """Candidates of each, the accepted one first."""
    before: HeldOut
    """The nominal model on held-out blocks."""
    after: HeldOut
    """Effects and terms there."""
    gap: Gap
    total: float
    """Mean square gap in noise variances, of which causes remove shares."""
    terms: tuple[FoundTerm, ...] = ()
    """Of what the catalogue does not explain."""
    doubt: str = ""
    """Why the only cause may be something else: a term does as well."""


@in_float64
@with_typed_errors
def diagnose(
    setup: Setup,
    logs: Sequence[Log],
    names: Sequence[str] = (),
    without: Collection[str] = (),
    effects: Sequence[Effect] = (),
    unchecked: bool = False,
    progress: Callable[[str], None] = silent,
) -> Diagnosis:
    """Diagnose one log, or several of one robot together: an effect then has the same parameters in all of them.

    Computes in float64 whatever JAX's setting is, and keeps compiled programs in the user's cache folder
    (``FTBIAS_CACHE=off`` does not).

    Args:
        setup: what the robot's owner believes.
        logs: of free motion with the same robot, sensor and tool, best as recorded (``read_log(..., raw=True)``),
            because clipped samples are evidence. Samples of axes that stand still are left out here, and told in
            ``repairs``.
        names: of the logs, one each, for the report; () = "log 1", "log 2", ...
        without: effects that may not be named, to see what the answer would be without them.
        effects: of your own, looked for beside those of the catalogue.
        unchecked: do not look first whether the setup can be right (``check_setup``).
        progress: called with the name of each stage as it begins.

    Raises:
        SetupError, LogError: the logs show a mistake of units, signs or frames, have no wrench, or fit nothing.
        UsageError: no log, or an unknown effect.
    """
    setup = setup.with_effects(effects)
    names = names or [f"log {i}" for i in range(1, len(logs) + 1)]
    if not logs or len(names) != len(logs):
        message = f"got {len(logs)} logs and {len(names)} names"
        raise UsageError(message, field="logs", remedy="give one log or more, and a name for each or none")
    check_names([name for name in without if name != TERM], "without", catalogue_of_setup(setup))
    progress("checking the setup")
    facts = [survey(slices(log)) for log in logs]
    as_filtered = map(cleaned, logs, facts)  # one at a time, each no longer than it is looked at
    pairs = zip(logs, facts, strict=True)
    logs = [without_long_pauses(cleaned(log, known, clipped=False, held=False)) for log, known in pairs]
    with_tool, of_tool = weight_in_bias(setup, slices(*logs))
    logs = [log._replace(repairs=(*log.repairs, *of_tool)) for log in logs]
    with compiled_ahead(with_tool, logs):
        require_right(setup, as_filtered, "diagnose", unchecked)
        progress("making the logs ready")
        problem, samples = make_problem(with_tool, logs)
    known = _known(problem, logs, samples, without)
    found = search_causes(setup, known.problem, known.base, known.hold_out, {*without, *not_shown(setup)}, progress)
    before, after = (known.hold_out(one, known.base.error) for one in (known.base, found.accepted))
    gap = measure_gap(known.problem, before, after)
    answer = _Answer(*found, before, after, gap, gap.before_sigmas**2 - 1)
    if TERM not in without and (found.accepted.hypotheses or not is_quiet(known.problem, gap)):
        progress("trying terms")
        answer = _with_terms(known, answer, fast_lines(logs, samples))
    progress("writing the report")
    answer, verdict, causes = _judged(known, answer)
    return _told(setup, logs, names, without, known, answer, verdict, causes)


def _known(
    problem: Problem, logs: Sequence[Log], samples: Sequence[SampleFindings], without: Collection[str]
) -> _Known:
    """What single samples show, and the nominal model with noise that follows something, if it does."""
    found = tuple(finding for finding in together(samples, problem.catalogue) if finding.effect not in without)
    base = fits.base(problem)
    loud: tuple[FoundTerm, ...] = ()
    if TERM not in without:
        problem, found, loud = _with_noise(problem, logs, samples, base, found)
        base = fits.base(problem) if loud else base
    return _Known(problem, Judge(problem), base, found, loud)


def _with_noise(
    problem: Problem,
    logs: Sequence[Log],
    samples: Sequence[SampleFindings],
    base: Fit,
    found: tuple[Finding, ...],
) -> tuple[Problem, tuple[Finding, ...], tuple[FoundTerm, ...]]:
    """The problem with noise that follows something, what is left of the findings, and the term if there is one."""
    state = state_of_problem(problem, base)
    term = noise_term(problem, logs, samples, state, found)
    if term is None:
        return problem, found, ()
    # What grows is no constant, and no growth of the catalogue.
    kept = tuple(one for one in found if one.sign not in (LEVEL, GROWTH))
    return louder(problem, term, state), kept, (term,)


def _with_terms(known: _Known, answer: _Answer, lines: Sequence[float]) -> _Answer:
    """The answer with terms, where they describe what the catalogue does not explain.

    Args:
        known: of the logs.
        answer: of the catalogue.
        lines: Hz, in the single samples.
    """
    problem, hold_out, base, accepted = known.problem, known.hold_out, known.base, answer.accepted
    causes = len(accepted.hypotheses) + len(known.found)
    verdict = verdict_of(problem, answer.gap, causes, len(known.found), is_sure(problem, accepted))
    outcome = describe(problem, hold_out, answer.start, accepted, answer.rounds, verdict == "explained", lines)
    described = outcome.description
    if described is None:
        return answer._replace(doubt=doubt_by(outcome.rivals))
    after = hold_out(described.fit, base.error)
    gap = measure_gap(problem, answer.before, after)
    terms = found_terms(problem, described, gap)
    return answer._replace(accepted=described.kept, rounds=described.rounds, after=after, gap=gap, terms=terms)


def _judged(known: _Known, answer: _Answer) -> tuple[_Answer, str, tuple[Candidate, ...]]:
    """The answer without what does not hold on unseen blocks, the verdict, and the causes that it names."""
    problem, (accepted, gap) = known.problem, (answer.accepted, answer.gap)
    of_tool = len(answer.start.hypotheses)
    causes = causes_of(
        problem, known.hold_out, known.base, accepted, answer.rounds, known.found, answer.total, answer.doubt, of_tool
    )
    of_samples = tuple(cause for cause in causes if cause.effect in {finding.effect for finding in known.found})
    if gap.shrink < USEFUL_SHARE:
        causes, answer = of_samples, answer._replace(accepted=known.base)
        if not answer.terms:
            before = answer.before
            answer = answer._replace(after=before, gap=measure_gap(problem, before, before))
    answer = answer._replace(terms=(*answer.terms, *known.loud))
    sure = is_sure(problem, answer.accepted) and not answer.doubt
    verdict = verdict_of(problem, answer.gap, len(causes), len(known.found), sure, len(answer.terms))
    return answer, verdict, of_samples if verdict in ("unknown", "none") else causes


def _told(
    setup: Setup,
    logs: Sequence[Log],
    names: Sequence[str],
    without: Collection[str],
    known: _Known,
    answer: _Answer,
    verdict: str,
    causes: tuple[Candidate, ...],
) -> Diagnosis:
    """The answer in words, tables and series."""
    problem, base, gap, (before, after) = known.problem, known.base, answer.gap, (answer.before, answer.after)
    ranking = ranking_of(problem, known.hold_out, base, answer.rounds, known.found, answer.total)
    causes, ranking = (tuple(with_nominal(problem, candidate) for candidate in some) for some in (causes, ranking))
    place = where(problem, before, tuple(dict.fromkeys(cause.stage for cause in causes)))
    return Diagnosis(
        verdict=verdict,
        sentence=headline(verdict, gap, causes, answer.terms, ranking, place),
        causes=causes,
        candidates=ranking,
        gap=gap,
        where=place,
        not_tested=not_tested(setup, problem.catalogue, problem.recorded, without),
        series=show(problem, base, answer.accepted, before, after),
        logs=tuple(names),
        repairs=tuple(log.repairs for log in logs),
        by_log=compare(problem, names, answer.accepted if causes else base, before, after),
        setup_name=Path(setup.path).name,
        own_effects=setup.own_effects,
        terms=answer.terms,
        note=note(setup, rest_in_words(setup, slices(*logs))),
        provenance=provenance(setup, list(map(source_of, logs)), {"without": sorted(without)}, names),
    )
