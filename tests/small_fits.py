"""Synthetic fits without a model, and plain least squares on the columns that they represent."""

import numpy as np

from ftbias_jax.diagnosis.hypothesis import Hypothesis
from ftbias_jax.diagnosis.regression.design_matrix import Columns
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.types import Array


def small_fit(moving: Array, error: Array, free: tuple[int, ...], hypotheses: tuple[Hypothesis, ...] = ()) -> Fit:
    """A fit with derivatives (F, U, 6) with respect to the coordinates ``free`` of eight, and residuals (U, 6)."""
    columns = Columns(moving, moving[:0])
    return Fit(hypotheses, np.zeros(8), np.zeros(0), error, columns, free, -float((error**2).sum()) / 2)


def at_its_best(rng: np.random.Generator, count: int, bins: int) -> Fit:
    """A fit with ``count`` random columns, at its optimum."""
    columns, error = rng.normal(size=(count, bins, 6)), rng.normal(size=(bins, 6))
    return small_fit(columns, residual(columns, error), tuple(range(count)))


def dense(columns: Columns) -> Array:
    """(K, U, 6): a series in one channel after the other."""
    alone = columns.series[:, None] * np.eye(6)[None, :, None]
    return np.concatenate([columns.moving, alone.reshape(-1, *columns.series.shape[1:])])


def shift(columns: Array, error: Array) -> Array:
    """(M,) coefficients that minimise error + sum of coefficients times columns (M, ...)."""
    return np.linalg.lstsq(columns.reshape(len(columns), error.size).T, -error.ravel(), rcond=None)[0]


def residual(columns: Array, error: Array) -> Array:
    """The error that remains after least squares."""
    return error + np.tensordot(shift(columns, error), columns, 1)
