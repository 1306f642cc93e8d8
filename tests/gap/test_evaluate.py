"""Evaluation in pieces: as if it were done at once."""

import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.gap.evaluate import in_pieces


@pytest.mark.parametrize("count", [1, 3, 4, 5, 11])
def test_pieces_are_put_together_in_order(count):
    rng = np.random.default_rng(count)
    x, y = rng.normal(size=(count, 7, 2)), rng.normal(size=count)
    sizes = []

    def function(x, y):
        sizes.append(len(x))
        return jnp.asarray(x) * jnp.asarray(y)[:, None, None]

    np.testing.assert_array_equal(in_pieces(function, 4, x, y), x * y[:, None, None])
    assert set(sizes) == {4}  # one shape, one compiled program
