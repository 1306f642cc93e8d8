"""Each of several logs by itself, against least squares on its own bins."""

import numpy as np
import pytest

from ftbias_jax.gap.columns import Columns
from ftbias_jax.gap.compare import _alone
from ftbias_jax.gap.fit import Fit


@pytest.mark.parametrize("seed", range(3))
def test_a_log_alone_is_least_squares_on_its_bins(seed):
    rng = np.random.default_rng(seed)
    columns, error = 30 * rng.normal(size=(2, 60, 6)), rng.normal(size=(60, 6))
    moving = Columns(columns, columns[:0])
    own = np.arange(60) < 25
    together = Fit((), np.zeros(4), 0.0, np.zeros(0), error, moving, (3, 1), 0.0)
    alone, gain = _alone(together, own)
    flat = columns[:, own].reshape(2, -1)
    shift = np.linalg.lstsq(flat.T, -error[own].ravel(), rcond=None)[0]
    assert alone.z[3] == pytest.approx(shift[0], rel=1e-4)
    assert alone.z[1] == pytest.approx(shift[1], rel=1e-4)
    left = error[own].ravel() + shift @ flat
    assert gain == pytest.approx(((error[own] ** 2).sum() - left @ left) / 2, rel=1e-4)
    np.testing.assert_array_equal(alone.columns.moving[:, ~own], 0)  # its standard errors are those of this log
