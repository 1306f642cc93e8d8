"""A tool on springs: at which frequency it swings, and which ways.

As long as the tool does not sag, the reading is linear in the shares of it that move in each way: one linearisation at
every frequency tells what they would gain. Where it sags, the usual tool, all of which turns about x and y, is fitted
first, and its shares are freed from there.
"""

from __future__ import annotations

import numpy as np

from ftbias_jax.gap import model
from ftbias_jax.gap.evaluate import slopes, whitened
from ftbias_jax.gap.fit import Fit
from ftbias_jax.gap.gains import Standing, gains
from ftbias_jax.gap.hypotheses import Hypothesis, at_values
from ftbias_jax.gap.problem import Problem

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
NEAR_LIMIT = 0.97
"""Share of a limit from which on a value is at it."""


def usual(problem: Problem) -> list[Hypothesis]:
    """Starting points of a tool all of which turns about x and y, and sags."""
    turns = at_values(problem, EFFECT, ("share", np.array([0, 0, 0, 1, 1, 0])), ("sagging", 1.0))
    fixed = tuple(zip(turns.free, turns.start, strict=True))
    return [_ringing(problem, f, damping)._replace(fixed=fixed) for f in FREQUENCIES for damping in LOG_DAMPINGS]


def balanced(problem: Problem, standing: Standing) -> tuple[float, Hypothesis]:
    """The frequency at which a tool that does not sag gains most, with the few ways of moving that matter; nats."""
    return max((_balanced(problem, standing, f) for f in FREQUENCIES), key=lambda found: found[0])


def _balanced(problem: Problem, standing: Standing, frequency: float) -> tuple[float, Hypothesis]:
    ringing = _ringing(problem, frequency, BETWEEN)
    ways, sagging = _places(problem)
    z = standing.fit.z.copy()
    z[list(ringing.free)] = ringing.start
    prepared = gains(standing, whitened(problem, slopes(problem, z, standing.fit.link, ways)))
    gain, chosen = prepared.pursue(list(range(len(ways))), len(ways), LEAST_WAY)
    free = (*ringing.free, *(ways[i] for i in chosen), sagging)
    shares = np.clip(prepared.coefficients(chosen), LEAST_SHARE, 1).tolist()
    return gain, Hypothesis(EFFECT, free, (*ringing.start, *shares, 0.0))


def freed(problem: Problem, found: Fit) -> Hypothesis | None:
    """The last hypothesis of a fit, if it is a tool on springs that may move in fewer ways, with all ways free."""
    h = found.hypotheses[-1]
    ways, sagging = _places(problem)
    if h.effect != EFFECT or set(ways) <= set(h.free):
        return None
    free = (*h.free[:2], *ways, sagging)
    return h._replace(free=free, start=tuple(found.z[list(free)].tolist()), fixed=())


def is_plausible(problem: Problem, found: Fit) -> bool:
    """Whether no tool on springs of a fit swings as slowly or dies away as fast as they may: such is something else."""
    if not any(h.effect == EFFECT for h in found.hypotheses):
        return True
    period, damping = (found.z[i] for i in _ringing(problem, 1.0, 0.0).free)
    slowest = _ringing(problem, 1 / model.LONGEST_PERIOD, 0.0).start[0]
    return bool(period < NEAR_LIMIT * slowest and damping < NEAR_LIMIT * model.MOST_LOG_DAMPING)


def _ringing(problem: Problem, frequency: float, log_damping: float) -> Hypothesis:
    return at_values(problem, EFFECT, ("period", 1 / frequency), ("log_damping", log_damping))


def _places(problem: Problem) -> tuple[list[int], int]:
    """Coordinates of the shares that may move, and of the sagging."""
    places = model.slices(problem.joints)
    return [places[EFFECT, "share"].start + way for way in WAYS], places[EFFECT, "sagging"].start
