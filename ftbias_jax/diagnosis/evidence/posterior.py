"""How the errors of all numbers that a diagnosis states are correlated: for draws of what the logs allow."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ftbias_jax.diagnosis.evidence.estimates import rows_of
from ftbias_jax.diagnosis.hypothesis import Hypothesis
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression import chain_model
from ftbias_jax.diagnosis.regression.coordinates import strengths
from ftbias_jax.diagnosis.regression.fit import Fit, covariance
from ftbias_jax.diagnosis.result import Candidate
from ftbias_jax.model.effects.fitting import Entries, Touches


def correlations(problem: Problem, fit: Fit, causes: Sequence[Candidate]) -> np.ndarray:
    """(P, P) correlations between the errors of all numbers of the causes, in the order of their parameters.

    By the covariance of the fit (Laplace), to first order in what the coordinates make of the numbers. What was not
    fitted with the others, and entries of a matrix, is taken as independent.

    Args:
        problem: of the fit.
        fit: of all causes together.
        causes: of the fit, and others.
    """
    try:
        spread = covariance(problem, fit)
    except np.linalg.LinAlgError:
        spread = np.zeros((len(fit.free) + len(fit.coefficients),) * 2)
    rows = [np.zeros((0, len(spread)))]
    for cause in causes:
        own = [h for h in fit.hypotheses if h.effect == cause.effect and _joint(h) == cause.parameters.get("joint")]
        rows += [_derivatives(problem, fit, own[0] if own else None, cause, name, spread) for name in cause.parameters]
    slopes = np.concatenate(rows)
    joint = slopes @ spread @ slopes.T
    std = np.sqrt(np.maximum(np.diag(joint), 0))
    known = np.isfinite(std) & (std > 0)
    scaled = np.where(np.outer(known, known), joint / np.where(known, std, 1)[:, None] / np.where(known, std, 1), 0.0)
    np.fill_diagonal(scaled, 1.0)
    return scaled


def _joint(h: Hypothesis) -> int | None:
    return h.detail if isinstance(h.detail, int) else None


def _derivatives(
    problem: Problem, fit: Fit, h: Hypothesis | None, cause: Candidate, name: str, spread: np.ndarray
) -> np.ndarray:
    """(N, K) of the numbers of one parameter with respect to the free coordinates and the coefficients of a fit."""
    count, effect = np.size(cause.parameters[name]), problem.catalogue[cause.effect]
    slopes = np.zeros((count, len(spread)))
    if h is None or isinstance(effect.fit.search, Entries | Touches):
        return slopes
    if h.shapes:
        if name == strengths(effect)[0].name:
            first = len(fit.free) + rows_of(fit, h).start
            slopes[:, first : first + count] = np.eye(count)
        return slopes
    joint = _joint(h)
    told = chain_model.to_values.prepare(problem.parts[0].signals, fit.z, catalogue=problem.catalogue)

    def numbers(z: np.ndarray) -> np.ndarray:
        value = np.asarray(told(problem.parts[0].signals, z)[cause.effect][name], float)
        return np.ravel(value if joint is None else value[joint - 1])

    for i in () if name == "joint" else h.free:
        k = fit.free.index(i)
        step = np.zeros_like(fit.z)
        step[i] = max(np.sqrt(spread[k, k]), 1e-6)
        slopes[:, k] = (numbers(fit.z + step) - numbers(fit.z - step)) / (2 * step[i])
    return slopes
