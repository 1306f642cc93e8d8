"""Whitening by matrix products gives what the bias filter gives bin by bin."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.diagnosis.regression.whitening import make_whitener
from ftbias_jax.filtering.likelihood import WrenchProblem, whiten

USED, PADDED = 150, 160


@pytest.fixture(scope="module")
def problem():
    """Uneven bins that end within an interval; some bins lack all channels, and one channel is missing for a while."""
    rng = np.random.default_rng(0)
    dt = rng.uniform(0.005, 0.02, PADDED)
    wrench = rng.normal(size=(PADDED, 6))
    wrench[[5, 6]] = np.nan
    wrench[20:60, 2] = np.nan
    wrench[USED:] = np.nan
    prior_std = np.r_[np.full(6, 20.0), np.full(6, 0.05)]
    return WrenchProblem(dt, wrench, rng.uniform(0.5, 2, (PADDED, 6)), np.full(6, 0.003), prior_std)


@pytest.fixture(scope="module")
def series():
    return np.random.default_rng(1).normal(size=(3, USED, 6))


@pytest.mark.parametrize("zeroed", [False, True], ids=["", "with a sensor that is set to zero on the way"])
def test_whitening_is_that_of_the_bias_filter(problem, series, zeroed):
    """In single precision the agreement is close; unmeasured values have no weight."""
    if zeroed:
        jump = np.zeros((PADDED, 6))
        jump[[40, 41, 97]] = 30.0
        problem = problem._replace(jump=jump)
    with jax.enable_x64(True):
        padded = np.pad(series, ((0, 0), (0, PADDED - USED), (0, 0)))
        expected = np.asarray(whiten(jax.tree.map(jnp.asarray, problem), jnp.asarray(padded)))[:, :USED]
    whitener = make_whitener(problem, USED)
    white, single = whitener(series), whitener.single()(series.astype(np.float32))
    np.testing.assert_allclose(white, expected, rtol=1e-9, atol=1e-11)
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, expected, atol=2e-5 * np.abs(expected).max())
    assert (white[:, [5, 6]] == 0).all()
    assert (white[:, 20:60, 2] == 0).all()
    assert (white[:, 20:60, 1] != 0).all()


def test_a_series_of_all_channels_is_the_same_in_each_also_one_that_begins_late(problem, series):
    alike = np.repeat(series[:, :, :1], 6, 2)
    np.testing.assert_array_equal(make_whitener(problem, USED)(series[:, :, :1]), make_whitener(problem, USED)(alike))
    late = series[:, :, :1].copy()
    late[:, :100] = 0
    whitener = make_whitener(problem, USED)
    white = whitener(late)
    np.testing.assert_allclose(white, whitener(np.repeat(late, 6, 2)), rtol=1e-12, atol=1e-13)
    assert (white[:, :100] == 0).all()
    assert white[:, 100:].any()
