"""Fits of one or several hypotheses on whitened innovations, with bias and drift as nuisance."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ftbias_jax.gap import model
from ftbias_jax.gap.evaluate import measured, readings, slopes, whitened
from ftbias_jax.gap.hypotheses import Hypothesis, spread
from ftbias_jax.gap.problem import Problem
from ftbias_jax.regression import widened_inverse

MOST_ITERATIONS = 12
ENOUGH = 0.3
"""nats; a step that gains less is the last."""
DAMPINGS = (0.0, 1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0, 1e4)
"""All tried at once at every step."""
LONGEST_STEP = 20.0
"""Typical departures."""
PRIOR_STD = 30.0
"""Of a coordinate, in typical departures: keeps what the motion does not excite at zero."""
BLOCK_SECONDS = 2.0


class Fit(NamedTuple):
    """Hypotheses together at their best. K = free coordinates, then coefficients of linear series."""

    hypotheses: tuple[Hypothesis, ...]
    z: np.ndarray
    """(P,) coordinates of model.blocks."""
    link: float
    coefficients: np.ndarray
    """(6 E,) of the linear series, hypothesis by hypothesis."""
    error: np.ndarray
    """(U, 6) innovations that remain, in standard deviations."""
    columns: np.ndarray
    """(K, U, 6) their derivatives by the free coordinates, then by the coefficients."""
    free: tuple[int, ...]
    log_likelihood: float
    """nats, up to a constant of the logs."""

    @property
    def degrees(self) -> int:
        """Free numbers."""
        return len(self.columns)

    @property
    def series(self) -> np.ndarray:
        """(6 E, U, 6) whitened linear series."""
        return self.columns[len(self.free) :]


def base(problem: Problem) -> Fit:
    """The believed model."""
    nothing = np.zeros((0, len(problem.t), 6))
    z = np.zeros(model.size(problem.joints))
    error = _errors(problem, z[None], 0.0)[0]
    return Fit((), z, 0.0, np.zeros(0), error, nothing, (), _log_likelihood(error))


def fit(problem: Problem, hypotheses: tuple[Hypothesis, ...], start: Fit, iterations: int = MOST_ITERATIONS) -> Fit:
    """Levenberg-Marquardt over the coordinates, with the linear coefficients solved for exactly at every step.

    Args:
        problem: of the logs. hypotheses: what to fit together; those that ``start`` has too continue from there.
        start: another fit, such as ``base``.
    """
    z = start.z.copy()
    z[list(start.free)] = 0
    there = {id(h) for h in start.hypotheses}
    for h in hypotheses:
        z[list(h.free)] = start.z[list(h.free)] if id(h) in there else h.start
    link = next((h.link for h in hypotheses if h.effect == "cable"), 0.0)
    free = tuple(dict.fromkeys(i for h in hypotheses for i in h.free))
    series = _series(problem, hypotheses, start)
    if np.array_equal(z, start.z) and link == start.link:  # the model is as it was: no need to evaluate it
        error = start.error - np.tensordot(start.coefficients, start.series, 1)
    else:
        error = _errors(problem, z[None], link)[0]
    coefficients, error = _project(series, error)
    cost = _cost(error, z, free)
    for _ in range(iterations if free and np.isfinite(cost) else 0):
        moving = whitened(problem, slopes(problem, z, link, free))
        columns = np.concatenate([moving, series])
        trials = np.repeat(z[None], len(DAMPINGS), 0)
        trials[:, list(free)] += _steps(columns, error, z[list(free)])
        projected = [_project(series, e) for e in _errors(problem, trials, link)]
        costs = [_cost(e, trial, free) for (_, e), trial in zip(projected, trials, strict=True)]
        best = int(np.argmin(costs))
        gained = cost - costs[best]
        if gained > 0:
            z, cost, (coefficients, error) = trials[best], costs[best], projected[best]
        if gained < ENOUGH:
            break
    moving = whitened(problem, slopes(problem, z, link, free)) if free else series[:0]
    columns = np.concatenate([moving, series])
    return Fit(hypotheses, z, link, coefficients, error, columns, free, _log_likelihood(error))


def _errors(problem: Problem, z: np.ndarray, link: float) -> np.ndarray:
    """(C, P) -> (C, U, 6) innovations of prediction - reading.

    All NaN for a prediction that is no number, which would count as missing and look perfect.
    """
    predicted = readings(problem, z, np.full(len(z), link))
    error = whitened(problem, predicted - np.nan_to_num(measured(problem)))
    error[~np.isfinite(predicted).all((1, 2))] = np.nan
    return error


def _series(problem: Problem, hypotheses: tuple[Hypothesis, ...], start: Fit) -> np.ndarray:
    """(6 E, U, 6) whitened linear series; those that ``start`` has are taken from there."""
    ends = np.cumsum([6 * len(h.shapes) for h in start.hypotheses])
    there = {id(h): start.series[end - 6 * len(h.shapes) : end] for h, end in zip(start.hypotheses, ends, strict=True)}
    series = [there[id(h)] if id(h) in there else whitened(problem, spread(h.shapes)) for h in hypotheses if h.shapes]
    return np.concatenate([start.columns[:0], *series])


def _project(series: np.ndarray, error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients that bring error + sum c series nearest to zero, and what remains."""
    if not len(series):
        return np.zeros(0), error
    flat = series.reshape(len(series), -1)
    normal = flat @ flat.T
    ridge = 1e-9 * np.diag(normal).max() + 1e-12  # for series that vanish
    coefficients = -np.linalg.solve(normal + ridge * np.eye(len(normal)), flat @ error.ravel())
    return coefficients, error + np.tensordot(coefficients, series, 1)


def _log_likelihood(error: np.ndarray) -> float:
    return -float((error**2).sum()) / 2 if np.isfinite(error).all() else -np.inf


def _cost(error: np.ndarray, z: np.ndarray, free: tuple[int, ...]) -> float:
    return -_log_likelihood(error) + float((z[list(free)] ** 2).sum()) / (2 * PRIOR_STD**2)


def _steps(columns: np.ndarray, error: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(len(DAMPINGS), F) steps of the coordinates ``at``; the coefficients follow along."""
    moving = len(at)
    flat = columns.reshape(len(columns), -1)
    normal = flat @ flat.T
    pull = flat @ error.ravel()
    normal[np.arange(moving), np.arange(moving)] += PRIOR_STD**-2
    pull[:moving] += at / PRIOR_STD**2
    ridge = 1e-9 * np.eye(len(normal))
    steps = [-np.linalg.solve(normal + d * np.diag(np.diag(normal)) + ridge, pull)[:moving] for d in DAMPINGS]
    return np.clip(steps, -LONGEST_STEP, LONGEST_STEP)


class Gains(NamedTuple):
    """What further columns would gain on top of a fit, all coefficients solved for again together, to first order."""

    normal: np.ndarray
    """(M, M) products of the columns, after those of the fit are taken out of them."""
    pull: np.ndarray
    """(M,) products with the error."""

    def of(self, chosen: list[int]) -> float:
        """nats that these columns gain together."""
        normal, pull = self.normal[np.ix_(chosen, chosen)], self.pull[chosen]
        ridge = 1e-8 * max(np.trace(normal) / len(normal), 1e-12)
        return float(pull @ np.linalg.solve(normal + ridge * np.eye(len(normal)), pull)) / 2

    def each(self) -> np.ndarray:
        """(M,) nats of every column by itself."""
        gain: np.ndarray = self.pull**2 / np.maximum(np.diag(self.normal), 1e-12) / 2
        return gain


def gains(accepted: Fit, columns: np.ndarray) -> Gains:
    """Prepare the gains of whitened columns (M, U, 6) on top of a fit."""
    own = accepted.columns.reshape(len(accepted.columns), accepted.error.size)
    flat, error = columns.reshape(len(columns), -1), accepted.error.ravel()
    normal, pull = flat @ flat.T, flat @ error
    if len(own):
        square = own @ own.T
        square += 1e-9 * np.eye(len(own)) * max(np.trace(square) / len(own), 1e-12)
        shared = flat @ own.T
        normal -= shared @ np.linalg.solve(square, shared.T)
        pull -= shared @ np.linalg.solve(square, own @ error)
    return Gains(normal, pull)


def block_scores(problem: Problem, fit: Fit) -> np.ndarray:
    """nats of each block of BLOCK_SECONDS, up to a constant."""
    return -np.bincount(problem.block(BLOCK_SECONDS), (fit.error**2).sum(1)) / 2


def covariance(problem: Problem, fit: Fit, further: np.ndarray | None = None) -> np.ndarray:
    """(K, K) of the free numbers, widened where the scores of whole blocks scatter more than white noise would.

    Args:
        problem: of the logs. fit: at its best. further: (M, U, 6) whitened derivatives by M numbers that were searched
            on a grid; they come last.
    """
    columns = fit.columns if further is None else np.concatenate([fit.columns, further])
    flat = columns.reshape(len(columns), -1)
    normal = flat @ flat.T
    normal += 1e-9 * np.eye(len(normal)) * max(np.trace(normal) / max(len(normal), 1), 1e-12)
    normal[np.arange(len(fit.free)), np.arange(len(fit.free))] += PRIOR_STD**-2
    return widened_inverse(columns, fit.error, problem.block(BLOCK_SECONDS), normal)
