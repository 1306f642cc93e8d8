"""Products of structured columns against the dense columns that they represent."""

import numpy as np
import pytest
from small_fits import dense, residual, shift

from ftbias_jax.diagnosis.regression.design_matrix import (
    RIDGE,
    Columns,
    change,
    information,
    products,
    scores,
    step_and_gain,
)
from ftbias_jax.diagnosis.thresholds import PRIOR_STD

BINS = 50


@pytest.fixture(params=[(0, 0), (2, 0), (0, 2), (3, 2)], ids=str)
def columns(request):
    rng = np.random.default_rng(sum(request.param))
    return Columns(*(rng.normal(size=(count, BINS, 6)) for count in request.param))


@pytest.fixture
def error():
    return np.random.default_rng(9).normal(size=(BINS, 6))


def test_products_are_those_of_the_dense_columns(columns, error):
    flat = dense(columns).reshape(columns.size, BINS * 6)
    np.testing.assert_allclose(products(columns, error[None]), error.ravel()[None] @ flat.T, atol=1e-12)
    numbers = np.arange(1.0, columns.size + 1)
    np.testing.assert_allclose(change(columns, numbers).ravel(), numbers @ flat, atol=1e-12)


def test_information_is_that_of_the_dense_columns(columns):
    flat = dense(columns).reshape(columns.size, BINS * 6)
    found = information(columns)
    added = found.matrix() - flat @ flat.T
    np.testing.assert_allclose(added, np.diag(np.diag(added)), atol=1e-11)
    assert (np.diag(added) < 0.01).all()
    right = np.random.default_rng(2).normal(size=(columns.size, 3))
    np.testing.assert_allclose(found.matrix() @ found.solve(right), right, atol=1e-10)


def test_the_prior_is_of_the_coordinates_alone():
    columns = Columns(np.zeros((2, BINS, 6)), np.ones((1, BINS, 6)))
    ridge = RIDGE * 6 * BINS / 8
    np.testing.assert_allclose(np.diag(information(columns).matrix()), [PRIOR_STD**-2 + ridge] * 2 + [BINS + ridge] * 6)
    np.testing.assert_allclose(np.diag(information(columns, np.array([2.0])).matrix())[:2], [0.25 + ridge, ridge])


def test_the_best_step_is_least_squares(columns, error):
    expected, (step, gain) = shift(dense(columns), error), step_and_gain(columns, error)
    np.testing.assert_allclose(step, expected, rtol=1e-4, atol=1e-6)  # the prior has little weight
    left = residual(dense(columns), error)
    assert gain == pytest.approx(((error**2).sum() - (left**2).sum()) / 2, rel=1e-4)


def test_scores_are_sums_over_blocks(columns, error):
    block = np.random.default_rng(1).permutation(np.repeat([0, 1, 2], [10, 25, 15]))
    rows = dense(columns) * error
    expected = [rows[:, block == number].sum((1, 2)) for number in range(3)]
    np.testing.assert_allclose(scores(columns, error, block), np.reshape(expected, (3, columns.size)), atol=1e-12)
