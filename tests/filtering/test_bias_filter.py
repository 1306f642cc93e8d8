"""The bias filter against a textbook filter, against one joint normal distribution, and over a million samples."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ftbias_jax.filtering import bias_filter
from ftbias_jax.filtering.process_models import bias_drift_noise
from ftbias_jax.model.params import BiasNoise
from ftbias_jax.model.wrench.tool_wrench import unbias

COUNT = 30


@partial(jax.jit, static_argnames="gate")
def run(noise, dt, wrench_tool, wrench, covariance, gate=None):
    """States and innovations of a whole log; covariance (T, 6, 6)."""

    def body(state, sample):
        state, innovation = bias_filter.step(noise, state, *sample, gate)
        return state, (state, innovation)

    return jax.lax.scan(body, bias_filter.init(noise), (dt, wrench_tool, wrench, covariance))[1]


def random_log(seed):
    """Irregular stamps, wrenches with missing axes and missing samples, and a correlated R that varies."""
    rng = np.random.default_rng(seed)
    dt = np.r_[0.0, rng.uniform(0.01, 2.0, COUNT - 1)]
    wrench_tool, wrench = rng.normal(size=(2, COUNT, 6))
    wrench[rng.uniform(size=wrench.shape) < 0.2] = np.nan
    wrench[rng.uniform(size=COUNT) < 0.1] = np.nan
    root = rng.normal(size=(COUNT, 6, 6))
    return dt, wrench_tool, wrench, 0.1 * np.eye(6) + 0.1 * root @ root.swapaxes(1, 2)


def reference(linear_gaussian, noise, dt, covariance):
    pairs = [bias_drift_noise(jnp.asarray(interval), noise.density) for interval in dt]
    A, Q = (np.stack(part) for part in zip(*pairs, strict=True))
    return linear_gaussian(A, Q, np.eye(6, 12), covariance, np.asarray(noise.prior_mean), np.diag(noise.prior_std**2))


@given(seed=st.integers(0, 2**32 - 1))
def test_erratum_13_the_likelihood_is_that_of_the_whole_log(linear_gaussian, params, seed):
    """The states are also those of the textbook filter."""
    dt, wrench_tool, wrench, covariance = random_log(seed)
    states, innovation = run(params.bias, dt, wrench_tool, wrench, covariance)
    model = reference(linear_gaussian, params.bias, dt, covariance)
    mean, expected = model.filtered(wrench_tool - wrench)
    np.testing.assert_allclose(states.mean, mean, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(states.covariance, expected, rtol=1e-9, atol=1e-10)
    density = model.log_density(wrench_tool - wrench)
    np.testing.assert_allclose(innovation.log_likelihood.sum(), density, rtol=1e-9)
    np.testing.assert_array_equal(innovation.count, np.isfinite(wrench).sum(1))
    for v, S, nis in zip(innovation.value, innovation.covariance, innovation.nis, strict=True):
        seen = np.isfinite(v)
        np.testing.assert_allclose(nis, v[seen] @ np.linalg.solve(S[np.ix_(seen, seen)], v[seen]), rtol=1e-9)


def test_erratum_09_the_bias_is_minus_the_offset_that_people_speak_of(params):
    """A sensor that reads 2 N too much in every axis has a bias of -2 N, and reading + bias is the tool's wrench."""
    offset = 2.0
    dt, wrench_tool, _, _ = random_log(2)
    R = np.tile(1e-6 * np.eye(6), (COUNT, 1, 1))
    steady = params.bias._replace(density=jnp.zeros(6), prior_mean=jnp.zeros(12), prior_std=jnp.ones(12))
    states, _ = run(steady, dt, wrench_tool, wrench_tool + offset, R)
    np.testing.assert_allclose(states.mean[-1, :6], -offset, atol=1e-3)
    np.testing.assert_allclose(unbias(wrench_tool[-1] + offset, states.mean[-1], 0.0), wrench_tool[-1], atol=1e-3)


@given(seed=st.integers(0, 2**32 - 1))
def test_the_gate_is_its_formulas_in_a_loop(params, seed):
    dt, wrench_tool, wrench, R = random_log(seed)
    wrench[::5] += 10
    gate = 3.0
    states, innovations = run(params.bias, dt, wrench_tool, wrench, R, gate)
    x, P = np.array(params.bias.prior_mean), np.diag(np.array(params.bias.prior_std) ** 2)
    closed = []
    for i in range(COUNT):
        A, Q = (np.array(part) for part in bias_drift_noise(jnp.asarray(dt[i]), params.bias.density))
        x, P = A @ x, A @ P @ A.T + Q
        y = wrench_tool[i] - wrench[i]
        far = [abs(y[k] - x[k]) > gate * np.sqrt(P[k, k] + R[i, k, k]) for k in range(6)]  # not if y is NaN
        closed.append(any(far))
        if any(far):
            for k in range(6):
                P[k, k] *= np.exp(2 * dt[i] / bias_filter.FORGET)
        else:
            seen = np.isfinite(y)
            C = np.eye(6, 12)[seen]
            K = P @ C.T @ np.linalg.inv(C @ P @ C.T + R[i][np.ix_(seen, seen)])
            x, P = x + K @ (y[seen] - x[:6][seen]), (np.eye(12) - K @ C) @ P
        np.testing.assert_allclose(states.mean[i], x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(states.covariance[i], P, rtol=1e-9, atol=1e-10)
    assert any(closed)
    assert np.isnan(np.asarray(innovations.value)[closed]).all()
    assert (np.asarray(innovations.log_likelihood)[closed] == 0).all()


@partial(jax.jit, static_argnames="count")
def covariances_at_1_khz(noise, count):
    """The last state, and whether its covariance was symmetric positive definite at all samples."""
    zero = jnp.zeros_like(noise.wrench_variance)
    R, interval = jnp.diag(noise.wrench_variance), jnp.asarray(1e-3, zero.dtype)

    def body(state, _):
        state, _ = bias_filter.step(noise, state, interval, zero, zero, R)
        P = state.covariance
        positive = jnp.isfinite(jnp.linalg.cholesky(P)).all()
        return state, positive & (jnp.swapaxes(P, 0, 1) == P).all() & jnp.isfinite(state.mean).all()

    last, healthy = jax.lax.scan(body, bias_filter.init(noise), None, length=count)
    return last, healthy.all()


def setup_defaults(dtype):
    """The default prior and process noise, with the noise of a good and of a poor sensor."""
    force_torque = np.repeat([1.0, 0.05], 3)
    values = (2e-4 * force_torque, 0.1 * force_torque, np.zeros(12), np.repeat([5.0, 0.5, 0.01, 5e-4], 3))
    density, noise_std, mean, std = (jnp.asarray(x, dtype) for x in values)
    return BiasNoise(density, None, noise_std**2, mean, std)


@pytest.mark.slow
def test_covariance_is_positive_definite_for_a_million_samples_in_float32():
    last, healthy = covariances_at_1_khz(setup_defaults("float32"), 1_000_000)
    assert healthy
    assert last.covariance.dtype == jnp.float32


def test_float32_has_the_standard_deviations_of_float64():
    narrow, wide = (covariances_at_1_khz(setup_defaults(dtype), 50_000)[0] for dtype in ("float32", "float64"))
    stds = [np.sqrt(np.diagonal(state.covariance)) for state in (narrow, wide)]
    np.testing.assert_allclose(*stds, rtol=0.02)
