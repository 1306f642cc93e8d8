"""Fits against plain least squares on the same whitened columns, on made-up problems without a model."""

import numpy as np
import pytest

from ftbias_jax.gap.columns import Columns
from ftbias_jax.gap.fit import Fit, first_order, gain_of_each, gain_of_series, gains, projection
from ftbias_jax.gap.hypotheses import Hypothesis

BINS = 50


def made_up(rng, own):
    """A fit with `own` columns, at its optimum."""
    columns = rng.normal(size=(own, BINS, 6))
    error = rng.normal(size=(BINS, 6))
    error = residual(columns, error)
    moving = Columns(columns, columns[:0])
    return Fit((), np.zeros(8), 0.0, np.zeros(0), error, moving, tuple(range(own)), -float((error**2).sum()) / 2)


def residual(columns, error):
    """What least squares leaves of an error."""
    if not len(columns):
        return error
    flat = columns.reshape(len(columns), -1).T
    return error - (flat @ np.linalg.lstsq(flat, error.ravel(), rcond=None)[0]).reshape(error.shape)


@pytest.mark.parametrize("own", [0, 3])
@pytest.mark.parametrize("seed", range(5))
def test_gain_of_columns_is_that_of_least_squares(own, seed):
    rng = np.random.default_rng(seed)
    accepted, further = made_up(rng, own), rng.normal(size=(4, BINS, 6))
    together = residual(np.concatenate([accepted.columns.moving, further]), accepted.error)
    expected = ((accepted.error**2).sum() - (together**2).sum()) / 2
    assert gains(accepted, further).of([0, 1, 2, 3]) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("own", [0, 3])
def test_gain_of_each_is_the_gain_of_one(own):
    rng = np.random.default_rng(own)
    accepted, further = made_up(rng, own), rng.normal(size=(4, BINS, 6))
    each, coefficient = gain_of_each(accepted, further)
    prepared = gains(accepted, further)
    np.testing.assert_allclose(each, [prepared.of([i]) for i in range(4)], rtol=1e-6)
    # Minus the coefficient of the column itself, the others being solved for again.
    flat = np.concatenate([accepted.columns.moving, further[:1]]).reshape(own + 1, -1).T
    solved = np.linalg.lstsq(flat, -accepted.error.ravel(), rcond=None)[0]
    assert coefficient[0] == pytest.approx(solved[-1], rel=1e-6)


def test_series_are_projected_out():
    rng = np.random.default_rng(0)
    series, errors = rng.normal(size=(5, BINS, 6)), rng.normal(size=(3, BINS, 6))
    coefficients, left = projection(series)(errors)
    dense = (series[:, None] * np.eye(6)[None, :, None]).reshape(30, BINS, 6)
    np.testing.assert_allclose(left, [residual(dense, error) for error in errors], atol=1e-7)
    np.testing.assert_allclose(left, errors + np.tensordot(coefficients, dense, 1))
    nothing, untouched = projection(series[:0])(errors)
    assert nothing.shape == (3, 0)
    assert untouched is errors


def test_gain_of_series_is_that_of_least_squares():
    rng = np.random.default_rng(2)
    accepted, series = made_up(rng, 2), rng.normal(size=(2, BINS, 6))
    dense = (series[:, None] * np.eye(6)[None, :, None]).reshape(12, BINS, 6)
    left = residual(np.concatenate([accepted.columns.moving, dense]), accepted.error)
    expected = ((accepted.error**2).sum() - (left**2).sum()) / 2
    assert gain_of_series(accepted, series) == pytest.approx(expected, rel=1e-4)


def test_to_first_order_a_linear_effect_is_fitted_exactly():
    """Up to the prior of 30 typical departures, which columns of unit size hardly feel."""
    rng = np.random.default_rng(1)
    accepted, further = made_up(rng, 2), rng.normal(size=(3, BINS, 6))
    found = first_order(accepted, Hypothesis("tool_com", (5, 6, 7), (0.0,) * 3), further)
    np.testing.assert_allclose(
        found.error, residual(np.concatenate([accepted.columns.moving, further]), accepted.error), atol=1e-4
    )
    assert found.free == (0, 1, 5, 6, 7)
    assert found.log_likelihood > accepted.log_likelihood
    np.testing.assert_array_equal(found.z[[2, 3, 4]], 0)
