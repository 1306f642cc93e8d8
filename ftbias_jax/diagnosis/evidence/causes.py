"""Causes and candidates of a search in parameters and words, each judged on blocks that its fit has not seen.

Beside each cause stand the effects that explain the log as well, and why it may be something else, although it fits:
because it can take nearly any shape, and what that is instead.
"""

from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np

from ftbias_jax.diagnosis import thresholds
from ftbias_jax.diagnosis.candidates import Scored
from ftbias_jax.diagnosis.evidence.estimates import Parameters, parameters
from ftbias_jax.diagnosis.evidence.gap import HeldOut, Judge, gap_removed, nats_of_joints
from ftbias_jax.diagnosis.hypothesis import Hypothesis
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.proposals import entries, pulls, series, touches
from ftbias_jax.diagnosis.regression.fit import Fit, compared, fit
from ftbias_jax.diagnosis.result import Candidate, FoundTerm, Gap
from ftbias_jax.diagnosis.samples.types import Finding
from ftbias_jax.model.effects.fitting import Entries, Pull, Samples, Step, Touches
from ftbias_jax.model.effects.terms.types import Term
from ftbias_jax.model.effects.types import Effect

CANDIDATES = 12

DOUBTS = {Step: series.doubt, Touches: touches.doubt, Pull: pulls.doubt, Entries: entries.doubt}
"""Search of an effect -> (problem, fit, its hypothesis) -> why it may be something else, in words; "" = it may not."""


class Answer(NamedTuple):
    """What explains the logs."""

    problem: Problem
    hold_out: Judge
    base: Fit
    """The nominal model."""
    found: tuple[Finding, ...]
    """What single samples show."""
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


def causes_of(answer: Answer) -> tuple[Candidate, ...]:
    """Accepted hypotheses with their twins, and what was read off the samples; the larger gap first.

    Each cause is judged by what it removes beside those before it. Effects of a drafted tool were fitted beside all
    others: they come last, and are judged by what the answer loses without them.
    """
    problem, accepted, of_tool = answer.problem, answer.accepted, len(answer.start.hypotheses)
    of_mean, previous = list[Candidate](), answer.base
    pairs = list(zip(answer.rounds, accepted.hypotheses, strict=False))
    for scored, h in (*pairs[of_tool:], *pairs[:of_tool]):
        better, worse = scored[0].fit, previous
        if h in accepted.hypotheses[:of_tool]:
            better, worse = accepted, fit(problem, accepted.beside(h), accepted)
        twins = twins_of(problem, answer.base, accepted, h, scored)
        named = _fitted(answer, accepted, h, answer.hold_out(better, worse.error), worse, twins)
        doubt = doubt_of(problem, accepted, h) or answer.doubt
        of_mean.append(named._replace(explanation=named.explanation + doubt, doubt=doubt.removeprefix("; ")))
        previous = scored[0].fit
    of_samples = [_of_finding(problem, finding) for finding in answer.found]
    if answer.total < thresholds.LEADS**2:
        return tuple(of_samples + of_mean)
    return tuple(sorted(of_mean + of_samples, key=lambda cause: not _comes_first(problem.catalogue[cause.effect])))


def in_order(answer: Answer, causes: Sequence[Candidate]) -> list[Candidate | FoundTerm]:
    """Causes and terms as they are told: what explains the mean reading before what single samples show beside it."""

    def is_beside(one: Candidate | FoundTerm) -> bool:
        effect = answer.problem.catalogue[one.effect] if isinstance(one, Candidate) else None
        return effect is not None and isinstance(effect.fit.search, Samples) and not _comes_first(effect)

    told: list[Candidate | FoundTerm] = [*causes, *answer.terms]
    return told if answer.total < thresholds.LEADS**2 else sorted(told, key=is_beside)


def _comes_first(effect: Effect) -> bool:
    """Whether what samples show of an effect is told before what explains the mean reading, however large that is.

    What is cut off is missing from the mean reading, too, and much else can look like that. Noise that changes over
    the log is what all else is judged by.
    """
    return isinstance(effect.fit.search, Samples) and effect.fit.search.first


def _fitted(
    answer: Answer, found: Fit, h: Hypothesis, held: HeldOut, worse: Fit, twins: tuple[str, ...] = ()
) -> Candidate:
    """A hypothesis of a fit, with what it gains and removes beyond another fit on blocks it has not seen."""
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
    """Everything that was fitted by itself, best first, with its paired difference to the best."""
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
    """Effects that could stand in the place of an accepted cause, the others unchanged: at most three, best first.

    That an effect has more free numbers does not count against it here: the data do not separate the two. Scored are
    the candidates of the round in which the cause was found.
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
        lost, error = compared(problem, accepted.error, trial.error)
        own_form = by_form if other.hypothesis.effect in declared else 0.0
        if (
            lost < max(thresholds.ALIKE * error, thresholds.LEAST_DIFFERENCE, own_form)
            and gain - lost > thresholds.CLOSE * gain
        ):
            twins[other.hypothesis.effect] = None
    return tuple(twins)[: thresholds.MOST_TWINS]


def doubt_of(problem: Problem, found: Fit, h: Hypothesis) -> str:
    """Why one of the causes of a fit may be something else, as the end of a sentence; "" = no reason."""
    search = type(problem.catalogue[h.effect].fit.search)
    return DOUBTS[search](problem, found, h) if search in DOUBTS else ""


def is_sure(problem: Problem, found: Fit) -> bool:
    """Whether no cause of a fit may be something else."""
    return not any(doubt_of(problem, found, h) for h in found.hypotheses)


def doubt_by(terms: Sequence[Term]) -> str:
    """The same of a cause that terms could take the place of, which are as good; "" = there are none."""
    drives = ", ".join(dict.fromkeys(term.drive for term in terms))
    return f"; or something that is not in the catalogue: a term does as well (drive: {drives})" if drives else ""
