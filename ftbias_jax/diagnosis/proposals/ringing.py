"""Tool on springs: its natural frequency and the degrees of freedom in which it oscillates.

The reading is nearly linear in the share of the tool that moves in each of them, so one linearisation per frequency
gives their gains. The usual tool, of which the share in the entry moves, is tried too, and its shares are freed later.
"""

from collections.abc import Collection
from itertools import product
from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.hypothesis import Found, Hypothesis, at_values, neutral_of, places_of, search_of, searched_by
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.evaluate import STEP, readings, whitened
from ftbias_jax.diagnosis.regression.fit import Fit, fit
from ftbias_jax.diagnosis.regression.score_test import PreparedFit, gains
from ftbias_jax.diagnosis.thresholds import EQUAL, LEAST_WAY, NEAR_LIMIT
from ftbias_jax.model.effects.fitting import Ringing
from ftbias_jax.model.effects.types import Effect

LOG_DAMPINGS = (-0.5, 1.2)
"""Coordinates of the damping ratio that are tried."""
BETWEEN = 0.5
"""The same in one search over all frequencies: resonances are then as wide as the steps of the frequencies."""
WAYS = (0, 1, 3, 4)
"""Degrees of freedom: translation along and rotation about x and y; along and about z tools are stiff."""
LEAST_SHARE = 0.1


class _Places(NamedTuple):
    """Coordinates of an effect that oscillates."""

    period: int
    damping: int
    ways: list[int]
    """Coordinates of the shares that may move."""
    sagging: int


def _places(problem: Problem, effect: Effect) -> _Places:
    search, places = search_of(effect, Ringing), problem.layout.slices
    names = (search.frequency, search.damping_ratio, search.share, search.sagging)
    period, damping, share, sagging = (places[effect.name, name].start for name in names)
    return _Places(period, damping, [share + way for way in WAYS], sagging)


def usual(problem: Problem, taken: Collection[str]) -> list[Hypothesis]:
    """Starting points of a tool that moves and sags as the entry's neutral values state."""
    found = []
    for effect in searched_by(problem, taken, Ringing):
        search = search_of(effect, Ringing)
        moving = {name: neutral_of(problem, effect, name) for name in (search.share, search.sagging)}
        fixed = tuple(places_of(problem, effect, **moving).items())
        found += [
            _swinging(problem, effect, f, damping)._replace(fixed=fixed)
            for f in effect.parameter(search.frequency).starts
            for damping in LOG_DAMPINGS
        ]
    return found


def loose(problem: Problem, prepared_fit: PreparedFit, taken: Collection[str]) -> list[Found]:
    """The few degrees of freedom and the frequency that gain most, for a tool that sags or does not.

    A small part on soft springs sags like a larger one on stiffer springs; among equals the stiffest possible is
    chosen.

    Returns:
        nats, to first order in the shares that move, and the starting point.
    """
    found = []
    for effect in searched_by(problem, taken, Ringing):
        tried = list(product((0.0, 1.0), effect.parameter(search_of(effect, Ringing).frequency).starts))
        pairs = zip(tried, _by_ways(problem, prepared_fit, effect, tried), strict=True)
        loose = [_loose(problem, prepared_fit, effect, *one, white) for one, white in pairs]
        found += [_stiffest(alike) for alike in (loose[: len(loose) // 2], loose[len(loose) // 2 :])]
    return found


def _by_ways(
    problem: Problem, prepared_fit: PreparedFit, effect: Effect, tried: list[tuple[float, float]]
) -> np.ndarray:
    """Whitened derivatives (N, W, U, 6) with respect to W shares, all zero yet, at N pairs (sagging, Hz)."""
    places = _places(problem, effect)
    z = np.repeat(prepared_fit.fit.z[None], len(tried) * len(WAYS) + 1, 0)
    for i, (sags, frequency) in enumerate(tried):
        ringing = _swinging(problem, effect, frequency, BETWEEN)
        rows = z[i * len(WAYS) : (i + 1) * len(WAYS)]
        rows[:, [*ringing.free, places.sagging]] = *ringing.start, sags
        rows[range(len(WAYS)), places.ways] += STEP
    *moved, still = readings(problem, z)  # where no share moves, neither frequency nor sagging matters
    change = (np.stack(moved) - still) / STEP
    # A physically impossible tool, as may be fitted before a cause is found, may oscillate without bounds.
    bounded = np.abs(change).max((1, 2), keepdims=True) < np.finfo(np.float32).max
    return whitened(problem, np.where(bounded, change, 0.0)).reshape(len(tried), len(WAYS), -1, 6)


def _stiffest(tried: list[Found]) -> Found:
    """Of starting points in order of frequency, the last of the best ones in which at most all of the tool moves."""
    best = max(gain for gain, _ in tried)
    equal = [(gain, h) for gain, h in tried if gain >= EQUAL * best]
    possible = [(gain, h) for gain, h in equal if max(h.start[2:-1], default=0.0) <= 1]
    gain, h = (possible or equal[:1] or tried[:1])[-1]  # none is near a best gain of 0
    return gain, h._replace(start=(*h.start[:2], *np.clip(h.start[2:-1], LEAST_SHARE, 1).tolist(), h.start[-1]))


def _loose(
    problem: Problem, prepared_fit: PreparedFit, effect: Effect, sags: float, frequency: float, white: np.ndarray
) -> Found:
    ringing, places = _swinging(problem, effect, frequency, BETWEEN), _places(problem, effect)
    prepared = gains(prepared_fit, white)
    gain, chosen = prepared.pursue(list(range(len(WAYS))), len(WAYS), LEAST_WAY)
    free = (*ringing.free, *(places.ways[i] for i in chosen), places.sagging)
    start = (*ringing.start, *prepared.coefficients(chosen).tolist(), sags)
    return gain, Hypothesis(effect.name, free, start, group=1 + int(sags))


def _last(problem: Problem, found: Fit) -> tuple[Hypothesis, _Places | None]:
    """Last hypothesis of a fit, and its coordinates if it is a tool on springs."""
    h = found.hypotheses[-1]
    effect = problem.catalogue[h.effect]
    return h, _places(problem, effect) if isinstance(effect.fit.search, Ringing) else None


def freed(problem: Problem, found: Fit) -> Hypothesis | None:
    """Last hypothesis of a fit with all degrees of freedom free, if it is a tool on springs with fewer."""
    h, places = _last(problem, found)
    if places is None or set(places.ways) <= set(h.free):
        return None
    free = (places.period, places.damping, *places.ways, places.sagging)
    return h._replace(free=free, start=tuple(found.z[list(free)].tolist()), fixed=())


def sagging(problem: Problem, found: Fit) -> Hypothesis | None:
    """Last hypothesis of a fit with full sagging, if it is a tool on springs whose sagging is free.

    Slow motion only shows how far the tool sags: half-balanced stiff springs are indistinguishable from softer ones.
    """
    h, places = _last(problem, found)
    return _held(found, places.sagging, 1.0) if places and places.sagging in h.free else None


def _held(found: Fit, place: int, value: float) -> Hypothesis:
    """Last hypothesis of a fit with one coordinate held instead of free."""
    h = found.hypotheses[-1]
    free = tuple(i for i in h.free if i != place)
    return h._replace(free=free, start=tuple(found.z[list(free)].tolist()), fixed=(*h.fixed, (place, value)))


def is_plausible(problem: Problem, accepted: Fit, found: Fit) -> bool:
    """Whether the last hypothesis of a fit, if it is a tool on springs, does without its parameter limits.

    An oscillation at the lowest allowed frequency is something else, and so is one that needs the highest damping,
    gaining less with a usual one. Where nothing oscillates the damping is irrelevant and may have any value.
    """
    _, places = _last(problem, found)
    if places is None:
        return True
    (period, damping, *_), most = places, problem.layout.most
    if found.z[period] > NEAR_LIMIT * most[period]:
        return False
    if found.z[damping] < NEAR_LIMIT * most[damping]:
        return True
    usual = fit(problem, (*found.hypotheses[:-1], _held(found, damping, 0.0)), found)
    gained, lost = found.log_likelihood - accepted.log_likelihood, found.log_likelihood - usual.log_likelihood
    return lost < (1 - EQUAL) * gained


def _swinging(problem: Problem, effect: Effect, frequency: float, log_damping: float) -> Hypothesis:
    h = at_values(problem, effect, **{search_of(effect, Ringing).frequency: frequency})
    damping = _places(problem, effect).damping
    return h._replace(free=(*h.free, damping), start=(*h.start, log_damping))
