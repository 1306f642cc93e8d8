"""Maximum likelihood by the gradient over parameters that are common to all filters and logs.

For the noise of independent filters Newton's method (newton.py) is faster, because its Hessian falls into small blocks.
Sigma_D is different: each of its numbers reaches all axes and the logs of all tools. Here L-BFGS (optax) climbs by
gradients that come from the hand-written reverse pass of the filter, and the Hessian is taken once, at the end, by
differences of gradients: it gives the standard errors, says which combinations the data leave open, and makes the last
step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from ftbias_jax.calibration.newton import (
    LONGEST_STEP,
    SHORTEN,
    SHORTENINGS,
    SMALL_GAIN,
    UNDETERMINED,
    Optimum,
    Report,
    for_each,
    quiet,
    standard_errors,
)
from ftbias_jax.types import Array

Score = Callable[[Array, Any], Array]
"""(P,) logarithms and a part of the data -> () nats. Equal scores that hash alike share one compiled program."""

MAX_ITERATIONS = 200
ROUNDS = 8
"""L-BFGS and the Newton step at its end are repeated at most so often."""
DIFFERENCE = 1e-3
"""Of a logarithm, to take the Hessian by central differences of gradients."""
ARMIJO = 1e-4
"""Share of the gain promised by the slope that a step must keep."""

_SOLVER = optax.lbfgs(learning_rate=1.0, linesearch=None)


class _Point(NamedTuple):
    z: np.ndarray
    value: float
    slope: np.ndarray


def maximise(score: Score, parts: Sequence[Any], starts: np.ndarray, report: Report = quiet) -> Optimum:
    """The logarithms of largest likelihood; needs double precision.

    Args:
        score: log-likelihood of a part, differentiable in the logarithms.
        parts: of the data, pytrees of arrays of the same shapes; the likelihood is the sum over them.
        starts: (S, P) logarithms to start from; the best of where they lead is returned.
        report: called with (iteration, nats).
    """
    evaluate = partial(_evaluate, score, parts)
    found = [_from(evaluate, z, report) for z in np.asarray(starts, float)]
    best = max(found, key=lambda optimum: optimum.value)
    agreeing = sum(optimum.value > best.value - 2 * SMALL_GAIN for optimum in found)
    return best._replace(starts=len(found), agreeing=agreeing)


def _from(evaluate: Callable[[np.ndarray], _Point], start: np.ndarray, report: Report) -> Optimum:
    """L-BFGS, the Hessian, Newton's step along what the data determine; again if that step still gains."""
    here, iterations, converged = evaluate(start), 0, False
    for _ in range(ROUNDS):
        here, count = _climb(evaluate, here, partial(_report_from, report, iterations))
        iterations += count
        information = _information(evaluate, here.z)
        step = _newton_step(here.slope, information)
        converged = bool(here.slope @ step / 2 < SMALL_GAIN)
        there = evaluate(here.z + step)
        here = there if there.value > here.value else here
        if converged:
            break
    stderr = standard_errors(information)
    return Optimum(here.z, stderr, information, here.value, iterations, converged, 1, 1)


def _report_from(report: Report, before: int, iteration: int, value: float) -> None:
    report(before + iteration, value)


def _climb(evaluate: Callable[[np.ndarray], _Point], here: _Point, report: Report) -> tuple[_Point, int]:
    """L-BFGS until a step promises next to nothing; the memory is dropped where it points downhill."""
    state, fresh = _SOLVER.init(jnp.asarray(here.z)), True
    for iteration in range(1, MAX_ITERATIONS + 1):
        step, state = _direction(here.slope, state, here.z)
        step = np.asarray(step)
        step = step * min(1.0, LONGEST_STEP / max(np.abs(step).max(), 1e-300))
        promise = float(here.slope @ step)
        if 0 <= promise < SMALL_GAIN / 10:
            return here, iteration
        there = _along(evaluate, here, step, promise) if promise > 0 else None
        if there is None and fresh:
            return here, iteration
        if there is None:
            state, fresh = _SOLVER.init(jnp.asarray(here.z)), True
            continue
        here, fresh = there, False
        report(iteration, here.value)
    return here, MAX_ITERATIONS


@jax.jit
def _direction(slope: Array, state: Any, z: Array) -> tuple[Array, Any]:
    """Uphill direction of L-BFGS, which takes the gradient of a loss."""
    step, state = _SOLVER.update(-slope, state, z)
    return step, state


def _along(evaluate: Callable[[np.ndarray], _Point], here: _Point, step: np.ndarray, promise: float) -> _Point | None:
    """The first point on the way back to ``here`` that keeps a share of the promised gain."""
    for shortening in range(SHORTENINGS + 1):
        share = SHORTEN**shortening
        there = evaluate(here.z + share * step)
        if there.value > here.value + ARMIJO * share * promise:
            return there
    return None


def _evaluate(score: Score, parts: Sequence[Any], z: np.ndarray) -> _Point:
    found = for_each(partial(_value_and_slope, score, jnp.asarray(z)), parts)
    value, slope = (sum(x) for x in zip(*found, strict=True))
    return _Point(z, float(value) if np.isfinite(value) else -np.inf, np.nan_to_num(np.asarray(slope)))


@partial(jax.jit, static_argnames="score")
def _value_and_slope(score: Score, z: Array, part: Any) -> tuple[Array, Array]:
    value, slope = jax.value_and_grad(score)(z, part)
    return value, slope


def _information(evaluate: Callable[[np.ndarray], _Point], z: np.ndarray) -> np.ndarray:
    """(P, P) minus the Hessian."""
    shifts = DIFFERENCE * np.eye(len(z))
    hessian = np.stack([evaluate(z + s).slope - evaluate(z - s).slope for s in shifts]) / (2 * DIFFERENCE)
    return -(hessian + hessian.T) / 2


def _newton_step(slope: np.ndarray, information: np.ndarray) -> np.ndarray:
    """Along the directions that the data determine."""
    strength, directions = np.linalg.eigh(information)
    known = strength > UNDETERMINED**-2
    directions, strength = directions[:, known], strength[known]
    step = directions @ (directions.T @ slope / strength)
    return np.asarray(step * min(1.0, LONGEST_STEP / max(np.abs(step).max(), 1e-300)))


def combination_errors(information: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Standard errors of linear combinations of the logarithms, where what is open counts with an error of 1.

    Args:
        information: (P, P).
        weights: (..., P).

    Returns:
        (...).
    """
    strength, directions = np.linalg.eigh(information)
    error: np.ndarray = np.sqrt(((weights @ directions) ** 2 / np.maximum(strength, UNDETERMINED**-2)).sum(-1))
    return error


def open_directions(information: np.ndarray, names: Sequence[str]) -> list[str]:
    """What the data leave open by more than a factor e: a number and what makes up for it; those without any, at last.

    Args:
        information: (P, P) of the logarithms.
        names: P.
    """
    strength, directions = np.linalg.eigh(information)
    space = directions[:, strength <= UNDETERMINED**-2]  # (P, d)
    pivots = _pivots(space)
    moves = space @ np.linalg.inv(space[pivots]) if pivots else space  # a pivot moves by 1, the other pivots stay
    together, alone = [], []
    for pivot, move in zip(pivots, moves.T, strict=True):
        partners = [name for name, shift in zip(names, move, strict=True) if abs(shift) > 0.01 and name != names[pivot]]
        if partners:
            together.append(f"{names[pivot]} only together with {', '.join(partners)}")
        else:
            alone.append(names[pivot])
    return together + ([f"{', '.join(alone)} (not distinguishable from zero)"] if alone else [])


def _pivots(space: np.ndarray) -> list[int]:
    """Coordinates (d of P) that a subspace can set at will: the first ones, but none that it hardly moves."""
    rest, pivots = space.copy(), []
    for _ in range(space.shape[1]):
        moved = (rest**2).sum(1)
        pivot = int(np.argmax(moved > 0.01 * moved.max()))
        pivots.append(pivot)
        row = rest[pivot] / np.linalg.norm(rest[pivot])
        rest = rest - np.outer(rest @ row, row)
    return pivots
