"""Slow series and changes at some time: their times and time constants refined."""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np

from ftbias_jax.diagnosis.hypothesis import Change, Hypothesis, Slow
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.dictionary import Found, Library, alike, between_steps, by_channel
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.diagnosis.regression.series import retimed, steps
from ftbias_jax.diagnosis.thresholds import LEAST_OF_RAMP
from ftbias_jax.model.effects.fitting import Settling, Step

RAMPS = (0.15, 0.3, 0.6, 1.2, 2.4)
"""s that a change may take."""
FINE = 17
"""Values tried at every refinement of a time or a time constant."""


def slow(problem: Problem, library: Library, accepted: Fit, taken: Collection[str]) -> list[Found]:
    """The best series of every effect that settles, its time constant refined."""
    names = [effect.name for effect in problem.catalogue.searched_by(Settling)]
    best = [_best(library, accepted, name) for name in names if name in library.series and name not in taken]
    return [_with_time_constant(problem, accepted, found) for found in best]


def _best(library: Library, accepted: Fit, effect: str) -> Found:
    gain = by_channel(accepted, library.white[effect])
    place = int(gain.argmax())
    return float(gain[place]), library.series[effect][place]


def _with_time_constant(problem: Problem, accepted: Fit, found: Found) -> Found:
    """The best time constant near that of a slow series; without a lag it stays as it is."""
    _, h = found
    assert isinstance(h.detail, Slow)
    effect = problem.catalogue[h.effect]
    assert isinstance(effect.fit.search, Settling)
    times = np.array([time for time in effect.parameter(effect.fit.search.time).starts if time > 0])
    if not h.detail.time_constant or len(times) < 2:
        return found

    def make(log_time: np.ndarray) -> list[Hypothesis]:
        return retimed(problem, h, np.exp(log_time).tolist())

    return refine(problem, accepted, make, float(np.log(h.detail.time_constant)), float(np.diff(np.log(times)).max()))


def steplike(problem: Problem, library: Library, accepted: Fit, taken: Collection[str]) -> list[Found]:
    """Of every effect that begins at some time what gains most, its time refined, sudden or along a straight line."""
    names = [effect.name for effect in problem.catalogue.searched_by(Step)]
    best = [_best(library, accepted, name) for name in names if name in library.series and name not in taken]
    return [_with_time(problem, accepted, h) for _, h in best]


def _with_time(problem: Problem, accepted: Fit, h: Hypothesis) -> Found:
    effect, at = problem.catalogue[h.effect], h.detail
    assert isinstance(at, Change)

    def make(times: np.ndarray) -> list[Hypothesis]:
        return steps(problem, effect, at.log, times)

    sudden = refine(problem, accepted, make, at.time, between_steps(problem.durations[at.log]))
    assert isinstance(sudden[1].detail, Change)
    middle = sudden[1].detail.time
    ramps = [
        h for ramp in RAMPS for h in steps(problem, effect, at.log, middle + ramp * np.linspace(-0.9, -0.1, 9), ramp)
    ]
    gain = by_channel(accepted, alike(problem, [h.shapes[0] for h in ramps]))
    slower = float(gain.max()), ramps[int(gain.argmax())]
    return slower if slower[0] > sudden[0] + LEAST_OF_RAMP else sudden


def refine(
    problem: Problem, accepted: Fit, make: Callable[[np.ndarray], list[Hypothesis]], at: float, reach: float
) -> Found:
    """The best of ever finer grids around a value that a series depends on.

    Args:
        problem: the logs.
        accepted: the fit of the causes found so far.
        make: values -> one hypothesis each.
        at: the best so far.
        reach: how far from it the best may be.
    """
    for _ in range(2):
        values = at + reach * np.linspace(-1, 1, FINE)
        made = make(values)
        gain = by_channel(accepted, alike(problem, [h.shapes[0] for h in made]))
        best = int(gain.argmax())
        at, reach = float(values[best]), 2 * reach / (FINE - 1)
    return float(gain[best]), made[best]
