"""Gradient ascent over any positive leaves, and the variances of Sigma_D that a log can and cannot determine."""

import jax.numpy as jnp
import numpy as np

from ftbias_jax.calibration import ascent
from ftbias_jax.model.wrench.tool_wrench import LIVE_ENTRIES, measurement_covariance


def test_the_variance_of_white_noise():
    """Known maximum, known information: T / 2 per logarithm of a variance."""
    data = np.random.default_rng(0).normal(size=(500, 2)) * [2.0, 0.1]

    def score(leaves):
        variance = leaves["variance"][None]
        return -(jnp.asarray(data) ** 2 / variance + jnp.log(variance)).sum() / 2

    found = ascent.maximise(score, {"variance": jnp.array([0.01, 10.0])})
    np.testing.assert_allclose(found.values["variance"], (data**2).mean(0), rtol=1e-4)
    np.testing.assert_allclose(found.relative_stderr, np.sqrt(2 / 500), rtol=1e-3)
    assert found.determined == 2
    assert found.value > found.start_value


def test_sigma_d_is_determined_in_six_combinations():
    """36 variances reach a constant R through six sums (errata 11): the information has rank six, and says so."""
    theta = jnp.array([0.9, 0.01, -0.02, 0.05, 3e-3, 1e-4, -2e-4, 4e-3, 1e-4, 2e-3])
    truth = measurement_covariance(theta, jnp.full(36, 0.01), jnp.full(6, 1e-8))
    noise = np.random.default_rng(1).normal(size=(2000, 6)) * np.sqrt(np.diagonal(truth))
    square = jnp.asarray((noise**2).mean(0))

    def score(leaves):
        R = jnp.diagonal(measurement_covariance(theta, leaves["data_variance"], jnp.full(6, 1e-8)))
        return -2000 * (square / R + jnp.log(R)).sum() / 2

    found = ascent.maximise(score, {"data_variance": jnp.full(36, 1.0)})
    assert len(LIVE_ENTRIES) == 36
    assert found.determined == 6
    assert np.isinf(found.relative_stderr).sum() > 24
    fitted = jnp.diagonal(measurement_covariance(theta, found.values["data_variance"], jnp.full(6, 1e-8)))
    np.testing.assert_allclose(fitted, square, rtol=1e-3)
