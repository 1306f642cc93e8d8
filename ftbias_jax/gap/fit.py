"""Fits of one or several hypotheses on whitened innovations, with bias and drift as nuisance."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from ftbias_jax.gap import model
from ftbias_jax.gap.hypotheses import Hypothesis, spread
from ftbias_jax.gap.problem import Problem
from ftbias_jax.regression import widened_inverse

DIRECTIONS = (4, 8, 16, 32, 96)
EXTRAS = (0, 8, 32, 96, 256)
"""Numbers of columns that fits are padded to, so that they share compiled programs."""
MOST_ITERATIONS = 12
PRIOR_STD = 30.0
"""Of a coordinate, in typical departures: keeps what the motion does not excite at zero."""
BLOCK_SECONDS = 2.0


class Fit(NamedTuple):
    """Hypotheses together at their best. K = free coordinates and coefficients."""

    hypotheses: tuple[Hypothesis, ...]
    z: np.ndarray
    """(P,) coordinates of model.blocks."""
    link: float
    coefficients: np.ndarray
    """(6 E,) of the linear series, hypothesis by hypothesis."""
    error: np.ndarray
    """(B, 6) innovations that remain, in standard deviations."""
    columns: np.ndarray
    """(K, B, 6) their derivatives by the free coordinates, then by the coefficients."""
    free: tuple[int, ...]
    log_likelihood: float
    """nats, up to a constant of the log."""

    @property
    def degrees(self) -> int:
        """Free numbers."""
        return len(self.columns)


def base(problem: Problem) -> Fit:
    """The believed model."""
    return fit(problem, ())


def fit(
    problem: Problem, hypotheses: tuple[Hypothesis, ...], start: Fit | None = None, iterations: int = MOST_ITERATIONS
) -> Fit:
    """Levenberg-Marquardt over the coordinates, with the linear coefficients solved for exactly at every step.

    Args:
        problem: of the log. hypotheses: what to fit together; those that ``start`` has too continue from there.
    """
    n = problem.signals.q.shape[1]
    z = np.zeros(model.size(n)) if start is None else start.z.copy()
    known = () if start is None else start.hypotheses
    for h in hypotheses:
        if h not in known and h.free:
            z[list(h.free)] = h.start
    link = next((h.link for h in hypotheses if h.effect == "cable"), 0.0)
    free = tuple(dict.fromkeys(i for h in hypotheses for i in h.free))
    nothing = np.zeros((0, len(problem.samples), 6))
    extra = np.concatenate([nothing, *(spread(h.shapes) for h in hypotheses if h.shapes)])
    current = _linearise(problem, hypotheses, z, link, free, extra)
    damping = 1e-3
    for _ in range(iterations if free else 0):
        step = _step(current, len(free), damping, z[list(free)])
        trial_z = z.copy()
        trial_z[list(free)] += step
        trial = _linearise(problem, hypotheses, trial_z, link, free, extra)
        gained = _cost(current, free) - _cost(trial, free)
        if gained > 0:
            z, current, damping = trial_z, trial, max(damping / 10, 1e-6)
            if gained < 0.3:
                break
        else:
            damping *= 20
            if damping > 1e5 or gained > -0.05:
                break
    return current


def _linearise(
    problem: Problem,
    hypotheses: tuple[Hypothesis, ...],
    z: np.ndarray,
    link: float,
    free: tuple[int, ...],
    extra: np.ndarray,
) -> Fit:
    wanted = next(size for size in DIRECTIONS if size >= len(free))
    directions = np.zeros((wanted, len(z)))
    directions[np.arange(len(free)), list(free)] = 1
    room = next(size for size in EXTRAS if size >= len(extra))
    padded = np.zeros((room, len(problem.samples), 6))
    padded[: len(extra)] = extra
    error, columns, valid = model.linearise(
        problem.signals,
        problem.wrench,
        problem.known,
        jnp.asarray(z),
        jnp.asarray(link),
        jnp.asarray(directions),
        jnp.asarray(padded),
    )
    error, columns = np.asarray(error), np.asarray(columns)
    moving, linear = columns[: len(free)], columns[wanted : wanted + len(extra)]
    coefficients = _solve(linear.reshape(len(linear), error.size), error.ravel())
    error = error + np.tensordot(coefficients, linear, 1)
    columns = np.concatenate([moving, linear])
    log_likelihood = -float((error**2).sum()) / 2 if valid else -np.inf
    return Fit(hypotheses, z, link, coefficients, error, columns, free, log_likelihood)


def _solve(columns: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Coefficients that bring error + sum c columns nearest to zero; tiny ridge for columns that vanish."""
    if not len(columns):
        return np.zeros(0)
    normal = columns @ columns.T
    ridge = 1e-9 * np.diag(normal).max() + 1e-12
    return -np.linalg.solve(normal + ridge * np.eye(len(normal)), columns @ error)


def _cost(fit: Fit, free: tuple[int, ...]) -> float:
    return -fit.log_likelihood + float((fit.z[list(free)] ** 2).sum()) / (2 * PRIOR_STD**2)


def _step(fit: Fit, moving: int, damping: float, at: np.ndarray) -> np.ndarray:
    """Step of the coordinates; the coefficients follow along."""
    flat = fit.columns.reshape(len(fit.columns), fit.error.size)
    normal = flat @ flat.T
    pull = flat @ fit.error.ravel()
    normal[np.arange(moving), np.arange(moving)] += PRIOR_STD**-2
    pull[:moving] += at / PRIOR_STD**2
    damped = normal + damping * np.diag(np.diag(normal)) + 1e-9 * np.eye(len(normal))
    step = -np.linalg.solve(damped, pull)[:moving]
    return np.clip(step, -20, 20)


def added_gain(fit: Fit, columns: np.ndarray) -> float:
    """nats that further columns (K, B, 6) would gain on top of a fit, all coefficients solved again together."""
    own = fit.columns.reshape(len(fit.columns), fit.error.size)
    flat = columns.reshape(len(columns), -1)
    if len(own):
        normal = own @ own.T + 1e-9 * np.eye(len(own)) * max(np.trace(own @ own.T) / len(own), 1e-12)
        flat = flat - (flat @ own.T) @ np.linalg.solve(normal, own)
    error = fit.error.ravel()
    normal, pull = flat @ flat.T, flat @ error
    ridge = 1e-8 * max(np.trace(normal) / len(normal), 1e-12)
    return float(pull @ np.linalg.solve(normal + ridge * np.eye(len(normal)), pull)) / 2


def block_scores(problem: Problem, fit: Fit) -> np.ndarray:
    """nats of each block of BLOCK_SECONDS, up to a constant."""
    block = (np.asarray(problem.signals.t) / BLOCK_SECONDS).astype(int)
    return -np.bincount(block[: problem.used], (fit.error[: problem.used] ** 2).sum(1)) / 2


def covariance(problem: Problem, fit: Fit) -> np.ndarray:
    """(K, K) of the free numbers, widened where the scores of whole blocks scatter more than white noise would."""
    flat = fit.columns.reshape(len(fit.columns), -1)
    normal = flat @ flat.T
    normal += 1e-9 * np.eye(len(normal)) * max(np.trace(normal) / max(len(normal), 1), 1e-12)
    normal[np.arange(len(fit.free)), np.arange(len(fit.free))] += PRIOR_STD**-2
    return widened_inverse(fit.columns, fit.error, np.asarray(problem.signals.t) / BLOCK_SECONDS, normal)
