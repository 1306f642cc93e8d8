"""Which effects explain a log: the best one added while it earns it, pairs tried from several first causes."""

from __future__ import annotations

from collections.abc import Callable, Collection
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.candidates import Scored, candidates, score
from ftbias_jax.diagnosis.evidence.cross_validation import Judge, excess_by_channel, excess_over_quiet, gap_removed
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.proposals.ringing import is_plausible
from ftbias_jax.diagnosis.regression.dictionary import Library, make_library
from ftbias_jax.diagnosis.regression.fit import Fit, block_scores, fit, projection
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
from ftbias_jax.model.effects.fitting import SUDDEN
from ftbias_jax.model.effects.types import Effect
from ftbias_jax.runtime.jax_config import same_precision
from ftbias_jax.runtime.progress import silent


class Threshold(NamedTuple):
    """What a cause beside those accepted so far must do."""

    elsewhere: Problem
    """The logs without the times of the accepted contacts: these dwarf all else, and their shape is never exact."""
    least: float
    """Mean square gap that it must remove there, in noise variances."""
    least_of_slow: float = LEAST_SIGMAS**2
    """The same of a slow effect on the bias: beside causes that all follow the motion it is no error of their form."""


def search(
    problem: Problem,
    start: Fit,
    hold_out: Judge,
    without: Collection[str] = (),
    progress: Callable[[str], None] = silent,
) -> tuple[Fit, list[list[Scored]]]:
    """Add the best effect while it explains enough; once there are two, try pairs with other first causes.

    Args:
        problem: of the logs.
        start: the nominal model, with what is fitted beside all causes.
        hold_out: judges fits.
        without: effects that may not be named.
        progress: called with the name of each stage as it begins.

    Returns:
        the fit of all accepted effects, and for each of them all candidates of its round, best first; the last round
        is the one that added nothing.
    """
    with ThreadPoolExecutor(1) as worker:
        library = worker.submit(same_precision(make_library), problem).result  # made while effects without it are tried
        return _best_of_pairs(problem, library, start, hold_out, without, progress)


def _best_of_pairs(
    problem: Problem,
    library: Callable[[], Library],
    start: Fit,
    hold_out: Judge,
    without: Collection[str],
    progress: Callable[[str], None],
) -> tuple[Fit, list[list[Scored]]]:
    """What is found greedily, or from another first cause if that pair is better; see ``search``."""
    accepted, rounds = grow(problem, library, start, hold_out, [], without, progress=progress)
    count = len(accepted.hypotheses) - len(start.hypotheses)
    left, settled = gap_of(problem, accepted), count <= 2
    if count > 1 and (LEAST_SIGMAS**2 if settled else 0) < left < NEARLY * gap_of(problem, start):
        for other in _other_firsts(rounds[0], accepted):
            progress("trying other pairs of causes")
            first = [other, *(s for s in rounds[0] if s is not other)]
            trial, trial_rounds = grow(problem, library, start, hold_out, [first], without, most=2)
            if score(trial, accepted) > LEAST_GAIN:
                accepted, rounds = trial, trial_rounds
    return accepted, rounds


def grow(
    problem: Problem,
    library: Callable[[], Library],
    start: Fit,
    hold_out: Judge,
    rounds: list[list[Scored]],
    without: Collection[str],
    most: int = MOST_CAUSES,
    progress: Callable[[str], None] = silent,
) -> tuple[Fit, list[list[Scored]]]:
    """Greedy addition.

    Args:
        problem: the logs.
        library: gives the whitened series that may be proposed.
        start: the nominal model, with what is fitted beside all causes.
        hold_out: judges a fit on blocks of the logs that it has not seen.
        rounds: candidates of earlier rounds, the first of each being accepted.
        without: effects that are not to be proposed.
        most: causes.
        progress: called with the name of each stage as it begins.
    """
    accepted, rounds = (rounds[-1][0].fit if rounds else start), list(rounds)
    while (count := len(accepted.hypotheses) - len(start.hypotheses)) < most:
        threshold, excluded = _threshold(problem, start, accepted), set(without)
        if rounds and gap_of(threshold.elsewhere, accepted) <= threshold.least:
            if _left_somewhere(threshold.elsewhere, accepted) <= threshold.least_of_slow:
                break
            excluded |= {name for name, effect in problem.catalogue.items() if _follows_motion(effect)}
        progress(f"looking for cause {count + 1} of at most {most}")
        scored = candidates(problem, library, accepted, excluded, all_smooth=not count)
        best = next(
            (s for s in scored[:MOST_JUDGED] if _earned(problem, hold_out, threshold, start, accepted, s)), None
        )
        rounds.append([best, *(s for s in scored if s is not best)] if best else scored)
        if best is None:
            break
        accepted = best.fit
        redundant = _redundant_cause(problem, start, accepted)
        if redundant is not None:
            accepted, rounds = redundant, _rounds_of(problem, start, redundant, rounds)
    return accepted, rounds


def gap_of(problem: Problem, found: Fit) -> float:
    """Mean square gap over the channels, in units of one sample's noise variance."""
    return float(np.maximum(excess_by_channel(problem, found.error), 0).mean())


def _left_somewhere(problem: Problem, found: Fit) -> float:
    """As ``gap_of``, but what is left in a few blocks counts although all others have less than expected.

    Only what does not follow the motion is looked for then: all else would have to do with the joints' error, which is
    taken to explain what is left.
    """
    return float(np.maximum(excess_over_quiet(problem, found.error), 0).mean())


def _follows_motion(effect: Effect) -> bool:
    return effect.stage != "bias" and not isinstance(effect.fit.search, SUDDEN)


def _threshold(problem: Problem, start: Fit, accepted: Fit) -> Threshold:
    elsewhere = _elsewhere(problem, accepted)
    if len(accepted.hypotheses) == len(start.hypotheses):
        return Threshold(elsewhere, LEAST_SIGMAS**2)
    local = np.repeat([h.local for h in accepted.hypotheses], [len(h.shapes) for h in accepted.hypotheses])
    _, (untouched,) = projection(accepted.columns.series[local])(start.error[None])
    gap = gap_of(elsewhere, start._replace(error=untouched))
    least = max(LEAST_SIGMAS**2, LEAST_SHARE_OF_GAP * gap)
    all_follow = all(_follows_motion(problem.catalogue[h.effect]) for h in accepted.hypotheses)
    return Threshold(elsewhere, least, LEAST_SIGMAS**2 if all_follow else least)


def _elsewhere(problem: Problem, accepted: Fit) -> Problem:
    return problem._replace(samples=np.where(_touched(problem, accepted)[:, None], 0, problem.samples))


def _touched(problem: Problem, found: Fit) -> np.ndarray:
    """(U,) bins of the contacts of a fit."""
    shapes = [shape for h in found.hypotheses if h.local for shape in h.shapes]
    touched: np.ndarray = np.any([shape != 0 for shape in shapes], axis=0) if shapes else np.zeros(len(problem.t), bool)
    return touched


def _earned(problem: Problem, hold_out: Judge, threshold: Threshold, start: Fit, accepted: Fit, trial: Scored) -> bool:
    """Whether one more cause is possible, gains enough, steadily, and removes enough on blocks it has not seen."""
    if not (trial.nats > LEAST_GAIN and _is_steady(problem, trial, accepted)):
        return False
    if not is_plausible(problem, accepted, trial.fit):
        return False
    if trial.hypothesis.local and not _stands_out(problem, start, accepted, trial.fit):
        return False
    held = hold_out(trial.fit, accepted.error)
    if not _is_sudden(problem, trial) and held.nats < SURE * held.nats_by_noise:
        return False
    if gap_removed(threshold.elsewhere, accepted.error, held.error) > threshold.least:
        return True
    slow = problem.catalogue[trial.hypothesis.effect].stage == "bias" and not _is_sudden(problem, trial)
    return slow and _removes_itself(problem, threshold, accepted, trial.fit, held.error)


def _removes_itself(problem: Problem, threshold: Threshold, accepted: Fit, trial: Fit, unseen: np.ndarray) -> bool:
    """Whether a slow effect removes all that is left, and not the other causes, whose numbers went on to move with it.

    Where something is left beside it, that may be the form of the other causes, and the effect a part of it.
    """
    alone = fit(problem, accepted.hypotheses, trial)
    removed = gap_removed(threshold.elsewhere, alone.error, unseen)
    all_gone = gap_of(threshold.elsewhere, trial) <= LEAST_SIGMAS**2
    return all_gone and removed > threshold.least_of_slow and score(trial, alone) > LEAST_GAIN


def _stands_out(problem: Problem, start: Fit, accepted: Fit, trial: Fit) -> bool:
    """Whether contacts explain much of what happens in their own time, and not just what the causes before left."""
    inside = _touched(problem, trial)
    first, now, then = ((one.error[inside] ** 2).sum() for one in (start, accepted, trial))
    return bool(now - then > LEAST_BESIDE * (first - now))


def _is_steady(problem: Problem, trial: Scored, accepted: Fit) -> bool:
    """Whether all blocks share in the gain; what is sudden gains in few of them."""
    return _is_sudden(problem, trial) or _z_of_gain(problem, trial.fit, accepted) > STEADY


def _is_sudden(problem: Problem, trial: Scored) -> bool:
    return isinstance(problem.catalogue[trial.hypothesis.effect].fit.search, SUDDEN)


def _z_of_gain(problem: Problem, better: Fit, worse: Fit) -> float:
    difference = block_scores(problem, better.error) - block_scores(problem, worse.error)
    return float(difference.sum() / max(np.sqrt(len(difference)) * difference.std(), 1e-12))


def _redundant_cause(problem: Problem, start: Fit, accepted: Fit) -> Fit | None:
    """The fit without an earlier cause that the later ones made needless, if there is one."""
    for h in accepted.hypotheses[len(start.hypotheses) : -1]:
        rest = fit(problem, tuple(other for other in accepted.hypotheses if other is not h), accepted)
        if score(accepted, rest) < LEAST_GAIN:
            return rest
    return None


def _rounds_of(problem: Problem, start: Fit, accepted: Fit, rounds: list[list[Scored]]) -> list[list[Scored]]:
    """Rounds of the causes that stay, the first of each fitted beside those before it that stay, too."""
    kept = {h.effect for h in accepted.hypotheses}
    rounds = [scored for scored in rounds if scored[0].hypothesis.effect in kept]
    fits = [fit(problem, accepted.hypotheses[: len(start.hypotheses) + i], accepted) for i in range(1, len(rounds))]
    return [[best._replace(fit=own), *others] for (best, *others), own in zip(rounds, [*fits, accepted], strict=True)]


def _other_firsts(first: list[Scored], accepted: Fit) -> list[Scored]:
    """Strong candidates of the first round that are not among the causes."""
    named = {h.effect for h in accepted.hypotheses}
    strong = [s for s in first[1:] if s.nats > BEAM_SHARE * first[0].nats and s.hypothesis.effect not in named]
    return strong[: BEAM - 1]
