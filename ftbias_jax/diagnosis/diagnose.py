"""The diagnosis of one log: examine samples, search causes, judge on held-out blocks, say what is and is not known."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import cast

import numpy as np

from ftbias_jax.diagnosis.candidates import Scored
from ftbias_jax.diagnosis.degenerate import with_typed_errors
from ftbias_jax.diagnosis.evidence.compare import compare
from ftbias_jax.diagnosis.evidence.cross_validation import HeldOut, Judge, gap_removed
from ftbias_jax.diagnosis.evidence.doubts import doubt_of, is_sure
from ftbias_jax.diagnosis.evidence.estimates import Parameters, parameters
from ftbias_jax.diagnosis.evidence.nominal import with_nominal
from ftbias_jax.diagnosis.evidence.twins import twins_of
from ftbias_jax.diagnosis.gap import is_quiet, measure_gap, verdict_of
from ftbias_jax.diagnosis.problem import Problem, make_problem
from ftbias_jax.diagnosis.recorded import not_tested
from ftbias_jax.diagnosis.regression import fit as fits
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.diagnosis.regression.precompile import compiled_ahead
from ftbias_jax.diagnosis.report.sentence import sentence_of
from ftbias_jax.diagnosis.report.series import show, where
from ftbias_jax.diagnosis.result import Candidate, Diagnosis, FoundTerm
from ftbias_jax.diagnosis.samples.types import Finding, SampleFindings, together
from ftbias_jax.diagnosis.search import search
from ftbias_jax.diagnosis.terms.describe import describe
from ftbias_jax.diagnosis.terms.found import found_terms
from ftbias_jax.diagnosis.terms.noise import louder, noise_term
from ftbias_jax.diagnosis.terms.peaks import fast_lines
from ftbias_jax.diagnosis.terms.states import state_of_problem
from ftbias_jax.diagnosis.thresholds import LEADS, USEFUL_SHARE
from ftbias_jax.errors import UsageError
from ftbias_jax.filtering.check.check_setup import require_right
from ftbias_jax.io.cleaning import clean
from ftbias_jax.io.log import Log
from ftbias_jax.io.write.provenance import provenance, source_of
from ftbias_jax.model.effects.catalogue import check_names
from ftbias_jax.model.effects.fitting import GROWTH, LEVEL, Samples
from ftbias_jax.model.effects.shown import not_shown
from ftbias_jax.model.effects.table import Catalogue
from ftbias_jax.model.effects.terms.parse import NAME as TERM
from ftbias_jax.model.effects.types import Effect
from ftbias_jax.model.own_effects import catalogue_of_setup
from ftbias_jax.runtime.jax_config import in_float64
from ftbias_jax.setup.types import Setup

CANDIDATES = 12


@in_float64
@with_typed_errors
def diagnose(
    setup: Setup,
    logs: Sequence[Log],
    names: Sequence[str] = (),
    without: Collection[str] = (),
    effects: Sequence[Effect] = (),
    unchecked: bool = False,
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
    logs = [clean(log, clipped=False, held=False) for log in logs]
    require_right(setup, map(clean, logs), "diagnose", unchecked)
    with compiled_ahead(setup, logs):
        problem, samples = make_problem(setup, logs)
    found = tuple(finding for finding in together(samples, problem.catalogue) if finding.effect not in without)
    base = fits.base(problem)
    loud: tuple[FoundTerm, ...] = ()
    if TERM not in without:
        problem, found, loud = _with_noise(problem, logs, samples, base, found)
        base = fits.base(problem) if loud else base
    hold_out = Judge(problem)
    accepted, rounds = search(problem, base, hold_out, {*without, *not_shown(setup)})
    before, after = (hold_out(one, base.error) for one in (base, accepted))
    gap = measure_gap(problem, before, after)
    total = gap.before_sigmas**2 - 1
    causes = _causes(problem, hold_out, base, accepted, rounds, found, total)
    sure = is_sure(problem, accepted)
    verdict = verdict_of(problem, gap, len(causes), len(found), sure)
    terms: tuple[FoundTerm, ...] = ()
    if not is_quiet(problem, gap) and TERM not in without:
        lines = fast_lines(logs, samples)
        described = describe(problem, hold_out, base, accepted, rounds, verdict == "explained", lines)
        if described is not None:
            accepted, after = described.kept, hold_out(described.fit, base.error)
            gap = measure_gap(problem, before, after)
            terms = found_terms(problem, described, gap)
            causes = _causes(problem, hold_out, base, accepted, rounds, found, total)
    terms = (*terms, *loud)
    if gap.shrink < USEFUL_SHARE:  # what does not hold on unseen blocks is no cause
        causes = tuple(cause for cause in causes if cause.effect in {finding.effect for finding in found})
        accepted = base
        if terms == loud:
            after, gap = before, measure_gap(problem, before, before)
    sure = is_sure(problem, accepted)
    verdict = verdict_of(problem, gap, len(causes), len(found), sure, len(terms))
    if verdict in ("unknown", "none"):  # what single samples show stays told
        seen = {finding.effect for finding in found}
        causes = tuple(cause for cause in causes if cause.effect in seen)
    stages = tuple(dict.fromkeys(cause.stage for cause in causes))
    return Diagnosis(
        verdict=verdict,
        sentence=sentence_of(verdict, gap, causes, terms),
        causes=tuple(with_nominal(problem, cause) for cause in causes),
        candidates=_ranking(problem, hold_out, base, rounds, found, total),
        gap=gap,
        where=where(problem, before, stages),
        not_tested=not_tested(setup, problem.catalogue, problem.recorded, without),
        series=show(problem, base, accepted, before, after),
        logs=tuple(names),
        repairs=tuple(log.repairs for log in logs),
        by_log=compare(problem, names, accepted if causes else base, before, after),
        setup_name=Path(setup.path).name,
        own_effects=setup.own_effects,
        terms=terms,
        provenance=provenance(setup, list(map(source_of, logs)), {"without": sorted(without)}, names),
    )


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


def _causes(
    problem: Problem,
    hold_out: Judge,
    base: Fit,
    accepted: Fit,
    rounds: list[list[Scored]],
    found: tuple[Finding, ...],
    total: float,
) -> tuple[Candidate, ...]:
    """Accepted hypotheses with their twins, and what was read off the samples; the larger gap first."""
    of_mean = []
    previous = base
    for scored, hypothesis in zip(rounds, accepted.hypotheses, strict=False):
        twins = twins_of(problem, base, accepted, hypothesis, scored)
        values, stderr = parameters(problem, accepted, hypothesis)
        held, shrink = _judged(problem, hold_out, scored[0].fit, previous, total)
        named = _candidate(problem.catalogue[hypothesis.effect], values, stderr, held, shrink, twins)
        doubt = doubt_of(problem, accepted, hypothesis)
        of_mean.append(named._replace(explanation=named.explanation + doubt, doubt=doubt.removeprefix("; ")))
        previous = scored[0].fit
    of_samples = [_of_finding(problem.catalogue, finding, problem.duration) for finding in found]
    if total < LEADS**2:
        return tuple(of_samples + of_mean)
    return tuple(sorted(of_mean + of_samples, key=lambda cause: not _comes_first(problem.catalogue[cause.effect])))


def _comes_first(effect: Effect) -> bool:
    """Whether what samples show of an effect is told before what explains the mean reading, however large that is.

    What is cut off is missing from the mean reading, too, and much else can look like that. Noise that changes over
    the log is what all else is judged by.
    """
    return isinstance(effect.fit.search, Samples) and effect.fit.search.first


def _judged(problem: Problem, hold_out: Judge, better: Fit, worse: Fit, total: float) -> tuple[HeldOut, float]:
    """A fit on blocks it has not seen, and the share of the whole gap that it removes there beyond another fit."""
    held = hold_out(better, worse.error)
    return held, gap_removed(problem, worse.error, held.error) / max(total, 1e-12)


def _candidate(
    entry: Effect, values: Parameters, stderr: Parameters, held: HeldOut, shrink: float, twins: tuple[str, ...] = ()
) -> Candidate:
    words = {twin.effect: twin.separate_by for twin in entry.twins}
    return Candidate(
        effect=entry.name,
        stage=entry.stage,
        indistinguishable_from=twins,
        separate_by=tuple(words.get(twin, "") for twin in twins),
        parameters=values,
        stderr=stderr,
        held_out_gain=held.nats,
        held_out_gain_stderr=held.nats_stderr,
        shrink=float(np.clip(shrink, 0, 1)),
        explanation=entry.explanation,
        remedy=entry.remedy,
        units={parameter.name: parameter.unit for parameter in entry.parameters},
    )


def _of_finding(catalogue: Catalogue, finding: Finding, duration: float) -> Candidate:
    gain = finding.nats / max(duration, 1e-9)
    nothing = np.zeros((0, 6))
    scatter = np.sqrt(2 * max(finding.nats, 0)) if finding.nats_stderr is None else finding.nats_stderr
    held = HeldOut(nothing, gain, scatter / max(duration, 1e-9))
    values, stderr = cast(Parameters, finding.parameters), cast(Parameters, finding.stderr)
    candidate = _candidate(catalogue[finding.effect], values, stderr, held, 0.0)
    return candidate._replace(explanation=f"{candidate.explanation}: {finding.sentence}")


def _ranking(
    problem: Problem,
    hold_out: Judge,
    base: Fit,
    rounds: list[list[Scored]],
    found: tuple[Finding, ...],
    total: float,
) -> tuple[Candidate, ...]:
    """Everything that was fitted by itself, best first."""
    ranked = [_of_finding(problem.catalogue, finding, problem.duration) for finding in found]
    for scored in rounds[0][:CANDIDATES] if rounds else []:
        values, stderr = parameters(problem, scored.fit, scored.hypothesis)
        held, shrink = _judged(problem, hold_out, scored.fit, base, total)
        ranked.append(_candidate(problem.catalogue[scored.hypothesis.effect], values, stderr, held, shrink))
    return tuple(sorted(ranked, key=lambda candidate: -candidate.held_out_gain))
