"""Starting points for the fit of an effect without a search of its own, derived from its parameters.

Parameters that switch the effect off are found by one linearisation. Those that need a search are held meanwhile at
each of their starts: times along the whole log, positions on the sensor's path and around neutral, whole numbers at
every value, all others spread over their bounds. Times are refined around the best start. The best few starts are
fitted with all parameters free except those without a scale, such as a joint's number.
"""

from collections.abc import Collection, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.hypothesis import Found, Hypothesis, at_values, neutral_of, searched_by
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.proposals.starts import as_they_are
from ftbias_jax.diagnosis.regression.coordinates import can_move, is_moment, scale_of, strengths, why_not_fitted
from ftbias_jax.diagnosis.regression.evaluate import over_bins, slopes, whitened
from ftbias_jax.diagnosis.regression.score_test import PreparedFit, gains
from ftbias_jax.diagnosis.thresholds import STARTS_FITTED
from ftbias_jax.model.effects.fitting import LINEAR, Starts
from ftbias_jax.model.effects.types import Effect, Parameter

MOST_STARTS = 256
"""Maximum number of combinations of starts per effect."""
GRID = 7
"""Number of starts of a parameter that states none."""
SPREAD = 10.0
"""Ratio of the largest start of an unbounded positive parameter to its typical value, and of that to the smallest."""
MOST_BOUNDS = 1e4
"""Ratio of bounds up to which starts are spread over the whole range between them."""
NUMBERS = 64
"""Maximum number of values of a whole number that states no starts."""
FEWEST_TIMES, TIMES = 16, 64
"""Number of times in a log that are tried: the more combinations of other starts, the fewer."""
HALVINGS = 8
"""Number of step halvings in the refinement of times: to 10 ms in a log of 40 s."""
FEWEST_PLACES, PLACES = 3, 24
"""Number of positions of the sensor that are tried for a place, chosen likewise."""

Values = dict[str, np.ndarray]
"""Parameter -> its value, for parameters that need a search."""


class Extent(NamedTuple):
    """Range of a search."""

    seconds: float
    """Duration of the longest log."""
    places: np.ndarray
    """(PLACES, 3) m, base frame, positions on the sensor's path, the most dissimilar ones first."""


class Start(NamedTuple):
    """Starting point of a fit."""

    nats: float
    """Gain of its strengths there."""
    hypothesis: Hypothesis
    values: Values
    """Values of the parameters that need a search."""


def best_starts(problem: Problem, prepared_fit: PreparedFit, taken: Collection[str]) -> list[Found]:
    """Most promising starts of every such effect, with their gains in nats over a fit."""
    wanted = [effect for effect in searched_by(problem, taken, Starts) if not why_not_fitted(effect)]
    if not wanted:
        return []
    positions = over_bins(problem, lambda part: np.asarray(part.nominal.sensor_position).T)
    extent = Extent(max(problem.durations), apart(positions))
    return [found for effect in wanted for found in _best_starts(problem, prepared_fit, effect, extent)]


def _best_starts(problem: Problem, prepared_fit: PreparedFit, effect: Effect, extent: Extent) -> list[Found]:
    neutral = {parameter.name: neutral_of(problem, effect, parameter.name) for parameter in effect.parameters}
    best = _best(problem, prepared_fit, effect, starts_together(effect, neutral, extent))
    for step in _refinements(effect, extent):
        best = _best(problem, prepared_fit, effect, _around(effect, best[0].values, step), best)
    return [(start.nats, start.hypothesis._replace(group=i)) for i, start in enumerate(best)]


def _best(
    problem: Problem, prepared_fit: PreparedFit, effect: Effect, tried: list[Values], found: Sequence[Start] = ()
) -> list[Start]:
    """The few starts that gain most, best first, of those found before and those at these values, where the strengths
    are fitted and the rest is held."""
    slices = problem.layout.slices
    first = {parameter.name: slices[effect.name, parameter.name].start for parameter in strengths(effect)}
    linear = [first[p.name] + int(i) for p in strengths(effect) for i in np.flatnonzero(can_move(p))]
    starts = []
    for values in tried:
        h = at_values(problem, effect, **values)
        starts.append(h._replace(free=(*linear, *h.free), start=(*(0.0 for _ in linear), *h.start)))
    if linear:
        scored = [_linearised(problem, prepared_fit, h, linear) for h in starts]
    else:
        scored = list(zip(as_they_are(problem, prepared_fit.fit, starts)[0].tolist(), starts, strict=True))
    every = [*found, *(Start(*one, values) for one, values in zip(scored, tried, strict=True))]
    return sorted(every, key=lambda start: -start.nats)[:STARTS_FITTED]


def _linearised(problem: Problem, prepared_fit: PreparedFit, h: Hypothesis, linear: list[int]) -> Found:
    """Gain of the strengths, within their bounds, with the rest held at a start."""
    prepared = gains(prepared_fit, whitened(problem, slopes(problem, h.begin(prepared_fit.fit.z), linear)))
    least, most = (bound[linear] for bound in (problem.layout.least, problem.layout.most))
    best = np.clip(prepared.coefficients(list(range(len(linear)))), least, most)
    gain = float(-prepared.pull @ best - best @ prepared.normal @ best / 2)
    return gain, h._replace(start=(*best.tolist(), *h.start[len(linear) :]))


def starts_together(effect: Effect, neutral: Values, extent: Extent) -> list[Values]:
    """All combinations of starts of the parameters that need a search, evenly thinned out if there are too many."""
    searched = [parameter for parameter in effect.parameters if parameter.search and -1 not in parameter.shape]
    spread = {p.name: starts_of(effect, p, neutral[p.name]) for p in searched}
    moments = {parameter.name for parameter in searched if is_moment(parameter, extent.seconds)}
    places = {p.name for p in searched if p.unit == "m" and p.shape == (3,) and not p.starts and can_move(p).any()}
    others = int(np.prod([len(starts) for name, starts in spread.items() if name not in moments | places]))
    each = (MOST_STARTS / others) ** (1 / max(len(moments | places), 1))
    count = int(np.clip(each, FEWEST_TIMES, TIMES))
    times = (np.arange(count) + 1) * extent.seconds / (count + 1)  # excludes both ends of the log
    for parameter in searched:
        if parameter.name in moments:
            spread[parameter.name] = list(times)
        elif parameter.name in places:
            around = spread[parameter.name]
            passed = extent.places[: int(np.clip(each - len(around), FEWEST_PLACES, PLACES))]
            inside = np.all((parameter.lower <= passed) & (passed <= parameter.upper), axis=1)
            spread[parameter.name] = [*around, *passed[inside]]
    every = list(product(*spread.values()))
    chosen = np.unique(np.linspace(0, len(every) - 1, min(len(every), MOST_STARTS)).astype(int))
    return [dict(zip(spread, map(np.asarray, every[i]), strict=True)) for i in chosen]


def _refinements(effect: Effect, extent: Extent) -> list[float]:
    """s: steps by which the times of an effect are refined; none if it has no time."""
    moment = any(is_moment(parameter, extent.seconds) for parameter in effect.parameters)
    return [extent.seconds / FEWEST_TIMES / 2 ** (i + 1) for i in range(HALVINGS if moment else 0)]


def _around(effect: Effect, values: Values, step: float) -> list[Values]:
    """Values with each time one step earlier, later or unchanged, within their bounds, except all unchanged."""
    times = [p for p in effect.parameters if p.name in values and p.unit == "s" and not p.shape and can_move(p).any()]
    found = []
    for signs in product((0, -1, 1), repeat=len(times)):
        pairs = zip(times, signs, strict=True)
        moved = {p.name: np.clip(values[p.name] + sign * step, p.lower, p.upper) for p, sign in pairs}
        found.append(values | moved)
    return found[1:]


def starts_of(effect: Effect, parameter: Parameter, neutral: np.ndarray) -> list[np.ndarray]:
    """Starting values of a parameter, in its shape: as stated, or spread over the possible range."""
    if parameter.starts:
        return [np.broadcast_to(np.asarray(start, float), parameter.shape) for start in parameter.starts]
    lower, upper, scale = (
        np.broadcast_to(np.asarray(x, float), parameter.shape)
        for x in (parameter.lower, parameter.upper, parameter.scale)
    )
    if not scale.any():
        if parameter.shape or not np.isfinite(upper - lower):
            return [neutral]
        return [np.asarray(float(x)) for x in range(int(np.ceil(lower)), int(upper) + 1)[:NUMBERS]]
    if scale_of(effect, parameter).kind != LINEAR:
        return _spread_by_factors(lower, upper, np.where(np.isfinite(neutral) & (neutral > 0), neutral, scale))
    if not parameter.shape and np.isfinite(upper - lower):
        return [lower + share * (upper - lower) for share in (np.arange(GRID) + 0.5) / GRID]
    axes = np.eye(scale.size).reshape(-1, *scale.shape)
    steps = [sign * scale * axis for axis in axes for sign in (1, -1)]
    around = [neutral, *(neutral + step for step in steps)]
    return [np.clip(start, lower, upper) for start in around]


def _spread_by_factors(lower: np.ndarray, upper: np.ndarray, middle: np.ndarray) -> list[np.ndarray]:
    narrow = np.all((lower > 0) & np.isfinite(upper) & (upper < MOST_BOUNDS * np.maximum(lower, 1e-300)))
    least, most = (lower, upper) if narrow else (middle / SPREAD, middle * SPREAD)
    return [np.clip(start, lower, upper) for start in np.geomspace(least, most, GRID)]


def apart(positions: np.ndarray) -> np.ndarray:
    """(PLACES, 3) most dissimilar positions of (T, 3): the middle one, then always the farthest from those before."""
    chosen = [positions[np.linalg.norm(positions - positions.mean(0), axis=1).argmin()]]
    nearest = np.linalg.norm(positions - chosen[0], axis=1)
    while len(chosen) < PLACES:
        chosen.append(positions[nearest.argmax()])
        nearest = np.minimum(nearest, np.linalg.norm(positions - chosen[-1], axis=1))
    return np.stack(chosen)
