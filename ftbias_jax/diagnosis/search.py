"""Search for the causes of a log: greedy forward selection, then pairs from several first causes."""

from collections.abc import Callable, Collection
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple, TypeAlias

import numpy as np

from ftbias_jax.diagnosis.candidates import Scored, candidates, score
from ftbias_jax.diagnosis.evidence.estimates import parameters
from ftbias_jax.diagnosis.evidence.gap import (
    CrossValidation,
    excess_by_channel,
    excess_over_quiet,
    gap_removed,
    least_beside_joints,
    nats_of_joints,
)
from ftbias_jax.diagnosis.hypothesis import is_sudden
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.proposals.ringing import is_plausible
from ftbias_jax.diagnosis.proposals.series import Dictionary, make_dictionary
from ftbias_jax.diagnosis.regression.fit import Fit, fit, log_likelihood_gain, projection
from ftbias_jax.diagnosis.thresholds import (
    BEAM,
    BEAM_SHARE,
    LEAST_BESIDE,
    LEAST_GAIN,
    LEAST_SHARE_OF_GAP,
    LEAST_SIGMAS,
    MOST_CAUSES,
    MOST_JUDGED,
    NEARLY,
    STEADY,
    SURE,
)
from ftbias_jax.runtime.jax_config import same_precision
from ftbias_jax.runtime.progress import silent

Rounds: TypeAlias = list[list[Scored]]
"""Candidates of each round, the accepted one first; the last round may have added none."""


class Threshold(NamedTuple):
    """Requirements on a cause in addition to those accepted so far."""

    elsewhere: Problem
    """Logs without the times of the accepted contacts, which exceed all else and whose shape is never exact."""
    least: float
    """Mean square gap that it must remove there, in noise variances."""
    least_of_slow: float = LEAST_SIGMAS**2
    """The same for a slow effect on the bias: beside causes that all follow the motion it is no error of their form."""


class Search(NamedTuple):
    """Search for the causes of one problem."""

    problem: Problem
    start: Fit
    """Nominal model with the parameters that are fitted together with all causes."""
    hold_out: CrossValidation
    """Evaluates a fit on held-out blocks of the logs."""
    dictionary: Callable[[], Dictionary]
    """Returns the whitened series that may be proposed."""
    without: Collection[str] = ()
    """Effects that may not be named."""
    progress: Callable[[str], None] = silent
    """Called with the name of each stage as it begins."""

    def best(self) -> tuple[Fit, Rounds]:
        """Causes found greedily, or, where these are two, a better pair that begins with another first cause."""
        accepted, rounds = self.grow([])
        count = self._causes(accepted)
        left, settled = gap_of(self.problem, accepted), count <= 2
        if count > 1 and (LEAST_SIGMAS**2 if settled else 0) < left < NEARLY * gap_of(self.problem, self.start):
            for other in filter(self._is_possible, other_firsts(rounds[0], accepted)):
                self.progress("trying other pairs of causes")
                first = [other, *(s for s in rounds[0] if s is not other)]
                trial, trial_rounds = self._replace(progress=silent).grow([first], most=2)
                if score(trial, accepted) > LEAST_GAIN:
                    accepted, rounds = trial, trial_rounds
        return accepted, rounds

    def grow(self, rounds: Rounds, most: int = MOST_CAUSES) -> tuple[Fit, Rounds]:
        """Add causes greedily to those of earlier rounds, up to this number."""
        accepted, rounds = (rounds[-1][0].fit if rounds else self.start), list(rounds)
        while (count := self._causes(accepted)) < most:
            threshold, excluded = self.threshold(accepted), set(self.without)
            if rounds and gap_of(threshold.elsewhere, accepted) <= threshold.least:
                if _left_somewhere(threshold.elsewhere, accepted) <= threshold.least_of_slow:
                    break
                excluded |= {name for name in self.problem.catalogue if _follows_motion(self.problem, name)}
            self.progress(f"looking for cause {count + 1} of at most {most}")
            scored = candidates(self.problem, self.dictionary, accepted, excluded, all_smooth=not count)
            best = next((s for s in scored[:MOST_JUDGED] if self.is_acceptable(threshold, accepted, s)), None)
            rounds.append([best, *(s for s in scored if s is not best)] if best else scored)
            if best is None:
                break
            accepted = best.fit
            redundant = self.without_redundant(accepted)
            if redundant is not None:
                accepted, rounds = redundant, self.rounds_of(redundant, rounds)
        return accepted, rounds

    def _causes(self, accepted: Fit) -> int:
        return len(accepted.hypotheses) - len(self.start.hypotheses)

    def threshold(self, accepted: Fit) -> Threshold:
        """Requirements on one more cause."""
        touched = _touched(self.problem, accepted)
        elsewhere = self.problem.without(touched)
        least = max(LEAST_SIGMAS**2, least_beside_joints(self.problem))
        if not self._causes(accepted):
            return Threshold(elsewhere, least)
        local = np.repeat([h.local for h in accepted.hypotheses], [len(h.shapes) for h in accepted.hypotheses])
        _, (untouched,) = projection(accepted.columns.series[local])(self.start.error[None])
        gap = gap_of(elsewhere, self.start._replace(error=untouched))
        least = max(least, LEAST_SHARE_OF_GAP * gap)
        all_follow = all(_follows_motion(self.problem, h.effect) for h in accepted.hypotheses)
        return Threshold(elsewhere, least, LEAST_SIGMAS**2 if all_follow else least)

    def is_acceptable(self, threshold: Threshold, accepted: Fit, trial: Scored) -> bool:
        """Whether one more cause is possible, gains enough, consistently, and removes enough on held-out blocks."""
        effect = self.problem.catalogue[trial.hypothesis.effect]
        sudden = is_sudden(self.problem, effect)
        gain, stderr = log_likelihood_gain(self.problem, trial.fit.error, accepted.error)
        by_joints = nats_of_joints(self.problem) if _follows_motion(self.problem, effect.name) else 0.0
        if trial.nats <= max(LEAST_GAIN, by_joints) or not (sudden or gain > STEADY * stderr):
            return False
        if not is_plausible(self.problem, accepted, trial.fit) or not self._is_possible(trial):
            return False
        if trial.hypothesis.local and not self.stands_out(accepted, trial.fit):
            return False
        held = self.hold_out(trial.fit, accepted.error)
        if not sudden and held.nats < SURE * held.nats_by_noise:
            return False
        if gap_removed(threshold.elsewhere, accepted.error, held.error) > threshold.least:
            return True
        slow = effect.stage == "bias" and not sudden
        return slow and self._removes_itself(threshold, accepted, trial.fit, held.error)

    def _is_possible(self, trial: Scored) -> bool:
        possible = self.problem.catalogue[trial.hypothesis.effect].fit.possible
        return possible is None or possible(*parameters(self.problem, trial.fit, trial.hypothesis))

    def _removes_itself(self, threshold: Threshold, accepted: Fit, trial: Fit, unseen: np.ndarray) -> bool:
        """Whether a slow effect itself removes all that is left, and not the other causes refitted together with it.

        If a gap remains, it may be a form error of the other causes, and the slow effect a part of that.
        """
        alone = fit(self.problem, accepted.hypotheses, trial)
        removed = gap_removed(threshold.elsewhere, alone.error, unseen)
        all_gone = gap_of(threshold.elsewhere, trial) <= LEAST_SIGMAS**2
        return all_gone and removed > threshold.least_of_slow and score(trial, alone) > LEAST_GAIN

    def stands_out(self, accepted: Fit, trial: Fit) -> bool:
        """Whether contacts explain much of what happens in their own time, and not just the remainder of the causes."""
        inside = _touched(self.problem, trial)
        first, now, then = ((one.error[inside] ** 2).sum() for one in (self.start, accepted, trial))
        return bool(now - then > LEAST_BESIDE * (first - now))

    def without_redundant(self, accepted: Fit) -> Fit | None:
        """Fit without an earlier cause that later ones made redundant; None if there is none."""
        for h in accepted.hypotheses[len(self.start.hypotheses) : -1]:
            rest = fit(self.problem, accepted.beside(h), accepted)
            if score(accepted, rest) < LEAST_GAIN:
                return rest
        return None

    def rounds_of(self, accepted: Fit, rounds: Rounds) -> Rounds:
        """Rounds of the remaining causes, the first of each fitted together with the remaining ones before it."""
        kept = {h.effect for h in accepted.hypotheses}
        rounds = [scored for scored in rounds if scored[0].hypothesis.effect in kept]
        return with_first_fits(self.problem, rounds, accepted, len(self.start.hypotheses))


def with_first_fits(problem: Problem, rounds: Rounds, accepted: Fit, before: int) -> Rounds:
    """Rounds whose first candidates are the hypotheses of a fit from index ``before`` on, fitted with those before."""
    fits = [fit(problem, accepted.hypotheses[: before + i], accepted) for i in range(1, len(rounds))]
    pairs = zip(rounds, [*fits, accepted], strict=False)
    return [[best._replace(fit=own), *others] for (best, *others), own in pairs]


def search(
    problem: Problem,
    start: Fit,
    hold_out: CrossValidation,
    without: Collection[str] = (),
    progress: Callable[[str], None] = silent,
) -> tuple[Fit, Rounds]:
    """Fit of all accepted effects, and the rounds that found them; arguments as in ``Search``."""
    with ThreadPoolExecutor(1) as worker:
        dictionary = worker.submit(
            same_precision(make_dictionary), problem
        ).result  # made while other effects are tried
        return Search(problem, start, hold_out, dictionary, without, progress).best()


def gap_of(problem: Problem, found: Fit) -> float:
    """Mean square gap over the channels, in units of one sample's noise variance."""
    return float(np.maximum(excess_by_channel(problem, found.error), 0).mean())


def enough(problem: Problem, base: Fit) -> float:
    """Mean square gap, in noise variances, that may remain of the gap of a fit when everything is explained."""
    return max(LEAST_SIGMAS**2, LEAST_SHARE_OF_GAP * gap_of(problem, base))


def _left_somewhere(problem: Problem, found: Fit) -> float:
    """As ``gap_of``, but a gap in a few blocks counts even if all others have less than expected.

    Then only effects that do not follow the motion are searched: all others could be due to the joints' error, which is
    assumed to explain what is left.
    """
    return float(np.maximum(excess_over_quiet(problem, found.error), 0).mean())


def _follows_motion(problem: Problem, effect: str) -> bool:
    entry = problem.catalogue[effect]
    return entry.stage != "bias" and not is_sudden(problem, entry)


def _touched(problem: Problem, found: Fit) -> np.ndarray:
    """(U,) bins within the contacts of a fit."""
    shapes = [shape for h in found.hypotheses if h.local for shape in h.shapes]
    return np.any([np.zeros(len(problem.t), bool), *(shape != 0 for shape in shapes)], axis=0)


def other_firsts(first: list[Scored], accepted: Fit) -> list[Scored]:
    """Strong candidates of the first round that are not among the causes."""
    named = {h.effect for h in accepted.hypotheses}
    strong = [s for s in first[1:] if s.nats > BEAM_SHARE * first[0].nats and s.hypothesis.effect not in named]
    return strong[: BEAM - 1]
