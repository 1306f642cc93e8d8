"""Causes and candidates of a search with parameters and explanations, each judged on blocks held out from its fit.

Each cause is listed with its twins, the effects that explain the log equally well, and with a doubt: what it may be
instead although it fits, because it can take nearly any shape.
"""

from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np

from ftbias_jax.diagnosis import thresholds
from ftbias_jax.diagnosis.candidates import Scored
from ftbias_jax.diagnosis.evidence.estimates import Parameters, departs, parameters, with_nominal
from ftbias_jax.diagnosis.evidence.gap import CrossValidation, HeldOut, gap_removed, nats_of_joints
from ftbias_jax.diagnosis.hypothesis import Hypothesis
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.proposals import curves, entries, pulls, series, touches
from ftbias_jax.diagnosis.regression.fit import Fit, fit, log_likelihood_gain
from ftbias_jax.diagnosis.result import Candidate, FoundTerm, Gap
from ftbias_jax.diagnosis.samples.types import Finding
from ftbias_jax.model.effects.fitting import Entries, Pull, Samples, Step, Touches
from ftbias_jax.model.effects.terms.types import Term
from ftbias_jax.model.effects.types import Effect

CANDIDATES = 12

DOUBTS = {Step: series.doubt, Touches: touches.doubt, Pull: pulls.doubt, Entries: entries.doubt}
"""Search of an effect -> (problem, fit, its hypothesis) -> why it may be something else, in words; "" = no doubt."""
UNDETERMINED = "; or something that acts alike: none of its numbers is two standard errors from having no effect"
UNSEEN = "; or something else: it explains nothing on blocks of the logs that its fit has not seen"


class Answer(NamedTuple):
    """Result of a search: what explains the logs, and the gap with and without it."""

    problem: Problem
    hold_out: CrossValidation
    base: Fit
    """Fit of the nominal model."""
    found: tuple[Finding, ...]
    """Findings from single samples."""
    start: Fit
    """The nominal model with the accepted effects of a drafted tool."""
    accepted: Fit
    """Fit of all accepted effects of the catalogue."""
    rounds: list[list[Scored]]
    """Candidates of each round of the search, the accepted one first."""
    before: HeldOut
    """The nominal model on held-out blocks."""
    after: HeldOut
    """The model with all accepted effects and terms on held-out blocks."""
    gap: Gap
    total: float
    """Mean square gap in noise variances: the denominator of the share that each cause removes."""
    terms: tuple[FoundTerm, ...] = ()
    """Terms fitted to what the catalogue does not explain."""
    doubt: str = ""
    """Why the only cause may be something else: a term explains the logs equally well."""


def causes_of(answer: Answer) -> tuple[Candidate, ...]:
    """Accepted hypotheses with their twins, and findings from single samples; the group with the larger gap first.

    Each cause is judged by what it removes on top of the causes before it. Effects of a drafted tool were fitted
    together with all others: they come last, and are judged by what the fit loses without them.
    """
    problem, accepted, of_tool = answer.problem, answer.accepted, len(answer.start.hypotheses)
    of_mean, previous = list[Candidate](), answer.base
    pairs = list(zip(answer.rounds, accepted.hypotheses, strict=False))
    for scored, h in (*pairs[of_tool:], *pairs[:of_tool]):
        better, worse = scored[0].fit, previous
        if h in accepted.hypotheses[:of_tool]:
            better, worse = accepted, fit(problem, accepted.beside(h), accepted)
        twins = twins_of(problem, answer.base, accepted, h, scored)
        held = answer.hold_out(better, worse.error)
        named = _fitted(answer, accepted, h, held, worse, twins)
        previous = scored[0].fit
        if (held.nats <= 0 or answer.terms) and not departs(problem, accepted, h):
            continue  # what came after it explains what it was accepted for
        doubt = (UNSEEN if held.nats <= 0 else doubt_of(problem, accepted, h)) or answer.doubt
        of_mean.append(named._replace(explanation=named.explanation + doubt, doubt=doubt.removeprefix("; ")))
    of_samples = [_of_finding(problem, finding) for finding in answer.found]
    if answer.total < thresholds.LEADS**2:
        return tuple(of_samples + of_mean)
    return tuple(sorted(of_mean + of_samples, key=lambda cause: not _comes_first(problem.catalogue[cause.effect])))


def in_order(answer: Answer, causes: Sequence[Candidate]) -> list[Candidate | FoundTerm]:
    """Causes and terms as reported: effects on the mean reading first, then those found in single samples."""

    def is_beside(one: Candidate | FoundTerm) -> bool:
        effect = answer.problem.catalogue[one.effect] if isinstance(one, Candidate) else None
        return effect is not None and isinstance(effect.fit.search, Samples) and not _comes_first(effect)

    found_in_order: list[Candidate | FoundTerm] = [*causes, *answer.terms]
    return found_in_order if answer.total < thresholds.LEADS**2 else sorted(found_in_order, key=is_beside)


def _comes_first(effect: Effect) -> bool:
    """Whether an effect found in single samples is reported before those on the mean reading, whatever the gap.

    Saturated readings are missing from the mean reading too, and many other effects can mimic that. Noise that changes
    over the log is the reference by which everything else is judged.
    """
    return isinstance(effect.fit.search, Samples) and effect.fit.search.first


def _fitted(
    answer: Answer, found: Fit, h: Hypothesis, held: HeldOut, worse: Fit, twins: tuple[str, ...] = ()
) -> Candidate:
    """A fitted hypothesis as a candidate, with its held-out gain and share of the gap relative to another fit."""
    shrink = gap_removed(answer.problem, worse.error, held.error) / max(answer.total, 1e-12)
    values, stderr = parameters(answer.problem, found, h)
    return _candidate(answer.problem.catalogue[h.effect], values, stderr, held, shrink, twins)


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


def _of_finding(problem: Problem, finding: Finding) -> Candidate:
    seconds = max(problem.duration, 1e-9)
    scatter = np.sqrt(2 * max(finding.nats, 0)) if finding.nats_stderr is None else finding.nats_stderr
    held = HeldOut(np.zeros((0, 6)), finding.nats / seconds, scatter / seconds)
    values, stderr = cast(Parameters, finding.parameters), cast(Parameters, finding.stderr)
    candidate = _candidate(problem.catalogue[finding.effect], values, stderr, held, 0.0)
    return candidate._replace(
        explanation=f"{candidate.explanation}: {finding.sentence}",
        doubt=finding.doubt,
        remedy=finding.remedy or candidate.remedy,
    )


def ranking_of(answer: Answer) -> tuple[Candidate, ...]:
    """Everything that was fitted separately, best first, with its paired difference to the best."""
    ranked = [_of_finding(answer.problem, finding) for finding in answer.found]
    alone = [scored.fit for scored in (answer.rounds[0][:CANDIDATES] if answer.rounds else [])]
    fitted = [(one, answer.hold_out(one, answer.base.error)) for one in alone]
    best = max((held for _, held in fitted), key=lambda held: held.nats, default=None)
    for one, held in fitted:
        paired = answer.hold_out(one, best.error) if best else held
        candidate = _fitted(answer, one, one.hypotheses[-1], held, answer.base)
        ranked.append(candidate._replace(behind=-paired.nats, behind_stderr=paired.nats_stderr))
    return tuple(sorted(ranked, key=lambda candidate: -candidate.held_out_gain))


def twins_of(problem: Problem, base: Fit, accepted: Fit, cause: Hypothesis, scored: list[Scored]) -> tuple[str, ...]:
    """Twins: effects that could replace an accepted cause, the others unchanged; at most three, best first.

    A twin is not penalised for having more free parameters, because the data do not separate the two effects.
    ``scored`` holds the candidates of the round in which the cause was found.
    """
    rest = accepted.beside(cause)
    named = {h.effect for h in accepted.hypotheses}
    without = fit(problem, rest, accepted) if rest else base
    gain = accepted.log_likelihood - without.log_likelihood
    left = max(-accepted.log_likelihood - (problem.samples > 0).sum() / 2, 0.0)
    declared = {twin.effect for twin in problem.catalogue[cause.effect].twins}
    by_form = thresholds.FORM_LOSS * gain + left + nats_of_joints(problem)
    twins: dict[str, None] = {}
    hopeful = [s for s in scored if s.hypothesis.effect not in named and s.nats > thresholds.HOPELESS * scored[0].nats]
    for other in hopeful[: thresholds.MOST_TRIED]:
        trial = fit(problem, (*rest, other.hypothesis), accepted) if rest else other.fit
        lost, error = log_likelihood_gain(problem, accepted.error, trial.error)
        own_form = by_form if other.hypothesis.effect in declared else 0.0
        if (
            lost < max(thresholds.ALIKE * error, thresholds.LEAST_DIFFERENCE, own_form)
            and gain - lost > thresholds.CLOSE * gain
        ):
            twins[other.hypothesis.effect] = None
    return tuple(twins)[: thresholds.MOST_TWINS]


def with_statements(answer: Answer, causes: Sequence[Candidate]) -> tuple[tuple[Candidate, ...], tuple[Candidate, ...]]:
    """Causes with the values that the setup states, in sentences; and likewise the ranking of all candidates."""
    causes, ranking = (
        tuple(with_nominal(answer.problem, candidate) for candidate in some) for some in (causes, ranking_of(answer))
    )
    return tuple(_with_other_joints(answer.problem, cause, ranking) for cause in causes), ranking


def _with_other_joints(problem: Problem, cause: Candidate, ranking: Sequence[Candidate]) -> Candidate:
    """A cause at one joint with the other joints at which it explains the logs as well, as where axes are parallel."""
    alike = [one for one in ranking if one.effect == cause.effect and "joint" in one.parameters]
    own = next((one for one in alike if one.title == cause.title), None)
    if own is None:
        return cause

    def is_as_good(one: Candidate) -> bool:
        lost = problem.duration * (one.behind - own.behind)
        error = problem.duration * float(np.nan_to_num(np.fmax(one.behind_stderr, own.behind_stderr)))
        close = one.held_out_gain > thresholds.CLOSE * own.held_out_gain
        return close and lost < max(thresholds.ALIKE * error, thresholds.LEAST_DIFFERENCE)

    others = [f"{one.parameters['joint']:.0f}" for one in alike if one is not own and is_as_good(one)]
    if not others:
        return cause
    words = f"or joint {' or '.join(others)}, which explains the log as well"
    return cause._replace(
        explanation=f"{cause.explanation}; {words}", statement=cause.statement and f"{cause.statement} ({words})"
    )


def doubt_of(problem: Problem, found: Fit, h: Hypothesis) -> str:
    """Why one of the causes of a fit may be something else, as the end of a sentence; "" = no reason."""
    how = problem.catalogue[h.effect].fit
    doubts = [DOUBTS[type(how.search)]] if type(how.search) in DOUBTS else []
    doubts += [curves.doubt] if how.by_load else []
    reason = next(filter(None, (doubt(problem, found, h) for doubt in doubts)), "")
    return reason or ("" if departs(problem, found, h) else UNDETERMINED)


def is_sure(problem: Problem, found: Fit) -> bool:
    """Whether none of the causes of a fit is in doubt."""
    return not any(doubt_of(problem, found, h) for h in found.hypotheses)


def doubt_by(terms: Sequence[Term]) -> str:
    """Why a cause is in doubt because of equally good terms, as the end of a sentence; "" without terms."""
    drives = ", ".join(dict.fromkeys(term.drive for term in terms))
    return f"; or something that is not in the catalogue: a term does as well (drive: {drives})" if drives else ""
