"""One Kalman step against the information form and the multivariate normal density, in plain NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ftbias_jax.filtering import gaussian
from ftbias_jax.types import Gaussian

predict = jax.jit(gaussian.predict)
update = jax.jit(gaussian.update)

seeds = st.integers(0, 2**32 - 1)
STATES, MEASURED = 5, 3


def random_covariance(rng, size):
    root = rng.normal(size=(size, size))
    return root @ root.T + 0.1 * np.eye(size)


def random_problem(seed):
    """A state, a measurement y, its observation matrix C and its noise R."""
    rng = np.random.default_rng(seed)
    state = Gaussian(rng.normal(size=STATES), random_covariance(rng, STATES))
    return state, rng.normal(size=MEASURED), rng.normal(size=(MEASURED, STATES)), random_covariance(rng, MEASURED)


def information_update(state, y, C, R):
    """Bayes' rule for normal distributions: informations add."""
    prior, noise = np.linalg.inv(state.covariance), np.linalg.inv(R)
    covariance = np.linalg.inv(prior + C.T @ noise @ C)
    return covariance @ (prior @ state.mean + C.T @ noise @ y), covariance


def log_density(x, mean, covariance):
    residual = x - mean
    _, log_determinant = np.linalg.slogdet(2 * np.pi * covariance)
    return -(residual @ np.linalg.solve(covariance, residual) + log_determinant) / 2


@given(seed=seeds)
def test_predict_is_the_textbook_formula(seed):
    state, *_ = random_problem(seed)
    rng = np.random.default_rng(seed)
    A, Q = rng.normal(size=(STATES, STATES)), random_covariance(rng, STATES)
    predicted = predict(state, A, Q)
    np.testing.assert_allclose(predicted.mean, A @ state.mean, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(predicted.covariance, A @ state.covariance @ A.T + Q, rtol=1e-11, atol=1e-12)
    np.testing.assert_array_equal(predicted.covariance, predicted.covariance.T)


@given(seed=seeds, missing=st.sets(st.integers(0, MEASURED - 1)))
def test_update_is_bayes_rule_on_the_measured_entries(seed, missing):
    """Missing entries are NaN in the measurement, and removed rows in the reference."""
    state, y, C, R = random_problem(seed)
    kept = [i for i in range(MEASURED) if i not in missing]
    y[list(missing)] = np.nan
    corrected, innovation = update(state, y, C, R)
    mean, covariance = information_update(state, y[kept], C[kept], R[np.ix_(kept, kept)])
    np.testing.assert_allclose(corrected.mean, mean, rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(corrected.covariance, covariance, rtol=1e-9, atol=1e-10)
    np.testing.assert_array_equal(corrected.covariance, corrected.covariance.T)

    S = C @ state.covariance @ C.T + R
    residual, S_kept = (y - C @ state.mean)[kept], S[np.ix_(kept, kept)]
    expected = log_density(y[kept], (C @ state.mean)[kept], S_kept)
    np.testing.assert_allclose(innovation.log_likelihood, expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(innovation.nis, residual @ np.linalg.solve(S_kept, residual), rtol=1e-9)
    np.testing.assert_allclose(innovation.covariance, S, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(innovation.value, y - C @ state.mean, rtol=1e-12, atol=1e-14)
    assert innovation.count == len(kept)


def test_nothing_measured_changes_nothing():
    state, y, C, R = random_problem(0)
    corrected, innovation = update(state, np.full_like(y, np.nan), C, R)
    np.testing.assert_array_equal(corrected.mean, state.mean)
    np.testing.assert_allclose(corrected.covariance, state.covariance, rtol=1e-15)
    assert innovation.log_likelihood == 0
    assert innovation.nis == 0
    assert np.isnan(innovation.value).all()


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
    """(I - K C) P rounds the variance to zero at the first encoder reading; the Joseph form keeps it."""
    P0, C, R = np.diag([1.0, 1.0, 100.0]), np.eye(1, 3), np.diag([1e-10])
    narrow = [np.asarray(x, np.float32) for x in (P0, C, R)]
    K = narrow[0] @ narrow[1].T / (narrow[1] @ narrow[0] @ narrow[1].T + narrow[2])
    assert ((np.eye(3, dtype=np.float32) - K @ narrow[1]) @ narrow[0])[0, 0] == 0
    zero = np.zeros(3, np.float32)
    corrected, _ = update(Gaussian(zero, narrow[0]), zero[:1], *narrow[1:])
    assert corrected.covariance.dtype == np.float32
    np.testing.assert_allclose(corrected.covariance, information_update(Gaussian(zero, P0), zero[:1], C, R)[1], 1e-6)
