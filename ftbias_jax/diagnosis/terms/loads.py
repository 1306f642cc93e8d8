"""Loads that are picked up and put down: whether they explain a log completely, and contact during the hand-overs."""

from dataclasses import replace

import numpy as np

from ftbias_jax.diagnosis import thresholds
from ftbias_jax.diagnosis.evidence.gap import CrossValidation
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression import fit as fits
from ftbias_jax.diagnosis.regression.evaluate import whitened
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.diagnosis.regression.score_test import prepare_fit
from ftbias_jax.diagnosis.search import enough, gap_of
from ftbias_jax.diagnosis.terms.dictionary import make_dictionary, rank
from ftbias_jax.diagnosis.terms.fit_terms import Solved, fit_terms, improve
from ftbias_jax.diagnosis.terms.grid import of_switches
from ftbias_jax.diagnosis.terms.select import is_lifted, state_of_problem
from ftbias_jax.diagnosis.tool_first import with_tool
from ftbias_jax.model.effects.terms.columns import added
from ftbias_jax.model.effects.terms.types import State, Term


def all_carried(problem: Problem, base: Fit) -> Problem | None:
    """Problem without contact during hand-overs if a carried load explains the log completely; None if it does not.

    A load that is picked up in the middle of a log then closes the gap alone, and no further search is needed. Nothing
    that acts all along does, and searching for effects of any shape would take longest. A tool that differs from the
    setup is not a load present nearly all along. The gap must also close on held-out blocks, because a load at
    arbitrary times fits much of the noise.
    """
    if gap_of(problem, base) <= enough(problem, base):
        return None
    state = state_of_problem(problem, base)
    loads = of_switches(problem, state, base, ("payload",))
    dictionary = make_dictionary(problem, state, [term for term in loads if np.min(term.parameters["time"]) > 0])
    beside = prepare_fit(base)
    for ranked in rank(dictionary, beside)[:1]:
        if not _may_be_all(problem, base, improve(problem, state, beside, (ranked.term,), steps=0)):
            return None
        load, error = _timed(problem, state, improve(problem, state, beside, (ranked.term,)))
        if is_lifted(load):
            return None
        freed = without_touches(problem, load, error)
        start = fits.base(freed)
        least = enough(freed, start)
        beside = prepare_fit(start)
        one = improve(freed, state, beside, (load,))
        closed = gap_of(freed, start._replace(error=one.error)) <= least
        if closed and float((one.error**2).sum()) / 2 <= -with_tool(freed, start).log_likelihood:
            unseen = CrossValidation(freed)(fit_terms(freed, state, beside, one.terms).fit, start.error)
            return freed if gap_of(freed, start._replace(error=unseen.error)) <= least else None
    return None


def _may_be_all(problem: Problem, base: Fit, rough: Solved) -> bool:
    """Whether a load removes nearly all of the gap outside its hand-over times, which may still be inexact."""
    near = _away(problem, rough.terms[0]) < 2 * thresholds.HANDOVER
    elsewhere = problem.without(near)
    left = gap_of(elsewhere, base._replace(error=rough.error))
    return left <= max(thresholds.FAINT**2 * gap_of(elsewhere, base), enough(problem, base))


def _away(problem: Problem, load: Term) -> np.ndarray:
    """(U,) s from every bin to the nearest hand-over time of a load."""
    return np.abs(problem.t[:, None] - np.ravel(load.parameters["time"])).min(1)


def _timed(problem: Problem, state: State, found: Solved) -> tuple[Term, np.ndarray]:
    """Load with times that most bins near them agree on, whatever the outliers are, and the innovations."""
    (load,), error = found.terms, found.error
    step = float(np.median(np.diff(problem.t)))
    shifts = np.arange(-thresholds.HANDOVER, thresholds.HANDOVER, step)
    for k, time in enumerate(np.ravel(load.parameters["time"])):
        others = np.delete(np.ravel(load.parameters["time"]), k)
        moved = [
            np.append(others, time + by) for by in shifts if not ((others - time) * (others - time - by) < 0).any()
        ]
        loads = [replace(load, parameters={**load.parameters, "time": np.sort(times)}) for times in moved]
        by = np.stack([np.asarray(added(np, one, state)) for one in loads]) - added(np, load, state)
        errors = error + whitened(problem, by)
        near = np.abs(problem.t - time) < 2 * thresholds.HANDOVER
        best = int(np.minimum(errors[:, near] ** 2, thresholds.TOUCHED**2).sum((1, 2)).argmin())
        load, error = loads[best], errors[best]
    return load, error


def without_touches(problem: Problem, load: Term, error: np.ndarray) -> Problem:
    """Problem in which the residual of a load near its times counts as noise, because fingers close, press and settle.

    During a hand-over the part touches its support, and the contact force is no weight. The innovations with the load
    are (U, 6), in standard deviations.
    """
    touched = (_away(problem, load) < thresholds.HANDOVER)[:, None] & (np.abs(error) > thresholds.TOUCHED)
    return problem.louder(np.where(touched, error**2 * problem.variance, 0.0))
