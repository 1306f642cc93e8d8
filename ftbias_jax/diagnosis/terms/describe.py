"""When terms come into a diagnosis, and beside which effects of the catalogue."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.candidates import Scored
from ftbias_jax.diagnosis.evidence.gap import Judge, gap_removed
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.proposals.entries import entries_of, evidence
from ftbias_jax.diagnosis.proposals.touches import takes_most
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.diagnosis.regression.score_test import stand
from ftbias_jax.diagnosis.regression.series import shaped
from ftbias_jax.diagnosis.search import gap_of
from ftbias_jax.diagnosis.terms.fit_terms import Solved
from ftbias_jax.diagnosis.terms.library import merit_of
from ftbias_jax.diagnosis.terms.select import Search, Step, numbers_of
from ftbias_jax.diagnosis.thresholds import (
    AS_WELL,
    CLEARLY,
    CLOSE,
    LEAST_GAIN,
    LEAST_SHARE_OF_GAP,
    NATS_PER_DEGREE,
    NEARLY,
)
from ftbias_jax.model.effects.catalogue import CATALOGUE
from ftbias_jax.model.effects.fitting import Linear, Pull, Ringing, Touches
from ftbias_jax.model.effects.fitting import Step as StepSearch
from ftbias_jax.model.effects.terms.types import Term

FORCES = np.repeat([True, False], 3)
GRAVITY = "orientation"
"""The drive of terms that may be a tool or a mounting that is not as stated."""
OF_AN_EVENT = 8
"""Numbers: start, end, and a wrench."""
SAME: dict[type, str] = {StepSearch: "time", Touches: "time", Pull: "position"}
"""Search of an effect that takes many shapes -> the drive of terms that say the same of it."""


class Description(NamedTuple):
    """Effects of the catalogue that stay, and terms beside them."""

    kept: Fit
    """The effects."""
    rounds: list[list[Scored]]
    """Candidates of each, the one that stays first."""
    fit: Fit
    """The effects with the terms."""
    steps: tuple[Step, ...]
    """One a term."""
    search: Search


class Outcome(NamedTuple):
    """What terms do to the answer of the catalogue."""

    description: Description | None = None
    """Takes its place; None if it stands."""
    rivals: tuple[Term, ...] = ()
    """If it stands: terms that explain the logs as well as the event that it names."""


def describe(
    problem: Problem,
    hold_out: Judge,
    base: Fit,
    accepted: Fit,
    rounds: list[list[Scored]],
    explained: bool,
    fast: Sequence[float] = (),
) -> Outcome:
    """Terms for what the catalogue does not explain, or ``explained`` by an event or a pull that a term may stand for.

    The nominal model is ``base``, with the effects of the tool that stay beside all else, and ``accepted`` has those
    and the effects that were found in these rounds; ``fast`` are Hz of lines in the single samples.
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
        # What the caller brought has a name and a remedy: a term of the same form does not take its place.
        ahead = 1.0 if scored[0].hypothesis.effect in CATALOGUE else CLEARLY
        better = found and found[0][0] > ahead * merit_of(gain, _numbers(scored[0].fit) - _numbers(kept))
        # Contact that takes most of a log leaves too little free motion to judge a term of the motion by.
        unjudged = takes_most(scored[0].hypothesis, problem) and found[0][1].terms[0].drive != SAME[Touches]
        if better and not unjudged and not says(problem, scored[0], kept, found[0][1]):
            break  # a single term does better
        kept = scored[0].fit
        found = search.best(kept)
    if not explained:
        kept, found, said = _by_name(search, kept, found, said)
    stands = [h.effect for h in kept.hypotheses] == names
    answer = Outcome(rivals=_rivals(problem, base, accepted, first) if explained else ())
    theirs = _merit(base, accepted)
    # One term in the place of several effects is the simpler answer, and need not be clearly better; but what follows
    # gravity stands for nearly any tool with gains and leaks.
    several = len(found_names) > 1 and CATALOGUE.keys() >= set(found_names)
    simpler = several and bool(first) and first[0][1].terms[0].drive != GRAVITY
    if stands and explained and simpler and _merit(base, base, first[0][1].terms, first[0][1].log_likelihood) > theirs:
        kept, found, said, stands = base, first, rounds[: len(base.hypotheses)], False
    if stands and explained:
        return answer
    steps = search.grow(kept, found)
    # A term that does better, but not on unseen blocks, takes no place of effects that explain nearly all.
    if not steps and (explained or stands or gap_of(problem, accepted) < NEARLY * gap_of(problem, base)):
        return answer
    fit = steps[-1].described.fit if steps else kept
    # Nor does one that removes less of the gap than they do.
    if not explained and not stands and not _holds(problem, hold_out, base, fit, accepted, 1 - NEARLY):
        return answer
    leaks = not stands and entries_of(problem, accepted)
    if leaks and evidence(problem, accepted) - evidence(problem, fit) > LEAST_GAIN:
        return answer  # leaks between six channels are thirty numbers, and no fewer
    if explained:
        ours = _merit(base, kept, steps[-1].described.terms, fit.log_likelihood)
        if ours < (1.0 if simpler else CLEARLY) * theirs or not _holds(problem, hold_out, base, fit, accepted, AS_WELL):
            return answer
    moved = kept._replace(z=fit.z, coefficients=fit.coefficients) if kept.hypotheses else kept
    return Outcome(Description(moved, said, fit, tuple(steps), search))


def _merit(base: Fit, kept: Fit, terms: Sequence[Term] = (), log_likelihood: float | None = None) -> float:
    """Of effects, and of terms beside them with which they have this likelihood, over the nominal model."""
    reached = kept.log_likelihood if log_likelihood is None else log_likelihood
    return merit_of(reached - base.log_likelihood, _numbers(kept) + sum(map(numbers_of, terms)))


def _numbers(found: Fit) -> int:
    """Free numbers of a fit that its form has: of an event of any shape, when it was, and how much.

    The hats that make up its shape are no form.
    """
    events = [(len(h.shapes), len(shaped(h))) for h in found.hypotheses if h.local]
    return found.degrees - sum(6 * hats - OF_AN_EVENT * count for hats, count in events)


def follows_something(problem: Problem, base: Fit, hold_out: Judge) -> bool:
    """Whether one term may explain nearly all, to first order: what a hand does follows nothing."""
    ranked = Search(problem, base, hold_out).ranked(stand(base))
    gap = -base.log_likelihood - (problem.samples > 0).sum() / 2
    return bool(ranked and ranked[0].merit > (1 - NEARLY) * gap)


def _by_name(
    search: Search, kept: Fit, found: list[tuple[float, Solved]], rounds: list[list[Scored]]
) -> tuple[Fit, list[tuple[float, Solved]], list[list[Scored]]]:
    """Effects that stay with one more, where the best term beside them says the same as an effect of the catalogue.

    A torque that is linear in the direction of gravity is a wrong centre of mass: it is told by its name, although
    the gap that other things leave keeps the effect from being found by itself.
    """
    place = len(kept.hypotheses)
    if not found or place >= len(rounds):
        return kept, found, rounds
    same = [one for one in rounds[place] if says(search.problem, one, kept, found[0][1])]
    if not same:
        return kept, found, rounds
    named = [same[0], *(one for one in rounds[place] if one is not same[0])]
    return same[0].fit, search.best(same[0].fit), [*rounds[:place], named, *rounds[place + 1 :]]


def says(problem: Problem, effect: Scored, kept: Fit, described: Solved) -> bool:
    """Whether an effect of the tool or its mounting does to the reading what a term that follows gravity does.

    It does nearly the same to the forces or the torques, whichever the term acts on, and no harm to the others: a term
    is of the few numbers that gain most, and the effect changes what goes with them. If it has more numbers than the
    term, they are worth their price.
    """
    term = described.terms[0]
    of_tool = isinstance(problem.catalogue[effect.hypothesis.effect].fit.search, (Linear, Ringing))
    more = effect.fit.degrees - kept.degrees - numbers_of(term)
    gain = effect.fit.log_likelihood - described.log_likelihood
    if term.drive != GRAVITY or not of_tool or (more > 0 and gain < NATS_PER_DEGREE * more):
        return False
    of_effect, of_term = (kept.error - one.error for one in (effect.fit, described))
    power, apart = (of_term**2).sum(0), ((of_term - of_effect) ** 2).sum(0)
    harm = (effect.fit.error**2 - kept.error**2).sum(0)
    total = float(power.sum())
    own = next((part for part in (FORCES, ~FORCES) if power[part].sum() > CLOSE * total), FORCES | ~FORCES)
    return bool(apart[own].sum() < NEARLY * power[own].sum() and harm[~own].sum() < LEAST_SHARE_OF_GAP * total)


def _rivals(problem: Problem, base: Fit, accepted: Fit, found: Sequence[tuple[float, Solved]]) -> tuple[Term, ...]:
    """Terms that do as well as a single effect that is an event or a pull, and say something else.

    What follows the motion makes no event by chance, and a cable that is no better than a steady force is none.
    """
    names = [h.effect for h in accepted.hypotheses[len(base.hypotheses) :]]
    search = type(problem.catalogue[names[0]].fit.search) if len(names) == 1 else None
    if search not in SAME:
        return ()
    # Not by merit, which counts the numbers of an event of any shape against it.
    least = base.log_likelihood + CLOSE * (accepted.log_likelihood - base.log_likelihood)
    terms = [described.terms[0] for _, described in found if described.log_likelihood > least]
    return tuple(term for term in terms if term.drive != SAME[search])


def _holds(problem: Problem, hold_out: Judge, base: Fit, fit: Fit, accepted: Fit, share: float) -> bool:
    """Whether a fit removes such a share of what the accepted one does on blocks that neither has seen."""
    ours, theirs = (gap_removed(problem, base.error, hold_out(one, base.error).error) for one in (fit, accepted))
    return ours > share * theirs
