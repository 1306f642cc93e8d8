"""The scatter at rest, for the diagnosis; contact as it finds it is tested with its finder."""

import numpy as np
import pytest

from ftbias_jax.filtering.method.look import scatter_at_rest
from ftbias_jax.io.log import Log

NOISE = np.repeat([0.1, 0.004], 3)
T = np.arange(4000) / 200


def scatter_of(error, stated=1.0):
    count = len(error)
    nothing = np.full((count, 6), np.nan)
    log = Log(T[:count], nothing, nothing, -error, nothing[:, 0])
    return scatter_at_rest(log, error, np.zeros((count, 6)), np.tile((stated * NOISE) ** 2, (count, 1)), stated * NOISE)


@pytest.mark.parametrize("stated", [0.5, 3.0])
def test_the_scatter_at_rest_is_that_within_blocks(stated):
    """A short log does not determine it."""
    error = NOISE * np.random.default_rng(0).normal(size=(4000, 6)) + 0.3 * np.sin(0.5 * T)[:, None]
    blocks = error.reshape(400, 10, 6)
    line = np.stack([np.ones(10), np.arange(10) - 4.5], 1)
    left = blocks - line @ (np.linalg.pinv(line) @ blocks)
    within = np.sqrt((left**2).sum((0, 1)) / (8 * 400))
    np.testing.assert_allclose(scatter_of(error, stated), within / (stated * NOISE), rtol=0.01)
    np.testing.assert_array_equal(scatter_of(error[:200], stated), np.ones(6))
