"""A tool on springs: at which frequency it swings, and which ways.

The reading is nearly linear in the shares of the tool that move in each way: one linearisation at every frequency tells
what they would gain. The usual tool, all of which turns about x and y, is tried too, and its shares are freed after.
"""

from __future__ import annotations

import numpy as np

from ftbias_jax.diagnosis.hypothesis import Hypothesis, at_values
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression import chain_model
from ftbias_jax.diagnosis.regression.evaluate import slopes, whitened
from ftbias_jax.diagnosis.regression.fit import Fit, fit
from ftbias_jax.diagnosis.regression.score_test import Standing, gains

EFFECT = "tool_flexibility"
FREQUENCIES = tuple(np.geomspace(3.6, 30.0, 12))
LOG_DAMPINGS = (-0.5, 1.2)
"""Coordinates of the damping ratio."""
BETWEEN = 0.5
"""The same for one search over all: resonances are then as wide as the steps of the frequencies."""
WAYS = (0, 1, 3, 4)
"""Shifts along and turns about x and y; along and about z tools are stiff."""
LEAST_WAY = 0.02
"""Share of the gain that each further way of moving must add."""
LEAST_SHARE = 0.1
EQUAL = 0.97
"""Share of the best gain from which on a frequency is as good as the best one."""
NEAR_LIMIT = 0.97
"""Share of a limit from which on a value is at it."""


def usual(problem: Problem) -> list[Hypothesis]:
    """Starting points of a tool all of which turns about x and y, and sags."""
    turns = at_values(problem, EFFECT, ("share", np.array([0, 0, 0, 1, 1, 0])), ("sagging", 1.0))
    fixed = tuple(zip(turns.free, turns.start, strict=True))
    return [_ringing(problem, f, damping)._replace(fixed=fixed) for f in FREQUENCIES for damping in LOG_DAMPINGS]


def loose(problem: Problem, standing: Standing) -> list[tuple[float, Hypothesis]]:
    """The few ways of moving that matter, and the frequency, that gain most, for a tool that sags or does not.

    A small part on soft springs sags as a larger one on stiffer springs: of equals the stiffest possible is the start.

    Returns:
        nats, to first order in the shares that move, and the starting point.
    """
    return [_stiffest([_loose(problem, standing, f, sags) for f in FREQUENCIES]) for sags in (0.0, 1.0)]


def _stiffest(tried: list[tuple[float, Hypothesis]]) -> tuple[float, Hypothesis]:
    """Of starting points of rising frequency that gain most, the last one where no more than all of the tool moves."""
    best = max(gain for gain, _ in tried)
    equal = [(gain, h) for gain, h in tried if gain >= EQUAL * best]
    possible = [(gain, h) for gain, h in equal if max(h.start[2:-1], default=0.0) <= 1]
    gain, h = (possible or equal[:1] or tried[:1])[-1]  # nothing is near a best that gains nothing
    return gain, h._replace(start=(*h.start[:2], *np.clip(h.start[2:-1], LEAST_SHARE, 1).tolist(), h.start[-1]))


def _loose(problem: Problem, standing: Standing, frequency: float, sags: float) -> tuple[float, Hypothesis]:
    ringing = _ringing(problem, frequency, BETWEEN)
    ways, sagging = _places(problem)
    z = standing.fit.z.copy()
    z[[*ringing.free, sagging]] = *ringing.start, sags
    prepared = gains(standing, whitened(problem, slopes(problem, z, standing.fit.link, ways)))
    gain, chosen = prepared.pursue(list(range(len(ways))), len(ways), LEAST_WAY)
    free = (*ringing.free, *(ways[i] for i in chosen), sagging)
    return gain, Hypothesis(EFFECT, free, (*ringing.start, *prepared.coefficients(chosen).tolist(), sags))


def freed(problem: Problem, found: Fit) -> Hypothesis | None:
    """The last hypothesis of a fit, if it is a tool on springs that may move in fewer ways, with all ways free."""
    h = found.hypotheses[-1]
    ways, sagging = _places(problem)
    if h.effect != EFFECT or set(ways) <= set(h.free):
        return None
    free = (*h.free[:2], *ways, sagging)
    return h._replace(free=free, start=tuple(found.z[list(free)].tolist()), fixed=())


def start_of(h: Hypothesis) -> float:
    """A number that tells starting points apart which are all to be fitted: the usual tool, or one that sags or not."""
    return 2.0 if h.fixed else h.start[-1]


def is_plausible(problem: Problem, accepted: Fit, found: Fit) -> bool:
    """Whether the tool on springs that a fit has more than another one needs neither of its limits.

    What swings as slowly as it may is something else, and so is what must die away as fast as it may: with a usual
    damping it gains less. Where nothing rings the damping does not matter, and may be anything.
    """
    h = found.hypotheses[-1]
    if h.effect != EFFECT:
        return True
    period, damping = h.free[:2]
    _, most = chain_model.bounds(problem.joints)
    if found.z[period] > NEAR_LIMIT * most[period]:
        return False
    if found.z[damping] < NEAR_LIMIT * most[damping]:
        return True
    rest = tuple(i for i in h.free if i != damping)
    calm = h._replace(free=rest, start=tuple(found.z[list(rest)].tolist()), fixed=(*h.fixed, (damping, 0.0)))
    usual = fit(problem, (*found.hypotheses[:-1], calm), found)
    gained, lost = found.log_likelihood - accepted.log_likelihood, found.log_likelihood - usual.log_likelihood
    return lost < (1 - EQUAL) * gained


def _ringing(problem: Problem, frequency: float, log_damping: float) -> Hypothesis:
    return at_values(problem, EFFECT, ("period", 1 / frequency), ("log_damping", log_damping))


def _places(problem: Problem) -> tuple[list[int], int]:
    """Coordinates of the shares that may move, and of the sagging."""
    places = chain_model.slices(problem.joints)
    return [places[EFFECT, "share"].start + way for way in WAYS], places[EFFECT, "sagging"].start
