"""Fits of one or several hypotheses on whitened innovations, with bias and drift as nuisance parameters."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.hypothesis import Hypothesis
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.design_matrix import (
    Columns,
    change,
    channels_first,
    information,
    products,
    scores,
    step_and_gain,
)
from ftbias_jax.diagnosis.regression.evaluate import measured, readings, slopes, whitened, whitened_series
from ftbias_jax.diagnosis.thresholds import BLOCK_SECONDS
from ftbias_jax.filtering.innovation_regression import widened_inverse

MOST_ITERATIONS = 40
ENOUGH = 0.3
"""nats; the fit ends with a step that gains less."""
DAMPINGS = (0.0, 0.03, 1.0, 30.0)
"""Levenberg-Marquardt dampings that are tried together at every step, after the first one as multiples of the previous
best: correlated parameters, such as the stiffness of a cable and its anchor, move along a curved valley."""
LEAST_DAMPING = 1e-6
"""Least damping, below which a damped step equals the full step."""
LONGEST_STEP = 20.0
"""Typical departures; longest step of a coordinate."""


class Fit(NamedTuple):
    """Joint fit of several hypotheses. K = free coordinates, then coefficients of linear series."""

    hypotheses: tuple[Hypothesis, ...]
    z: np.ndarray
    """(P,) coordinates of ``Problem.layout``."""
    coefficients: np.ndarray
    """(6 E,) of the linear series, hypothesis by hypothesis."""
    error: np.ndarray
    """(U, 6) innovations that remain, in standard deviations."""
    columns: Columns
    """Derivatives of the innovations with respect to the free coordinates and the coefficients."""
    free: tuple[int, ...]
    log_likelihood: float
    """nats, up to a constant of the logs."""

    @property
    def degrees(self) -> int:
        """Number of free parameters K."""
        return self.columns.size

    def of_series(self) -> np.ndarray:
        """(U, 6) N, Nm, or zeros (1, 6): what the linear series add to the reading; the coordinates do the rest."""
        shapes = [shape[:, None] for h in self.hypotheses for shape in h.shapes]
        return np.hstack(shapes) @ self.coefficients.reshape(-1, 6) if shapes else np.zeros((1, 6))

    def places(self, h: Hypothesis) -> list[int]:
        """Indices of the coordinates of one hypothesis among the free ones."""
        return [self.free.index(i) for i in h.free]

    def spread(self, h: Hypothesis, covariance: np.ndarray) -> np.ndarray:
        """Covariance of the coordinates of one hypothesis, taken from the covariance of all parameters."""
        own = self.places(h)
        return covariance[np.ix_(own, own)]

    def beside(self, h: Hypothesis) -> tuple[Hypothesis, ...]:
        """All hypotheses but this one."""
        return tuple(other for other in self.hypotheses if other is not h)


def predicted(problem: Problem, found: Fit) -> np.ndarray:
    """(U, 6) N, Nm: mean readings predicted by a fit, without bias and noise."""
    whole: np.ndarray = readings(problem, found.z[None])[0] + found.of_series()
    return whole


def base(problem: Problem) -> Fit:
    """Fit of the nominal model."""
    nothing = Columns(*np.zeros((2, 0, len(problem.t), 6)))
    z = np.zeros(problem.layout.size)
    error = _errors(problem, z[None])[0]
    return Fit((), z, np.zeros(0), error, nothing, (), _log_likelihood(error))


def fit(
    problem: Problem, hypotheses: tuple[Hypothesis, ...], start: Fit, enough: float = 0.0, most: int = MOST_ITERATIONS
) -> Fit:
    """Levenberg-Marquardt over the coordinates, with the linear coefficients solved for exactly at every step.

    Hypotheses that ``start`` contains too continue from there. The fit ends after ``most`` steps, or after one that
    gains less than a share ``enough`` of the whole gain.
    """
    z = start.z.copy()
    z[[*start.free, *(i for h in start.hypotheses for i, _ in h.fixed)]] = 0
    there = {id(h) for h in start.hypotheses}
    for h in hypotheses:
        z = h.begin(z)
        if id(h) in there:
            z[list(h.free)] = start.z[list(h.free)]
    free = _free(hypotheses)
    prior_std = _prior_std(hypotheses, free)
    series = _series(problem, hypotheses, start)
    project = projection(series)
    if np.array_equal(z, start.z):  # the model is unchanged and need not be evaluated
        error = start.error - change(start.columns._replace(moving=series[:0]), start.coefficients)
    else:
        error = _errors(problem, z[None])[0]
    (coefficients,), (error,) = project(error[None])
    cost = _cost(error, z[list(free)], prior_std)
    first, moving, damping, known = cost, None, 1.0, _known(start, hypotheses)
    bounds = problem.layout.least, problem.layout.most
    for _ in range(most if free and np.isfinite(cost) else 0):
        moving = _moving(problem, z, free, known)
        columns = project(moving)[1]
        trials = np.repeat(z[None], len(DAMPINGS), 0)
        least, most_of = (bound[list(free)] for bound in bounds)
        dampings = [damping * factor for factor in DAMPINGS]
        trials[:, list(free)] = _trials(columns, error, z[list(free)], prior_std, least, most_of, dampings)
        solved, errors = project(_errors(problem, trials))
        costs = [_cost(e, trial[list(free)], prior_std) for e, trial in zip(errors, trials, strict=True)]
        best = int(np.argmin(costs))
        gained = cost - costs[best]
        if gained > 0:
            z, cost, coefficients, error = trials[best], costs[best], solved[best], errors[best]
        if gained < max(ENOUGH, enough * (first - cost)):
            if damping >= 1.0 and not known:
                break
            damping = 1.0
        else:
            damping = max(dampings[best] or damping, LEAST_DAMPING)
        known = {}
    if moving is None:
        moving = _moving(problem, z, free, {}) if free else series[:0]
    # The derivatives are from before the last, short step.
    return Fit(hypotheses, z, coefficients, error, Columns(moving, series), free, _log_likelihood(error))


def first_order(accepted: Fit, h: Hypothesis, columns: np.ndarray) -> Fit:
    """First-order prediction of a fit with one more hypothesis, from its derivatives (F, U, 6) at the accepted fit."""
    whole = accepted.columns._replace(moving=np.concatenate([accepted.columns.moving, columns]))
    hypotheses, free = (*accepted.hypotheses, h), (*accepted.free, *h.free)
    start = accepted._replace(hypotheses=hypotheses, z=h.begin(accepted.z), free=free)
    return stepped(start, whole, accepted.error)[0]


def undamped(problem: Problem, hypotheses: tuple[Hypothesis, ...], start: Fit) -> np.ndarray:
    """(P,) coordinates after one undamped step from a fit, with the coefficients of its series solved for jointly."""
    free = _free(hypotheses)
    own, prior_std = list(free), _prior_std(hypotheses, free)
    columns = start.columns._replace(moving=whitened(problem, slopes(problem, start.z, free)))
    pull = products(columns, start.error[None])[0]
    pull[: len(free)] += start.z[own] / prior_std**2
    z = start.z.copy()
    z[own] -= information(columns, prior_std).solve(pull[:, None])[: len(free), 0]
    return np.clip(z, problem.layout.least, problem.layout.most)


def stepped(start: Fit, columns: Columns, error: np.ndarray) -> tuple[Fit, float]:
    """A fit after one Gauss-Newton step with these columns and innovations (U, 6), and the nats that it gains."""
    step, gain = step_and_gain(columns, error)
    z, moving = start.z.copy(), len(start.free)
    z[list(start.free)] += step[:moving]
    error, coefficients = error + change(columns, step), start.coefficients + step[moving:]
    likelihood = _log_likelihood(error)
    return start._replace(z=z, coefficients=coefficients, error=error, columns=columns, log_likelihood=likelihood), gain


def _errors(problem: Problem, z: np.ndarray) -> np.ndarray:
    """(C, U, 6) innovations of prediction - reading at coordinates (C, P).

    All NaN for a prediction that is not finite, which would otherwise count as missing and look perfect.
    """
    made = readings(problem, z)
    sound = np.isfinite(made).all((1, 2))
    error = whitened(problem, np.where(sound[:, None, None], made, 0) - np.nan_to_num(measured(problem)))
    error[~sound] = np.nan
    return error


def _known(start: Fit, hypotheses: tuple[Hypothesis, ...]) -> dict[int, np.ndarray]:
    """Derivatives (U, 6) with respect to coordinates shared with another fit, good enough for a first step from it."""
    there = {id(h) for h in start.hypotheses}
    shared = {i for h in hypotheses if id(h) in there for i in h.free}
    return {i: column for i, column in zip(start.free, start.columns.moving, strict=True) if i in shared}


def _moving(problem: Problem, z: np.ndarray, free: tuple[int, ...], known: dict[int, np.ndarray]) -> np.ndarray:
    """(F, U, 6) whitened derivatives with respect to the free coordinates; known ones are reused."""
    others = [i for i in free if i not in known]
    made = dict(zip(others, whitened(problem, slopes(problem, z, others)), strict=True)) if others else {}
    return np.stack([known[i] if i in known else made[i] for i in free])


def _series(problem: Problem, hypotheses: tuple[Hypothesis, ...], start: Fit) -> np.ndarray:
    """(E, U, 6) whitened linear series; those of ``start`` are reused."""
    pieces = np.split(start.columns.series, np.cumsum([len(h.shapes) for h in start.hypotheses]))
    there = {id(h): piece for h, piece in zip(start.hypotheses, pieces[:-1], strict=True)}
    series = [there[id(h)] if id(h) in there else whitened_series(problem, h.shapes) for h in hypotheses]
    return np.concatenate([start.columns.series[:0], *series])


def projection(series: np.ndarray) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Function that projects whitened series (E, U, 6), with a coefficient per channel, out of errors (C, U, 6).

    It returns the coefficients (C, 6 E) that bring error + sum c series nearest to zero, and the remaining errors.
    """
    columns, by_channel = Columns(series[:0], series), channels_first(series)
    normal = information(columns)

    def project(errors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        coefficients = -normal.solve(products(columns, errors).T).T
        of_channel = coefficients.reshape(len(errors), len(series), 6).transpose(2, 0, 1)
        return coefficients, errors + (of_channel @ by_channel).transpose(1, 2, 0)

    return project


def _log_likelihood(error: np.ndarray) -> float:
    return -float((error**2).sum()) / 2 if np.isfinite(error).all() else -np.inf


def _free(hypotheses: tuple[Hypothesis, ...]) -> tuple[int, ...]:
    """Coordinates that any hypothesis fits, each once."""
    return tuple(dict.fromkeys(i for h in hypotheses for i in h.free))


def _prior_std(hypotheses: tuple[Hypothesis, ...], free: tuple[int, ...]) -> np.ndarray:
    """(F,) prior standard deviations of the free coordinates, in typical departures."""
    of_place = {i: h.prior_std for h in hypotheses for i in h.free}
    return np.array([of_place[i] for i in free])


def _cost(error: np.ndarray, at: np.ndarray, prior_std: np.ndarray) -> float:
    return -_log_likelihood(error) + float(((at / prior_std) ** 2).sum()) / 2


def _trials(
    columns: np.ndarray,
    error: np.ndarray,
    at: np.ndarray,
    prior_std: np.ndarray,
    least: np.ndarray,
    most: np.ndarray,
    dampings: Sequence[float],
) -> np.ndarray:
    """(D, F) next values of the coordinates ``at`` (F,) for D dampings, within their bounds.

    The series are projected out of the derivatives (F, U, 6).
    """
    flat = columns.reshape(len(columns), -1)
    pull = flat @ error.ravel() + at / prior_std**2
    # A coordinate at a bound that would step beyond it is held, or else the others would move as if it did.
    able = np.where(pull > 0, at > least, at < most)
    normal = (flat @ flat.T + np.diag(prior_std**-2))[np.ix_(able, able)]
    trials: np.ndarray = np.repeat(at[None], len(dampings), 0)
    for trial, damping in zip(trials, dampings, strict=True):
        step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), pull[able])
        trial[able] -= np.clip(step, -LONGEST_STEP, LONGEST_STEP)
    return np.clip(trials, least, most, out=trials)


def log_likelihood_gain(problem: Problem, better: np.ndarray, worse: np.ndarray) -> tuple[float, float]:
    """Log-likelihood gain in nats of innovations (U, 6) over others, and its standard error from blocks."""
    by_block = np.bincount(problem.block(BLOCK_SECONDS), (worse**2 - better**2).sum(1)) / 2
    return float(by_block.sum()), float(np.sqrt(len(by_block)) * by_block.std())


def covariance(problem: Problem, fit: Fit, further: np.ndarray | None = None) -> np.ndarray:
    """(K, K) covariance of the free parameters, widened where block scores scatter more than with white noise.

    ``further`` holds the whitened derivatives (M, U, 6) of parameters that were searched on a grid: these come between
    the coordinates and the coefficients.
    """
    columns = fit.columns
    if further is not None:
        columns = columns._replace(moving=np.concatenate([columns.moving, further]))
    by_block = scores(columns, fit.error, problem.block(BLOCK_SECONDS))
    return widened_inverse(by_block, information(columns, _prior_std(fit.hypotheses, fit.free)).matrix())
