"""The samples of many logs, as lanes of one loop, are each sample of each log."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.runtime.side_by_side import samples_as_lanes

RNG = np.random.default_rng(0)


def pairs(shared, series):
    """(pieces, 2, lanes) -> (pieces, 1, lanes)."""
    x, y = series
    return {"sum": shared * (x[:, :1] * y[:, 1:] + x[:, 1:])}


@pytest.mark.parametrize("mapped", [False, True])
@pytest.mark.parametrize("length", [1, 7, 20])
def test_samples_as_lanes_of_any_log(length, mapped):
    """Lengths that do not fill a piece; what is shared by the samples of a log, or by all logs."""
    x, y = RNG.normal(size=(2, 3, length, 2))
    shared = RNG.normal(size=3) if mapped else RNG.normal()
    of_logs = jax.vmap(samples_as_lanes(pairs, 8), (0 if mapped else None, 0))
    found = of_logs(jnp.asarray(shared), (jnp.asarray(x), jnp.asarray(y)))["sum"]
    factor = np.broadcast_to(shared, 3)[:, None, None]
    np.testing.assert_allclose(found, factor * (x[:, :, :1] * y[:, :, 1:] + x[:, :, 1:]), rtol=1e-13)
