"""What each effect would gain: those that are smooth at zero by one linearisation, the others from several starts.

Of effects that pick no search of their own each parameter says where to begin: those that switch an effect off are
found by one linearisation; those that need a search are held at each of their starts meanwhile. The best few starts are
fitted with everything free but what has no scale, such as a joint's number.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from itertools import product

import numpy as np

from ftbias_jax.diagnosis.hypothesis import (
    Found,
    Hypothesis,
    at_values,
    at_zero,
    movable,
    neutral_of,
    places_of,
    search_of,
    searched_by,
)
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.proposals.ringing import usual
from ftbias_jax.diagnosis.regression.coordinates import scale_of, strengths, why_not_fitted
from ftbias_jax.diagnosis.regression.evaluate import readings, slopes, whitened
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.diagnosis.regression.score_test import PreparedFit, gain_of_each, gains
from ftbias_jax.diagnosis.thresholds import LEAST_ENTRY, MOST_ENTRIES, STARTS_FITTED
from ftbias_jax.model.effects.fitting import LINEAR, SMOOTH, ByJoint, Entries, Grid, Linear, Starts
from ftbias_jax.model.effects.types import Effect, Parameter

MOST_STARTS = 256
"""Combinations of starts of an effect that are tried."""
GRID = 7
"""Starts of one parameter, if it does not say which."""
SPREAD = 10.0
"""Largest start of a positive parameter without bounds over its typical value, and that over the smallest one."""
MOST_BOUNDS = 1e4
"""Ratio of bounds up to which starts are spread over all between them."""
NUMBERS = 64
"""Values of a whole number, if it does not say which."""
TIMES, CLOSER, ROUNDS = 64, 4, 3
"""Times in a log that are tried; each round tries so many on either side of the best one, that much closer."""


def smooth_hypotheses(problem: Problem, taken: Collection[str]) -> list[Hypothesis]:
    """What one linearisation finds; each joint is a hypothesis of its own, and so is each variant of an effect."""
    return [h for effect in searched_by(problem, taken, *SMOOTH) for h in _of_smooth(problem, effect)]


def _of_smooth(problem: Problem, effect: Effect) -> list[Hypothesis]:
    match effect.fit.search:
        case ByJoint():
            joints = enumerate(problem.layout.of_effect(effect.name), 1)
            return [at_zero(effect.name, [i])._replace(detail=joint, group=joint) for joint, i in joints]
        case Linear(variants):
            whole = at_zero(effect.name, movable(problem, effect))
            held = [tuple(places_of(problem, effect, **dict(variant)).items()) for variant in variants]
            return [whole._replace(fixed=fixed) for fixed in held]
        case _:
            return [at_zero(effect.name, movable(problem, effect))]


def smooth(
    problem: Problem, prepared_fit: PreparedFit, taken: Collection[str]
) -> tuple[list[Found], dict[Hypothesis, np.ndarray]]:
    """Gains, and for each hypothesis the whitened derivatives (F, U, 6) by its coordinates."""
    wanted = smooth_hypotheses(problem, taken)
    found: list[Found] = []
    columns: dict[Hypothesis, np.ndarray] = {}
    for fixed in dict.fromkeys(h.fixed for h in wanted):
        alike = [h for h in wanted if h.fixed == fixed]
        places = [i for h in alike for i in h.free]
        white = whitened(problem, slopes(problem, alike[0].begin(prepared_fit.fit.z), places))
        prepared, row = gains(prepared_fit, white), iter(range(len(places)))
        for h in alike:
            rows = [next(row) for _ in h.free]
            sparse = isinstance(problem.catalogue[h.effect].fit.search, Entries)
            gain, chosen = prepared.pursue(rows, MOST_ENTRIES, LEAST_ENTRY) if sparse else (prepared.of(rows), rows)
            few = h._replace(free=tuple(places[i] for i in chosen), start=(0.0,) * len(chosen))
            columns[few] = white[chosen]
            found += [(gain, few)] if chosen else []
    return found, columns


def grid_hypotheses(problem: Problem, span: np.ndarray, taken: Collection[str]) -> list[Hypothesis]:
    """Starting points of the effects that are fitted from several; span (6,) N, Nm: range of the predicted load."""
    found = []
    for effect in searched_by(problem, taken, Grid):
        load = span if search_of(effect, Grid).per_load else 1.0
        searched = [parameter for parameter in effect.parameters if parameter.starts]
        for starts in product(*(parameter.starts for parameter in searched)):
            values = {p.name: start * load for p, start in zip(searched, starts, strict=True)}
            found.append(at_values(problem, effect, **values))
    return found


def from_starts(problem: Problem, prepared_fit: PreparedFit, taken: Collection[str]) -> list[Found]:
    """Gain of each starting point, as it is or scaled to fit."""
    now = readings(problem, prepared_fit.fit.z[None])[0]
    wanted = [*grid_hypotheses(problem, np.ptp(now, axis=0), taken), *usual(problem, taken)]
    if not wanted:
        return []
    as_they_are, changes = _as_they_are(problem, prepared_fit.fit, wanted)
    scaled, _ = gain_of_each(prepared_fit, changes)
    found = list(zip(np.maximum(as_they_are, scaled / 2).tolist(), wanted, strict=True))
    for i, h in enumerate(wanted):
        search = problem.catalogue[h.effect].fit.search
        if isinstance(search, Grid) and search.per_load:
            found[i] = (gains(prepared_fit, changes[i] * np.eye(6)[:, None]).of(list(range(6))), h)
    return found


def best_starts(problem: Problem, prepared_fit: PreparedFit, taken: Collection[str]) -> list[Found]:
    """The most promising starts of every such effect, with their gains in nats beside a fit."""
    return [
        found
        for effect in searched_by(problem, taken, Starts)
        if not why_not_fitted(effect)
        for found in _best_starts(problem, prepared_fit, effect)
    ]


def _best_starts(problem: Problem, prepared_fit: PreparedFit, effect: Effect) -> list[Found]:
    places = problem.layout.slices
    linear = [
        places[effect.name, parameter.name].start + int(i)
        for parameter in strengths(effect)
        for i in np.flatnonzero(np.broadcast_to(parameter.scale, parameter.shape))
    ]

    def tried(times: np.ndarray) -> list[tuple[Found, float]]:
        starts = list(_starts(problem, effect, linear, times))
        if linear:
            found = [_linearised(problem, prepared_fit, h, linear) for h, _ in starts]
        else:
            gain, _ = _as_they_are(problem, prepared_fit.fit, [h for h, _ in starts])
            found = [(one, h) for one, (h, _) in zip(gain.tolist(), starts, strict=True)]
        return list(zip(found, (time for _, time in starts), strict=True))

    def gain_first(tried: tuple[Found, float]) -> float:
        return -tried[0][0]

    seconds = max(float(part.signals.t[-1]) for part in problem.parts)
    times = np.arange(1, TIMES + 1) * seconds / (TIMES + 1)  # neither the first moment of the longest log nor its last
    best = tried(times)
    step = times[0] / CLOSER
    for _ in range(ROUNDS if _when(effect) else 0):
        (_, middle), *_ = sorted(best, key=gain_first)
        best += tried(middle + step * np.setdiff1d(np.arange(-CLOSER + 1, CLOSER), 0))
        step /= CLOSER
    chosen = [found for found, _ in sorted(best, key=gain_first)[:STARTS_FITTED]]
    return [(gain, h._replace(group=i)) for i, (gain, h) in enumerate(chosen)]


def _when(effect: Effect) -> str:
    """The parameter that is a time in the log; "" = none."""
    return effect.fit.search.when if isinstance(effect.fit.search, Starts) else ""


def _linearised(problem: Problem, prepared_fit: PreparedFit, h: Hypothesis, linear: list[int]) -> Found:
    """What the strengths would gain with the rest held at a start, none of them outside of its bounds."""
    prepared = gains(prepared_fit, whitened(problem, slopes(problem, h.begin(prepared_fit.fit.z), linear)))
    least, most = (bound[linear] for bound in (problem.layout.least, problem.layout.most))
    best = np.clip(prepared.coefficients(list(range(len(linear)))), least, most)
    gain = float(-prepared.pull @ best - best @ prepared.normal @ best / 2)
    return gain, h._replace(start=(*best.tolist(), *h.start[len(linear) :]))


def _as_they_are(problem: Problem, accepted: Fit, starts: Sequence[Hypothesis]) -> tuple[np.ndarray, np.ndarray]:
    """(S,) gain of each of S starts as it is, and (S, U, 6) what it changes."""
    made = readings(problem, np.stack([accepted.z, *(h.begin(accepted.z) for h in starts)]))
    changes = whitened(problem, made[1:] - made[0])
    return -(accepted.error * changes).sum((1, 2)) - (changes**2).sum((1, 2)) / 2, changes


def _starts(
    problem: Problem, effect: Effect, linear: list[int], times: np.ndarray
) -> Iterator[tuple[Hypothesis, float]]:
    """All combinations of the starts of the parameters that need a search, evenly thinned out if there are too many.

    The coordinates ``linear`` begin at zero. Beside each start stands that of the parameter that is a time in the log,
    one of these (s); NaN = there is none.
    """
    neutral = {parameter.name: neutral_of(problem, effect, parameter.name) for parameter in effect.parameters}
    searched = [parameter for parameter in effect.parameters if parameter.search]
    spread = {p.name: starts_of(effect, p, neutral[p.name]) for p in searched} | {_when(effect): list(times)}
    every = list(product(*(spread[parameter.name] for parameter in searched)))
    chosen = np.unique(np.linspace(0, len(every) - 1, min(len(every), MOST_STARTS)).astype(int))
    for combination in (every[i] for i in chosen):
        values = dict(zip((parameter.name for parameter in searched), combination, strict=True))
        at, moves = places_of(problem, effect, **values), {*movable(problem, effect)}
        free = {place: x for place, x in at.items() if place in moves}
        fixed = tuple((place, x) for place, x in at.items() if place not in moves)
        h = Hypothesis(effect.name, (*linear, *free), (*(0.0 for _ in linear), *free.values()), fixed)
        yield h, float(values.get(_when(effect), np.nan))


def starts_of(effect: Effect, parameter: Parameter, neutral: np.ndarray) -> list[np.ndarray]:
    """Values at which the search for a parameter begins, in its shape: as stated, or spread over what is possible."""
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
