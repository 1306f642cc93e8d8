"""Random walk of the bias: the density is recovered, and none is found for an error that returns with the motion."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made_series import wandering

from ftbias_jax.filtering.noise.block_filter import Means
from ftbias_jax.filtering.noise.wander import LEAST_WENT, departures, fit_wander

STEP, COUNT = 0.1, 600
T = STEP * np.arange(COUNT)
STATED, PRIOR = np.array([2e-3] * 3 + [1e-4] * 3), np.array([[5.0] * 3 + [0.5] * 3, [0.02] * 3 + [1e-3] * 3])
STD = np.array([0.05] * 3 + [0.002] * 3)


def means(y, rng, dtype=float, missing=()):
    """Blocks of y with added white noise."""
    y = y + STD * rng.normal(size=y.shape)
    y[:, list(missing)] = np.nan
    variance = np.where(np.isfinite(y), STD**2, np.nan)
    return Means(*(jnp.asarray(x, dtype) for x in (STEP, T, y, variance)))


def fitted(blocks):
    dtype = blocks.y.dtype
    return jax.tree.map(np.asarray, fit_wander(blocks, jnp.asarray(STATED, dtype), jnp.asarray(PRIOR, dtype)))


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
@pytest.mark.parametrize("more", [12.0, 150.0])
def test_the_density_is_found(more, dtype):
    rng = np.random.default_rng(round(more))
    found = fitted(means(wandering(rng, T, more * STATED), rng, dtype))
    assert found.wanders.all()
    np.testing.assert_allclose(np.log(found.density / (more * STATED)), 0, atol=0.5)


def test_a_bias_as_stated_and_an_axis_without_readings_do_not_wander():
    rng = np.random.default_rng(3)
    found = fitted(means(wandering(rng, T, STATED), rng, missing=[2]))
    assert not found.wanders.any()
    assert np.isfinite(found.density).all()


@pytest.mark.parametrize("hertz", [0.1, 0.4])
@pytest.mark.parametrize("size", [3.0, 100.0])
def test_what_comes_back_with_the_motion_does_not_wander(hertz, size):
    rng = np.random.default_rng(4)
    error = size * STD * np.sin(2 * np.pi * hertz * T[:, None] + np.arange(6))
    found = fitted(means(error, rng))
    assert (found.gain > 12).all()
    assert not found.wanders.any()


def test_departures_are_from_the_own_line_of_each_axis():
    rng = np.random.default_rng(5)
    went = []
    for _ in range(200):
        y = wandering(rng, T, np.ones(6)) + 7 - 3 * T[:, None]
        seen, expected = departures(T, y, np.zeros_like(y))
        lines = np.stack([np.polyval(np.polyfit(T, x, 1), T) for x in y.T], 1)
        np.testing.assert_allclose(seen, ((y - lines) ** 2).mean(0), rtol=1e-6)
        went.append(seen / expected)
    assert np.mean(went) == pytest.approx(1, abs=0.15)
    assert np.mean(np.array(went) < LEAST_WENT) < 0.01
