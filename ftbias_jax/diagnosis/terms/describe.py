"""When terms come into a diagnosis, and beside which effects of the catalogue."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ftbias_jax.diagnosis.candidates import Scored
from ftbias_jax.diagnosis.evidence.cross_validation import Judge, gap_removed
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.diagnosis.terms.library import merit_of
from ftbias_jax.diagnosis.terms.select import Search, Step, numbers_of
from ftbias_jax.diagnosis.thresholds import AS_WELL, CLEARLY
from ftbias_jax.model.effects.catalogue import CATALOGUE


class Description(NamedTuple):
    """Effects of the catalogue that stay, and terms beside them."""

    kept: Fit
    """The effects."""
    fit: Fit
    """The effects with the terms."""
    steps: tuple[Step, ...]
    """One a term."""
    search: Search


def describe(
    problem: Problem,
    hold_out: Judge,
    base: Fit,
    accepted: Fit,
    rounds: list[list[Scored]],
    explained: bool,
    fast: Sequence[float] = (),
) -> Description | None:
    """Terms for what the catalogue does not explain; None if its answer stands.

    Args:
        problem: of the logs.
        hold_out: judges fits.
        base: the believed model.
        accepted: the effects that were found.
        rounds: candidates of each, the accepted one first.
        explained: they explain the logs.
        fast: Hz of lines in the single samples.
    """
    names = [h.effect for h in accepted.hypotheses]
    if explained and len(names) == 1 and not problem.catalogue[names[0]].fit.any_shape:
        return None
    search = Search(problem, base, hold_out, fast)
    found = search.best(base)
    kept = base
    for scored in rounds[: len(names)]:
        gain = scored[0].fit.log_likelihood - kept.log_likelihood
        # What the caller brought has a name and a remedy: a term of the same form does not take its place.
        ahead = 1.0 if scored[0].hypothesis.effect in CATALOGUE else CLEARLY
        if found and found[0][0] > ahead * merit_of(gain, scored[0].fit.degrees - kept.degrees):
            break  # a single term does better
        kept = scored[0].fit
        found = search.best(kept)
    if len(kept.hypotheses) == len(names) and explained:
        return None
    steps = search.grow(kept, found)
    if not steps and (explained or len(kept.hypotheses) == len(names)):
        return None
    fit = steps[-1].described.fit if steps else kept
    if explained:
        numbers = kept.degrees + sum(numbers_of(term) for term in steps[-1].described.terms)
        ours, theirs = (
            merit_of(one.log_likelihood - base.log_likelihood, count)
            for one, count in ((fit, numbers), (accepted, accepted.degrees))
        )
        if ours < CLEARLY * theirs or not _holds(problem, hold_out, base, fit, accepted):
            return None
    moved = kept._replace(z=fit.z, coefficients=fit.coefficients) if kept.hypotheses else kept
    return Description(moved, fit, tuple(steps), search)


def _holds(problem: Problem, hold_out: Judge, base: Fit, fit: Fit, accepted: Fit) -> bool:
    """Whether a fit removes as much of the gap as the accepted one on blocks that neither has seen."""
    ours, theirs = (gap_removed(problem, base.error, hold_out(one, base.error).error) for one in (fit, accepted))
    return ours > AS_WELL * theirs
