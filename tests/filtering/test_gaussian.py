"""One Kalman step where digits are scarce, and its derivatives; test_bias_filter.py compares it with the textbook."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.filtering import gaussian
from ftbias_jax.types import Gaussian

update = jax.jit(gaussian.update)

STATES, MEASURED = 5, 3


def random_covariance(rng, size):
    root = rng.normal(size=(size, size))
    return root @ root.T + 0.1 * np.eye(size)


def random_problem(seed):
    """A state, a measurement y, its observation matrix C and its noise R."""
    rng = np.random.default_rng(seed)
    state = Gaussian(rng.normal(size=STATES), random_covariance(rng, STATES))
    return state, rng.normal(size=MEASURED), rng.normal(size=(MEASURED, STATES)), random_covariance(rng, MEASURED)


@pytest.mark.parametrize("missing", [[], [1], [0, 1, 2]])
def test_gradients_do_not_see_the_missing_entries(missing):
    state, y, C, R = random_problem(1)
    y[missing] = np.nan

    def score(state, C, R):
        corrected, innovation = gaussian.update(state, jnp.asarray(y), C, R)
        return innovation.log_likelihood + corrected.mean.sum() + corrected.covariance.sum()

    slopes = jax.jit(jax.grad(score, argnums=(0, 1, 2)))(state, C, R)
    assert all(jnp.isfinite(slope).all() for slope in jax.tree.leaves(slopes))
    assert not slopes[1][jnp.array(missing, int)].any()


def test_erratum_04_a_sharp_measurement_of_a_vague_state_in_float32():
    """(I - K C) P rounds the variance to zero at the first encoder reading; the Joseph form does not."""
    P0, C, R = np.diag([1.0, 1.0, 100.0]), np.eye(1, 3), np.diag([1e-10])
    narrow = [np.asarray(x, np.float32) for x in (P0, C, R)]
    K = narrow[0] @ narrow[1].T / (narrow[1] @ narrow[0] @ narrow[1].T + narrow[2])
    assert ((np.eye(3, dtype=np.float32) - K @ narrow[1]) @ narrow[0])[0, 0] == 0
    zero = np.zeros(3, np.float32)
    corrected, _ = update(Gaussian(zero, narrow[0]), zero[:1], *narrow[1:])
    assert corrected.covariance.dtype == np.float32
    expected = np.linalg.inv(np.linalg.inv(P0) + C.T @ np.linalg.inv(R) @ C)  # information matrices add up
    np.testing.assert_allclose(corrected.covariance, expected, 1e-6)
