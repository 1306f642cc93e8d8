"""Made-up fits without a model, and plain least squares on what their columns stand for."""

import numpy as np

from ftbias_jax.diagnosis.hypothesis import Hypothesis
from ftbias_jax.diagnosis.regression.design_matrix import Columns
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.types import Array


def small_fit(moving: Array, error: Array, free: tuple[int, ...], hypotheses: tuple[Hypothesis, ...] = ()) -> Fit:
    """A fit with derivatives (F, U, 6) by the coordinates ``free`` of eight, and errors (U, 6) that remain."""
    columns = Columns(moving, moving[:0])
    return Fit(hypotheses, np.zeros(8), np.zeros(0), error, columns, free, -float((error**2).sum()) / 2)


def at_its_best(rng: np.random.Generator, count: int, bins: int) -> Fit:
    """A fit with so many random columns, at its optimum."""
    columns, error = rng.normal(size=(count, bins, 6)), rng.normal(size=(bins, 6))
    return small_fit(columns, residual(columns, error), tuple(range(count)))


def dense(columns: Columns) -> Array:
    """(K, U, 6): a series alone in one channel after the other."""
    alone = columns.series[:, None] * np.eye(6)[None, :, None]
    return np.concatenate([columns.moving, alone.reshape(-1, *columns.series.shape[1:])])


def shift(columns: Array, error: Array) -> Array:
    """(M,) numbers that bring error + sum of numbers times columns (M, ...) nearest to zero."""
    return np.linalg.lstsq(columns.reshape(len(columns), error.size).T, -error.ravel(), rcond=None)[0]


def residual(columns: Array, error: Array) -> Array:
    """What least squares leaves of an error."""
    return error + np.tensordot(shift(columns, error), columns, 1)
