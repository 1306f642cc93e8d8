"""Each of several logs by itself, against least squares on its own bins."""

import numpy as np
import pytest
from small_fits import residual, shift, small_fit

from ftbias_jax.diagnosis.gap import alone_in


@pytest.mark.parametrize("seed", range(3))
def test_a_logalone_in_is_least_squares_on_its_bins(seed):
    rng = np.random.default_rng(seed)
    columns, error = 30 * rng.normal(size=(2, 60, 6)), rng.normal(size=(60, 6))
    own = np.arange(60) < 25
    alone, gain = alone_in(small_fit(columns, error, (3, 1)), own)
    np.testing.assert_allclose(alone.z[[3, 1]], shift(columns[:, own], error[own]), rtol=1e-4)
    left = residual(columns[:, own], error[own])
    assert gain == pytest.approx(((error[own] ** 2).sum() - (left**2).sum()) / 2, rel=1e-4)
    np.testing.assert_array_equal(alone.columns.moving[:, ~own], 0)  # its standard errors are those of this log
