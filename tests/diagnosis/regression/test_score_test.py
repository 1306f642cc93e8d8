"""Gains against plain least squares on the same whitened columns."""

import numpy as np
import pytest
from small_fits import at_its_best, dense, residual, shift

from ftbias_jax.diagnosis.regression.design_matrix import Columns
from ftbias_jax.diagnosis.regression.score_test import gain_of_each, gain_of_series, gains, stand

BINS = 50


@pytest.mark.parametrize("own", [0, 3])
@pytest.mark.parametrize("seed", range(5))
def test_gain_of_columns_is_that_of_least_squares(own, seed):
    rng = np.random.default_rng(seed)
    accepted, further = at_its_best(rng, own, BINS), rng.normal(size=(4, BINS, 6))
    together = residual(np.concatenate([accepted.columns.moving, further]), accepted.error)
    expected = ((accepted.error**2).sum() - (together**2).sum()) / 2
    assert gains(stand(accepted), further).of([0, 1, 2, 3]) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("own", [0, 3])
def test_gain_of_each_is_the_gain_of_one(own):
    rng = np.random.default_rng(own)
    accepted, further = at_its_best(rng, own, BINS), rng.normal(size=(4, BINS, 6))
    each, coefficient = gain_of_each(stand(accepted), further)
    prepared = gains(stand(accepted), further)
    np.testing.assert_allclose(each, [prepared.of([i]) for i in range(4)], rtol=1e-6)
    # Minus the coefficient of the column itself, the others being solved for again.
    solved = shift(np.concatenate([accepted.columns.moving, further[:1]]), accepted.error)
    assert coefficient[0] == pytest.approx(solved[-1], rel=1e-6)


def test_gain_of_series_is_that_of_least_squares():
    rng = np.random.default_rng(2)
    accepted, series = at_its_best(rng, 2, BINS), rng.normal(size=(2, BINS, 6))
    left = residual(dense(Columns(accepted.columns.moving, series)), accepted.error)
    expected = ((accepted.error**2).sum() - (left**2).sum()) / 2
    assert gain_of_series(accepted, series) == pytest.approx(expected, rel=1e-4)
