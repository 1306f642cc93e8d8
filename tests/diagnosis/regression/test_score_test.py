"""Gains against plain least squares on the same whitened columns."""

import numpy as np
import pytest
from small_fits import at_its_best, residual, shift

from ftbias_jax.diagnosis.hypothesis import PENALTY_PER_PARAMETER
from ftbias_jax.diagnosis.regression.score_test import Gains, gain_of_each, gains, prepare_fit

BINS = 50


@pytest.mark.parametrize("own", [0, 3])
@pytest.mark.parametrize("seed", range(5))
def test_gain_of_columns_is_that_of_least_squares(own, seed):
    rng = np.random.default_rng(seed)
    accepted, further = at_its_best(rng, own, BINS), rng.normal(size=(4, BINS, 6))
    together = residual(np.concatenate([accepted.columns.moving, further]), accepted.error)
    expected = ((accepted.error**2).sum() - (together**2).sum()) / 2
    assert gains(prepare_fit(accepted), further).of([0, 1, 2, 3]) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("own", [0, 3])
def test_gain_of_each_is_the_gain_of_one(own):
    rng = np.random.default_rng(own)
    accepted, further = at_its_best(rng, own, BINS), rng.normal(size=(4, BINS, 6))
    each, coefficient = gain_of_each(prepare_fit(accepted), further)
    prepared = gains(prepare_fit(accepted), further)
    np.testing.assert_allclose(each, [prepared.of([i]) for i in range(4)], rtol=1e-6)
    # Minus the coefficient of the column itself, with the others solved for again.
    solved = shift(np.concatenate([accepted.columns.moving, further[:1]]), accepted.error)
    assert coefficient[0] == pytest.approx(solved[-1], rel=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_pursuit_adds_the_column_that_gains_most(seed):
    """The gain is as if all coefficients were solved for again with each column that might be added."""
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(200, 12))
    X[:, 1] = X[:, 0] + 0.1 * rng.normal(size=200)
    error = X[:, [0, 4, 9]] @ [2.0, -1.0, 0.7] + rng.normal(size=200)
    prepared, rows = Gains(X.T @ X, X.T @ error, np.zeros((0, 12))), [0, 1, 3, 4, 6, 7, 9, 11]
    expected, gained = [], 0.0
    while True:
        trials = {i: prepared.of([*expected, i]) for i in rows if i not in expected}
        best = max(trials, key=trials.get)
        if trials[best] - gained < max(2 * PENALTY_PER_PARAMETER, 0.01 * trials[best]):
            break
        expected, gained = [*expected, best], trials[best]
    found, chosen = prepared.pursue(rows, 12, 0.01)
    assert chosen == expected
    assert found == pytest.approx(gained)
    assert expected
