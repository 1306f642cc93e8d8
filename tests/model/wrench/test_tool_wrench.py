"""The parts of a tool's wrench and its covariance, against dense linear algebra; test_engines.py tests the physics."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ftbias_jax.filtering.pipeline import predict_wrench
from ftbias_jax.model.kinematics.screws import sensor_motion
from ftbias_jax.model.wrench import tool_wrench

data_matrix = jax.jit(tool_wrench.data_matrix)

seeds = st.integers(0, 2**32 - 1)


def test_erratum_05_vec_stacks_columns():
    rng = np.random.default_rng(0)
    X, Y, Z = rng.normal(size=(2, 3)), rng.normal(size=(3, 4)), rng.normal(size=(4, 5))
    np.testing.assert_allclose(
        tool_wrench.vec(jnp.asarray(X @ Y @ Z)), np.kron(Z.T, X) @ tool_wrench.vec(jnp.asarray(Y))
    )


def test_36_entries_of_the_data_matrix_are_live():
    motions = np.random.default_rng(0).normal(size=(5, 3, 3))
    live = np.any([tool_wrench.vec(data_matrix(*motion)) != 0 for motion in motions], axis=0)
    np.testing.assert_array_equal(np.flatnonzero(live), tool_wrench.LIVE_ENTRIES)
    assert len(tool_wrench.LIVE_ENTRIES) == 36


def test_reduced_observation_equals_the_full_one():
    rng = np.random.default_rng(1)
    theta, D = jnp.asarray(rng.normal(size=10)), data_matrix(*rng.normal(size=(3, 3)))
    reduced = tool_wrench.reduced_observation_matrix(theta)
    assert reduced.shape == (6, 36)
    np.testing.assert_allclose(reduced @ tool_wrench.vec(D)[tool_wrench.LIVE_ENTRIES], D @ theta, rtol=1e-12)


def test_erratum_06_the_noise_of_the_data_is_counted_once():
    """R is the variance of (D + n_D) theta - (W + n_W): each live entry's noise enters once, times its own theta."""
    rng = np.random.default_rng(2)
    theta, data_variance, wrench_variance = rng.normal(size=10), rng.uniform(size=36), rng.uniform(size=6)
    expected = np.diag(wrench_variance)
    for entry, variance in zip(tool_wrench.LIVE_ENTRIES, data_variance, strict=True):
        column, row = divmod(entry, 6)
        expected[row, row] += theta[column] ** 2 * variance
    R = tool_wrench.measurement_covariance(*map(jnp.asarray, (theta, data_variance, wrench_variance)))
    np.testing.assert_allclose(R, expected, rtol=1e-13, atol=1e-15)
    without = tool_wrench.measurement_covariance(jnp.asarray(theta), None, jnp.asarray(wrench_variance))
    np.testing.assert_allclose(without, np.diag(wrench_variance))


def test_erratum_11_six_combinations_of_the_noise_parameters_are_determined(params):
    """42 variances enter R through a map of rank 6, so Sigma_D and Sigma_W cannot be distinguished."""
    slopes = jax.jacobian(tool_wrench.measurement_covariance, argnums=(1, 2))(
        params.theta, params.bias.data_variance, params.bias.wrench_variance
    )
    flat = np.concatenate([slope.reshape(36, -1) for slope in slopes], 1)
    assert flat.shape == (36, 42)
    assert np.linalg.matrix_rank(flat) == 6


def test_erratum_09_unbiased_is_the_reading_plus_the_bias():
    reading, bias, drift = np.random.default_rng(3).normal(size=(3, 6))
    state = jnp.asarray(np.r_[bias, drift])
    np.testing.assert_allclose(tool_wrench.unbias(reading, state, 0.0), reading + bias)
    np.testing.assert_allclose(tool_wrench.unbias(reading, state, 2.0), reading + bias + 2 * drift)


@jax.jit
def sensitivity_and_slopes(params, q, dq, ddq):
    """joint_sensitivity, and the Jacobians of D theta with respect to q and ddq that it approximates."""
    slopes = jax.jacfwd(lambda q, ddq: predict_wrench(params, jnp.stack([q, dq, ddq], 1))[1], argnums=(0, 1))(q, ddq)
    motion = sensor_motion(params.arm, q, dq, ddq)
    return tool_wrench.joint_sensitivity(params.theta, motion.R_base_sensor, motion.jacobian, params.gravity), slopes


@given(seed=seeds)
def test_sensitivity_to_joint_accelerations_is_exact(params, seed):
    (_, by_ddq), (_, expected) = sensitivity_and_slopes(params, *np.random.default_rng(seed).normal(size=(3, 3)))
    np.testing.assert_allclose(by_ddq, expected, rtol=1e-10, atol=1e-12)


@given(seed=seeds)
def test_sensitivity_to_joint_positions_is_exact_at_rest(params, seed):
    q = np.random.default_rng(seed).uniform(-3, 3, 3)
    (by_q, _), (expected, _) = sensitivity_and_slopes(params, q, np.zeros(3), np.zeros(3))
    np.testing.assert_allclose(by_q, expected, rtol=1e-10, atol=1e-11)
