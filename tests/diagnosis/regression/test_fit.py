"""Fits against plain least squares on the same whitened columns, on made-up problems without a model."""

import numpy as np
from small_fits import at_its_best, dense, residual

from ftbias_jax.diagnosis.hypothesis import Hypothesis
from ftbias_jax.diagnosis.regression.design_matrix import Columns
from ftbias_jax.diagnosis.regression.fit import first_order, projection

BINS = 50


def test_series_are_projected_out():
    rng = np.random.default_rng(0)
    series, errors = rng.normal(size=(5, BINS, 6)), rng.normal(size=(3, BINS, 6))
    coefficients, left = projection(series)(errors)
    alone = dense(Columns(series[:0], series))
    np.testing.assert_allclose(left, [residual(alone, error) for error in errors], atol=1e-7)
    np.testing.assert_allclose(left, errors + np.tensordot(coefficients, alone, 1))
    nothing, untouched = projection(series[:0])(errors)
    assert nothing.shape == (3, 0)
    np.testing.assert_array_equal(untouched, errors)


def test_to_first_order_a_linear_effect_is_fitted_exactly():
    """Up to the prior of 30 typical departures, which columns of unit size hardly feel."""
    rng = np.random.default_rng(1)
    accepted, further = at_its_best(rng, 2, BINS), rng.normal(size=(3, BINS, 6))
    found = first_order(accepted, Hypothesis("tool_com", (5, 6, 7), (0.0,) * 3), further)
    np.testing.assert_allclose(
        found.error, residual(np.concatenate([accepted.columns.moving, further]), accepted.error), atol=1e-4
    )
    assert found.free == (0, 1, 5, 6, 7)
    assert found.log_likelihood > accepted.log_likelihood
    np.testing.assert_array_equal(found.z[[2, 3, 4]], 0)
