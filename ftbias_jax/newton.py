"""Maximum likelihood over the noise of many independent filters, some of whose parameters are tied together.

The likelihood is a sum over lanes (a joint or an axis each), so its Hessian is one small block a lane, which as many
gradients as a lane has parameters determine; tying is a linear map of the logarithms. All gradients of an iteration run
side by side in one vmapped call, which costs little more than one of them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.types import Array

LaneScore = Callable[[Array], Array]
"""(K, N) logarithms of K parameters of N lanes -> (N,) nats."""

MAX_ITERATIONS = 60
LONGEST_STEP = 1.5
"""Of a logarithm in one iteration: a factor of 4.5."""
STEP_LENGTHS = np.array([1.0, 0.3, 0.05])
SMALL_GAIN = 1e-5
"""nats; converged when a further step is expected to gain less: far inside every standard error."""
UNDETERMINED = 1.0
"""A combination of logarithms with a larger standard error is not determined by the data."""


class Optimum(NamedTuple):
    """Where the likelihood is largest. P = free values."""

    logs: np.ndarray
    """(P,) logarithms of the free values."""
    stderr: np.ndarray
    """(P,) their standard errors: relative errors of the values; inf where the data say nothing."""
    information: np.ndarray
    """(P, P) observed Fisher information of the logarithms."""
    value: float
    """Log-likelihood, nats."""
    start_value: float
    iterations: int
    converged: bool


def maximise(
    score: LaneScore,
    start: np.ndarray,
    index: np.ndarray,
    report: Callable[[int, float], None] = lambda iteration, value: None,
) -> Optimum:
    """Damped Newton iterations with a parallel line search; needs double precision.

    Args:
        score: per-lane log-likelihood, differentiable. start: (P,) logarithms to start from.
        index: (K, N) which free value each entry of the score's argument is. report: told (iteration, nats).
    """
    values = jax.jit(jax.vmap(lambda x: score(x).sum()))
    slopes = jax.jit(jax.vmap(jax.grad(lambda x: score(x).sum())))
    z = np.asarray(start, float)
    value = start_value = float(values(jnp.stack([jnp.asarray(z[index])] * len(STEP_LENGTHS)))[0])
    converged = False
    for iteration in range(1, MAX_ITERATIONS + 1):
        slope, information = _derivatives(slopes, z, index)
        step, gain = _ascent(slope, information)
        if gain < SMALL_GAIN:
            converged = True
            break
        candidates = z + STEP_LENGTHS[:, None] * step
        trial = np.asarray(values(jnp.asarray(candidates[:, index])))
        trial = np.where(np.isfinite(trial), trial, -np.inf)
        best = int(trial.argmax())
        report(iteration, max(value, float(trial[best])))
        if trial[best] <= value:  # rounding hides what is left to gain
            converged = gain < 1e-2
            break
        z, value = candidates[best], float(trial[best])
    return Optimum(z, standard_errors(information), information, value, start_value, iteration, converged)


def standard_errors(information: np.ndarray) -> np.ndarray:
    """(P,) from the inverse of an information matrix; inf for what it does not determine."""
    strength, directions = np.linalg.eigh(information)
    known = strength > UNDETERMINED**-2
    variance = (directions[:, known] ** 2 / strength[known]).sum(1)
    touched = (directions[:, ~known] ** 2).sum(1) > 1e-2
    return np.where(touched, np.inf, np.sqrt(variance))


def undetermined(information: np.ndarray, names: list[str]) -> list[str]:
    """Combinations of logarithms that the data leave open by more than a factor e, in words."""
    strength, directions = np.linalg.eigh(information)
    phrases = []
    for direction in directions[:, strength <= UNDETERMINED**-2].T:
        order = [i for i in np.argsort(-np.abs(direction)) if abs(direction[i]) > 0.2][:4]
        phrases.append(" * ".join(f"{names[i]}^{direction[i]:+.2f}" for i in order))
    return phrases


def _derivatives(slopes: Callable[[Array], Array], z: np.ndarray, index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gradient (P,) and minus Hessian (P, P) by differences of gradients, all lanes at once."""
    K, P, h = len(index), len(z), 1e-4
    x = z[index]
    slope = np.asarray(slopes(jnp.asarray(np.concatenate([x[None], x + h * np.eye(K)[:, :, None]]))))
    blocks = (slope[1:] - slope[0]) / h  # (K, K, N)
    gradient, hessian = np.zeros(P), np.zeros((P, P))
    np.add.at(gradient, index, slope[0])
    for a in range(K):
        for b in range(K):
            np.add.at(hessian, (index[a], index[b]), blocks[a, b])
    return gradient, -(hessian + hessian.T) / 2


def _ascent(slope: np.ndarray, information: np.ndarray) -> tuple[np.ndarray, float]:
    """Newton's step with directions of wrong or no curvature turned uphill, and the gain it promises in nats."""
    strength, directions = np.linalg.eigh(information)
    along = directions.T @ slope
    safe = np.maximum(np.abs(strength), UNDETERMINED**-2 / 100)
    step = directions @ (along / safe)
    longest = np.abs(step).max()
    return step * min(1.0, LONGEST_STEP / max(longest, 1e-300)), float((along**2 / safe).sum() / 2)
