"""Decide when terms replace or supplement the effects of the catalogue in a diagnosis."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.candidates import Scored
from ftbias_jax.diagnosis.evidence.gap import CrossValidation, gap_removed
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.proposals.entries import entries_of, evidence
from ftbias_jax.diagnosis.proposals.touches import takes_most
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.diagnosis.regression.score_test import prepare_fit
from ftbias_jax.diagnosis.regression.series import shaped
from ftbias_jax.diagnosis.search import gap_of
from ftbias_jax.diagnosis.terms.dictionary import merit_of
from ftbias_jax.diagnosis.terms.fit_terms import Solved
from ftbias_jax.diagnosis.terms.select import Search, Step, numbers_of
from ftbias_jax.diagnosis.thresholds import (
    AS_WELL,
    CLEARLY,
    CLOSE,
    LEAST_GAIN,
    LEAST_SHARE_OF_GAP,
    NEARLY,
    PENALTY_PER_PARAMETER,
)
from ftbias_jax.model.effects.catalogue import CATALOGUE
from ftbias_jax.model.effects.fitting import Linear, Pull, Ringing, Touches
from ftbias_jax.model.effects.fitting import Step as StepSearch
from ftbias_jax.model.effects.terms.types import Term

FORCES = np.repeat([True, False], 3)
GRAVITY = "orientation"
"""Drive of terms that may be a tool or a mounting that differs from the setup."""
OF_AN_EVENT = 8
"""Number of parameters of an event: start, end, and a wrench."""
SAME: dict[type, str] = {StepSearch: "time", Touches: "time", Pull: "position"}
"""Search of an effect that can take many shapes -> the drive of terms that describe the same."""


class Description(NamedTuple):
    """Effects of the catalogue that are kept, and terms added to them."""

    kept: Fit
    """Fit of the kept effects."""
    rounds: list[list[Scored]]
    """Candidates of each round, the kept one first."""
    fit: Fit
    """Fit of the effects with the terms."""
    steps: tuple[Step, ...]
    """One per term."""
    search: Search


class Outcome(NamedTuple):
    """Consequence of terms for the answer of the catalogue."""

    description: Description | None = None
    """Replaces the answer; None if the answer is kept."""
    rivals: tuple[Term, ...] = ()
    """If the answer is kept: terms that explain the logs as well as the event that it names."""


def describe(
    problem: Problem,
    hold_out: CrossValidation,
    base: Fit,
    accepted: Fit,
    rounds: list[list[Scored]],
    explained: bool,
    fast: Sequence[float] = (),
) -> Outcome:
    """Terms for what the catalogue does not explain, or for what it has ``explained`` by an event or a pull alone.

    The nominal model ``base`` includes the effects of the tool that are always kept, ``accepted`` these and the effects
    found in the rounds; ``fast`` are spectral lines of the individual samples in Hz.
    """
    names = [h.effect for h in accepted.hypotheses]
    found_names = names[len(base.hypotheses) :]
    if explained and len(found_names) == 1 and not problem.catalogue[found_names[0]].fit.any_shape:
        return Outcome()
    search = Search(problem, base, hold_out, fast)
    first = found = search.best(base)
    kept, said = base, list(rounds)
    for scored in rounds[len(base.hypotheses) : len(names)]:
        gain = scored[0].fit.log_likelihood - kept.log_likelihood
        # A user-defined effect has a name and a remedy, so a term of the same form does not replace it.
        ahead = 1.0 if scored[0].hypothesis.effect in CATALOGUE else CLEARLY
        better = found and found[0][0] > ahead * merit_of(gain, _numbers(scored[0].fit) - _numbers(kept))
        # Contact during most of a log leaves too little free motion to judge a term that follows the motion.
        unjudged = takes_most(scored[0].hypothesis, problem) and found[0][1].terms[0].drive != SAME[Touches]
        if better and not unjudged and not is_equivalent_to_term(problem, scored[0], kept, found[0][1]):
            break  # a single term is better
        kept = scored[0].fit
        found = search.best(kept)
    if not explained:
        kept, found, said = _by_name(search, kept, found, said)
    stands = [h.effect for h in kept.hypotheses] == names
    answer = Outcome(rivals=_rivals(problem, base, accepted, first) if explained else ())
    theirs = _merit(base, accepted)
    # One term in place of several effects is the simpler answer and need not be clearly better. A term that follows
    # gravity is excluded because it can mimic nearly any tool with gains and crosstalk.
    several = len(found_names) > 1 and CATALOGUE.keys() >= set(found_names)
    simpler = several and bool(first) and first[0][1].terms[0].drive != GRAVITY
    if stands and explained and simpler and _merit(base, base, first[0][1].terms, first[0][1].log_likelihood) > theirs:
        kept, found, said, stands = base, first, rounds[: len(base.hypotheses)], False
    if stands and explained:
        return answer
    steps = search.grow(kept, found)
    # A term that is better, but not on held-out blocks, does not replace effects that explain nearly all.
    if not steps and (explained or stands or gap_of(problem, accepted) < NEARLY * gap_of(problem, base)):
        return answer
    fit = steps[-1].described.fit if steps else kept
    # Neither does a term that removes less of the gap than they do.
    if not explained and not stands and not _holds(problem, hold_out, base, fit, accepted, 1 - NEARLY):
        return answer
    leaks = not stands and entries_of(problem, accepted)
    if leaks and evidence(problem, accepted) - evidence(problem, fit) > LEAST_GAIN:
        return answer  # crosstalk between six channels has thirty parameters, and no fewer
    if explained:
        ours = _merit(base, kept, steps[-1].described.terms, fit.log_likelihood)
        if ours < (1.0 if simpler else CLEARLY) * theirs or not _holds(problem, hold_out, base, fit, accepted, AS_WELL):
            return answer
    moved = kept._replace(z=fit.z, coefficients=fit.coefficients) if kept.hypotheses else kept
    return Outcome(Description(moved, said, fit, tuple(steps), search))


def _merit(base: Fit, kept: Fit, terms: Sequence[Term] = (), log_likelihood: float | None = None) -> float:
    """Merit over the nominal model of effects, or of effects and terms with this log-likelihood."""
    reached = kept.log_likelihood if log_likelihood is None else log_likelihood
    return merit_of(reached - base.log_likelihood, _numbers(kept) + sum(map(numbers_of, terms)))


def _numbers(found: Fit) -> int:
    """Free parameters of a fit; an event of any shape counts start, end and wrench, not its tent basis functions."""
    events = [(len(h.shapes), len(shaped(h))) for h in found.hypotheses if h.local]
    return found.degrees - sum(6 * hats - OF_AN_EVENT * count for hats, count in events)


def follows_something(problem: Problem, base: Fit, hold_out: CrossValidation) -> bool:
    """Whether one term may explain nearly all, to first order: contact by a hand follows no drive."""
    ranked = Search(problem, base, hold_out).ranked(prepare_fit(base))
    gap = -base.log_likelihood - (problem.samples > 0).sum() / 2
    return bool(ranked and ranked[0].merit > (1 - NEARLY) * gap)


def _by_name(
    search: Search, kept: Fit, found: list[tuple[float, Solved]], rounds: list[list[Scored]]
) -> tuple[Fit, list[tuple[float, Solved]], list[list[Scored]]]:
    """Kept effects plus one more, if the best term added to them is equivalent to an effect of the catalogue.

    A torque that is linear in the direction of gravity is a wrong centre of mass. It is reported by that name although
    the gap left by other things keeps the effect from being found separately.
    """
    place = len(kept.hypotheses)
    if not found or place >= len(rounds):
        return kept, found, rounds
    same = [one for one in rounds[place] if is_equivalent_to_term(search.problem, one, kept, found[0][1])]
    if not same:
        return kept, found, rounds
    named = [same[0], *(one for one in rounds[place] if one is not same[0])]
    return same[0].fit, search.best(same[0].fit), [*rounds[:place], named, *rounds[place + 1 :]]


def is_equivalent_to_term(problem: Problem, effect: Scored, kept: Fit, described: Solved) -> bool:
    """Whether an effect of the tool or its mounting changes the reading as a term that follows gravity does.

    It must do nearly the same to the forces or the torques, whichever the term acts on, and no harm to the others: a
    term has only the few coefficients that gain most, and the effect also changes what is coupled to them. If it has
    more parameters than the term, they must be worth their penalty.
    """
    term = described.terms[0]
    of_tool = isinstance(problem.catalogue[effect.hypothesis.effect].fit.search, (Linear, Ringing))
    more = effect.fit.degrees - kept.degrees - numbers_of(term)
    gain = effect.fit.log_likelihood - described.log_likelihood
    if term.drive != GRAVITY or not of_tool or (more > 0 and gain < PENALTY_PER_PARAMETER * more):
        return False
    of_effect, of_term = (kept.error - one.error for one in (effect.fit, described))
    power, apart = (of_term**2).sum(0), ((of_term - of_effect) ** 2).sum(0)
    harm = (effect.fit.error**2 - kept.error**2).sum(0)
    total = float(power.sum())
    own = next((part for part in (FORCES, ~FORCES) if power[part].sum() > CLOSE * total), FORCES | ~FORCES)
    return bool(apart[own].sum() < NEARLY * power[own].sum() and harm[~own].sum() < LEAST_SHARE_OF_GAP * total)


def _rivals(problem: Problem, base: Fit, accepted: Fit, found: Sequence[tuple[float, Solved]]) -> tuple[Term, ...]:
    """Terms that are as good as a single effect that is an event or a pull, and describe something else.

    An event does not follow the motion by chance, and a cable that is no better than a steady force is none.
    """
    names = [h.effect for h in accepted.hypotheses[len(base.hypotheses) :]]
    search = type(problem.catalogue[names[0]].fit.search) if len(names) == 1 else None
    if search not in SAME:
        return ()
    # Compared by likelihood, because merit penalises the parameters of an event of any shape.
    least = base.log_likelihood + CLOSE * (accepted.log_likelihood - base.log_likelihood)
    terms = [described.terms[0] for _, described in found if described.log_likelihood > least]
    return tuple(term for term in terms if term.drive != SAME[search])


def _holds(problem: Problem, hold_out: CrossValidation, base: Fit, fit: Fit, accepted: Fit, share: float) -> bool:
    """Whether a fit removes this share of what the accepted one removes on held-out blocks."""
    ours, theirs = (gap_removed(problem, base.error, hold_out(one, base.error).error) for one in (fit, accepted))
    return ours > share * theirs
