"""Selection of terms for what the catalogue does not explain: the best is added while it improves held-out blocks."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis import thresholds
from ftbias_jax.diagnosis.evidence.gap import CrossValidation, HeldOut, gap_removed, least_beside_joints, nats_of_joints
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.evaluate import readings
from ftbias_jax.diagnosis.regression.fit import Fit, log_likelihood_gain
from ftbias_jax.diagnosis.regression.fit import base as fit_of_nothing
from ftbias_jax.diagnosis.regression.score_test import PreparedFit, prepare_fit
from ftbias_jax.diagnosis.samples.bins import fill_up
from ftbias_jax.diagnosis.search import enough, gap_of
from ftbias_jax.diagnosis.terms.dictionary import Dictionary, Ranked, make_dictionary, merit_of, rank, times_of
from ftbias_jax.diagnosis.terms.fit_terms import Described, Solved, fit_terms, improve
from ftbias_jax.diagnosis.terms.grid import free_names, make_grid, terms_from_residual
from ftbias_jax.model.effects.terms.columns import added, columns, has_point, state_of
from ftbias_jax.model.effects.terms.parse import goes_by_clock, section_of
from ftbias_jax.model.effects.terms.types import State, Term

STARTS = {"attraction": 5, "barrier": 2, "surface": 2, "local": 3}
"""Number of grid points from which forms with several maxima are fitted."""
FINE = 13
"""Number of times tried in each of two refinements of a switching time."""
ROUGH_STEPS, FURTHER_STEPS = 5, 10
"""Steps of a first fit, and further steps of the best of these fits."""
ROUGHLY = 1e-3
"""Share of its total gain that the last step of such a fit gains less than."""

SHARED = ("gravity", "period")
"""Fields that belong to all logs and have no time axis."""


class Step(NamedTuple):
    """One more term, with all that were chosen before it."""

    described: Described
    """All terms so far, the new one last."""
    rivals: tuple[Term, ...]
    """Best term of each other drive that describes the logs as well in its place."""
    held: HeldOut
    """Evaluation on held-out blocks, over the previous step."""
    share: float
    """Mean square gap that it removes there, in noise variances."""


class Search:
    """Search for the terms of one problem; the grid is whitened once."""

    def __init__(self, problem: Problem, base: Fit, hold_out: CrossValidation, fast: Sequence[float] = ()) -> None:
        """Whiten the grid; fast: Hz of spectral lines in the individual samples."""
        self.problem, self.base, self.hold_out = problem, base, hold_out
        self.state: State = state_of_problem(problem, base)
        theta = np.asarray(problem.parts[0].signals.model.theta)
        self.point: np.ndarray = theta[1:4] / theta[0]  # the stated centre of mass
        grid = make_grid(problem, self.state, self.point, base, fast)
        self.dictionary: Dictionary = make_dictionary(problem, self.state, grid)

    def best(self, start: Fit) -> list[tuple[float, Solved]]:
        """Most promising terms, fitted together with the effects of a fit, with their merits, best first."""
        prepared_fit = prepare_fit(start)
        ranked = self.ranked(prepared_fit)
        top = ranked[0].merit if ranked else 0.0
        worth = [one for one in _of_each_drive(ranked) if one.merit > max(_worth(one.term) * top, 0.0)]
        few = [one for place, one in enumerate(worth) if place < thresholds.TERMS_FITTED or one.term.form in STARTS]

        def improved(term: Term, steps: int) -> tuple[float, Solved]:
            one = improve(self.problem, self.state, prepared_fit, (term,), steps, ROUGHLY)
            return _merit(one.log_likelihood - start.log_likelihood, one.terms[0]), one

        timed = (self._timed(one.term, prepared_fit) if times_of(one.term) == 1 else one.term for one in few)
        every = (improved(term, ROUGH_STEPS) for term in timed)
        found = sorted((one for one in every if not is_lifted(one[1].terms[0])), key=_order)
        for form in STARTS:  # the fit from the best of several starts is continued
            best = next((i for i, (_, one) in enumerate(found) if one.terms[0].form == form), None)
            if best is not None and found[best][0] > thresholds.TERM_GOES_ON * found[0][0]:
                found[best] = improved(found[best][1].terms[0], FURTHER_STEPS)
        return sorted(found, key=_order)

    def ranked(self, prepared_fit: PreparedFit) -> list[Ranked]:
        """Grid ranked in addition to a fit, best first, with terms suggested by the spectra of its residual."""
        ranked, start = rank(self.dictionary, prepared_fit), prepared_fit.fit
        if start is not self.base:
            further = terms_from_residual(self.problem, self.state, self.point, start)
            ranked += rank(make_dictionary(self.problem, self.state, further), prepared_fit)
        return sorted(ranked, key=lambda one: -one.merit)

    def _timed(self, term: Term, prepared_fit: PreparedFit) -> Term:
        """Term with the best switching time near its own: the likelihood is not smooth in it."""
        reach = max(self.problem.durations) / FINE
        for _ in range(2):
            times = np.maximum(float(term.parameters["time"]) + reach * np.linspace(-1, 1, FINE), 0.0)
            terms = [replace(term, parameters={**term.parameters, "time": time}, used=()) for time in times]
            term = rank(make_dictionary(self.problem, self.state, terms), prepared_fit)[0].term
            reach /= FINE / 2
        return term

    def grow(self, start: Fit, first: list[tuple[float, Solved]]) -> list[Step]:
        """Add terms to a fit while each removes enough on held-out blocks; ``first`` is ``best(start)``."""
        steps: list[Step] = []
        least = max(enough(self.problem, self.base), least_beside_joints(self.problem))
        # The filter's bias follows what goes by the clock; it is told where it is a share of all that was missing.
        of_clock = max(least, enough(self.problem, fit_of_nothing(self.problem)))
        now = start
        while len(steps) < thresholds.MOST_TERMS and (not steps or gap_of(self.problem, now) > least):
            chosen = steps[-1].described.terms if steps else ()
            found = self.best(now) if steps else first
            tried = (self._step(start, now, chosen, found, place) for place in range(min(2, len(found))))
            step = next(filter(None, tried), None)
            if step is None:
                break
            if step.share <= (of_clock if goes_by_clock(section_of(step.described.terms[-1])) else least):
                break
            steps.append(step)
            now = step.described.fit
        return steps

    def _step(
        self, start: Fit, now: Fit, chosen: tuple[Term, ...], found: list[tuple[float, Solved]], place: int
    ) -> Step | None:
        """Candidate fitted with all chosen terms and judged on held-out blocks; None if it fails."""
        problem, (_, one) = self.problem, found[place]
        described = fit_terms(problem, self.state, prepare_fit(start), (*chosen, *one.terms))
        gain = described.fit.log_likelihood - now.log_likelihood
        difference, stderr = log_likelihood_gain(problem, described.fit.error, now.error)
        term, least = one.terms[0], thresholds.LEAST_GAIN
        if term.drive == "acceleration" and term.form != "payload":  # a response to it fits the joints' error as well
            least = max(least, nats_of_joints(problem))
        if difference < thresholds.STEADY * stderr or _merit(gain, term) < least:
            return None
        if any(cancels(term, self.state) or is_lifted(term) for term in described.terms):
            return None
        reference = self.hold_out(now, now.error).error
        held = self.hold_out(described.fit, reference)
        if held.nats < thresholds.STEADY * held.nats_stderr:
            return None
        share = gap_removed(problem, reference, held.error)
        return Step(described, self._rivals(now, [d for _, d in found], place), held, share)

    def _rivals(self, now: Fit, found: list[Solved], place: int) -> tuple[Term, ...]:
        best = found[place]
        gain = best.log_likelihood - now.log_likelihood
        rivals: dict[str, Term] = {}
        drive = best.terms[0].drive
        for other in found:
            term = other.terms[0]
            lost, stderr = log_likelihood_gain(self.problem, best.error, other.error)
            close = lost < thresholds.FORM_LOSS * gain or (
                lost < thresholds.ALIKE * stderr and lost < (1 - thresholds.CLOSE) * gain
            )
            if term.drive != drive and close:
                rivals.setdefault(term.drive, term)
        return tuple(rivals.values())


def state_of_problem(problem: Problem, fit: Fit) -> State:
    """State of all logs concatenated, (U, ...); the load is the reading that the fit predicts."""
    load = readings(problem, fit.z[None])[0]
    pieces, first = [], 0
    for part in problem.parts:
        own, size = slice(first, first + part.used), len(part.signals.t)
        first += part.used
        counts = fill_up(np.maximum(problem.samples[own].max(1), 1.0), size, 1.0)
        period = float(np.median(np.diff(np.asarray(part.signals.t)[: part.used])) / np.median(counts[: part.used]))
        whole = state_of(np, part.signals, fill_up(load[own], size, 0.0), part.nominal, counts, period)
        pieces.append(State(*(x if k in SHARED else x[: part.used] for k, x in whole._asdict().items())))
    pairs = zip(State._fields, zip(*pieces, strict=True), strict=True)
    return State(*(of_parts[0] if name in SHARED else np.concatenate(of_parts) for name, of_parts in pairs))


def _order(found: tuple[float, Solved]) -> float:
    """Negative merit, for sorting; a spectral line precedes an equal wave of time, as its period recurs in the log."""
    merit, one = found
    return -merit - thresholds.LEAST_DIFFERENCE * (one.terms[0].drive == "frequency")


def is_gain_too(term: Term, state: State, noise_std: np.ndarray) -> bool:
    """Whether a term of orientation is equivalent to gains that differ by the sign of each channel's load.

    In slow motion a channel's load is the weight along its axis, so both describe the same.
    """
    if term.drive != "orientation":
        return False
    made, load = np.asarray(added(np, term, state)) / noise_std, np.asarray(state.load)
    left = 0.0
    for change, of_channel in zip((made - made.mean(0)).T, load.T, strict=True):
        sided = np.stack([np.ones_like(of_channel), np.maximum(of_channel, 0), np.minimum(of_channel, 0)], 1)
        left += float(((change - sided @ np.linalg.lstsq(sided, change, rcond=None)[0]) ** 2).sum())
    return left < (1 - thresholds.CLOSE) * len(made) * float(made.var(0).sum())


def numbers_of(term: Term) -> int:
    """Number of free parameters of a term, including its switching times."""
    return len(term.coefficients) + len(free_names(term)) + 3 * has_point(term) + times_of(term)


def _merit(gain: float, term: Term) -> float:
    return merit_of(gain, numbers_of(term))


def is_lifted(term: Term) -> bool:
    """Whether a load that is carried for some time would weigh less than nothing: something pushes the tool up then.

    What stays until the end may: a part that the setup's tool includes is put down.
    """
    times = np.ravel(term.parameters["time"]) if term.form == "payload" else np.zeros(0)
    ends = len(times) > 0 and len(times) % 2 == 0
    return bool(ends and times[0] > 0 and np.sum(term.coefficients) < 0)


def cancels(term: Term, state: State) -> bool:
    """Whether parts of a term are far larger than their sum, as where the motion hardly separates them."""
    each = columns(np, term, state) * np.asarray(term.coefficients)[None, :, None]
    parts, whole = each.std(0).max(0), each.sum(1).std(0)
    return bool((parts > thresholds.MOST_CANCELLED * whole).any())


def _worth(term: Term) -> float:
    return thresholds.TERM_WORTH_FAR if term.form in STARTS else thresholds.TERM_WORTH


def _of_each_drive(ranked: list[Ranked]) -> list[Ranked]:
    found: list[Ranked] = []
    seen: dict[str, dict[tuple[str, ...], int]] = {}
    for one in ranked:
        term = one.term
        forms = seen.setdefault(term.drive, {})
        key = (term.form, term.frame, term.acts_as)
        room = key in forms or len(forms) < thresholds.FORMS_OF_A_DRIVE or term.form in STARTS
        if forms.get(key, 0) < STARTS.get(term.form, 1) and room:
            forms[key] = forms.get(key, 0) + 1
            found.append(one)
    return found
