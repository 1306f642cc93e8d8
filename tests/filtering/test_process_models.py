"""Process models against the integral that defines them, and properties of every exact discretisation."""

import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from ftbias_jax.filtering import joint_filter
from ftbias_jax.filtering.pipeline import DEFAULT_OPTIONS
from ftbias_jax.filtering.process_models import (
    JOINT_MODELS,
    BiasStrength,
    acceleration_noise,
    bias_drift_noise,
    bias_noise,
    correlated_bias,
    drift_noise,
    integrated_acceleration_noise,
    integrated_jerk_noise,
    matrix,
    reverting_drift,
)

INTEGRATED = [
    pytest.param(integrated_acceleration_noise, [0.0, 1.0, 0.0], id="integrated acceleration"),
    pytest.param(integrated_jerk_noise, [0.0, 0.0, 1.0], id="integrated jerk"),
    pytest.param(drift_noise, [0.0, 1.0], id="drift"),
]

intervals = st.floats(1e-4, 10.0)


def matrices(model, dt, density):
    return tuple(np.asarray(matrix(rows)) for rows in model(jnp.asarray(dt), jnp.asarray(density)))


@pytest.mark.parametrize(("model", "entry"), INTEGRATED)
@given(dt=intervals, density=st.floats(0.01, 100.0))
def test_integrated_noise_is_the_integral_of_the_report(model, entry, dt, density):
    """Q = int_0^dt exp(A s) L sigma^2 L^T exp(A s)^T ds; Gauss-Legendre is exact for these polynomials."""

    def transition(s):
        size = len(entry)
        return sum(np.eye(size, k=k) * s**k / [1, 1, 2][k] for k in range(size))

    nodes, weights = np.polynomial.legendre.leggauss(4)
    expected = np.zeros((len(entry), len(entry)))
    for node, weight in zip(dt / 2 * (1 + nodes), dt / 2 * weights, strict=True):
        column = transition(node) @ entry * density
        expected += weight * np.outer(column, column)
    A, Q = matrices(model, dt, density)
    np.testing.assert_allclose(A, transition(dt), rtol=1e-12)
    np.testing.assert_allclose(Q, expected, rtol=1e-12)


@pytest.mark.parametrize(("model", "entry"), INTEGRATED)
@given(first=intervals, second=intervals)
def test_erratum_07_two_steps_equal_one_of_their_total_length(model, entry, first, second):
    """A and Q of a step belong to the same interval; from different ones, steps would not compose."""
    (A1, Q1), (A2, Q2), (A, Q) = (matrices(model, dt, 3.0) for dt in (first, second, first + second))
    np.testing.assert_allclose(A2 @ A1, A, rtol=1e-12)
    np.testing.assert_allclose(A2 @ Q1 @ A2.T + Q2, Q, rtol=1e-9)


def test_erratum_14_models_1_and_2_are_as_printed_and_model_3_is_the_default():
    A1, Q1 = matrices(acceleration_noise, 0.1, 3.0)
    np.testing.assert_allclose(A1, [[1, 0.1, 0], [0, 1, 0.1], [0, 0, 1]])
    np.testing.assert_allclose(Q1, np.diag([0, 0, 9]))
    np.testing.assert_array_equal(matrices(acceleration_noise, 0.2, 3.0)[1], Q1)
    A2, Q2 = matrices(integrated_acceleration_noise, 0.1, 3.0)
    np.testing.assert_allclose(A2, [[1, 0.1, 0.005], [0, 1, 0.1], [0, 0, 1]])
    assert not Q2[2].any()
    assert JOINT_MODELS[DEFAULT_OPTIONS.joint_model] is integrated_jerk_noise
    assert JOINT_MODELS[inspect.signature(joint_filter.step).parameters["model"].default] is integrated_jerk_noise


def test_erratum_12_every_axis_has_its_own_noise():
    density = np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3])
    A, Q = bias_drift_noise(jnp.asarray(0.5), jnp.asarray(density))
    for axis in range(6):
        own = np.ix_([axis, axis + 6], [axis, axis + 6])
        expected_A, expected_Q = matrices(drift_noise, 0.5, density[axis])
        np.testing.assert_array_equal(A[own], expected_A)
        np.testing.assert_array_equal(Q[own], expected_Q)
    assert np.count_nonzero(Q) == 6 * 4
    assert np.count_nonzero(A) == 6 * 3


def van_loan(F, L, dt):
    """A and Q of dx = F x dt + L dw by one matrix exponential (Van Loan 1978), in steps short enough for it."""
    k, parts = len(F), max(1, int(np.ceil(np.abs(F).max() * dt / 5)))
    block = expm(np.block([[-F, L @ L.T], [np.zeros((k, k)), F.T]]) * dt / parts)
    step = block[k:, k:].T
    noise = step @ block[:k, k:]
    A, Q = np.eye(k), np.zeros((k, k))
    for _ in range(parts):
        A, Q = step @ A, step @ Q @ step.T + noise
    return A, Q


def strength_of(density, drift_rate, noise=()):
    return BiasStrength(*(jnp.asarray(x) for x in (density, drift_rate, *noise)))


def bias_matrices(model, dt, strength, dtype=float):
    strength = BiasStrength(*(None if x is None else jnp.asarray(x, dtype) for x in strength))
    return tuple(np.asarray(matrix(rows)) for rows in model(jnp.asarray(dt, dtype), strength))


@pytest.mark.parametrize("dt", [1e-4, 2e-3, 0.1, 0.49, 0.51, 3.0])
@pytest.mark.parametrize("rate", [1e-3, 0.2, 1.0, 30.0])
def test_a_drift_that_reverts_is_the_integral_of_its_equation(dt, rate):
    A, Q = bias_matrices(reverting_drift, dt, strength_of(0.3, rate))
    F, L = np.array([[0, 1], [0, -rate]]), np.array([[0.0], [0.3]])
    expected = van_loan(F, L, dt)
    np.testing.assert_allclose(A, expected[0], rtol=1e-9)
    np.testing.assert_allclose(Q, expected[1], rtol=1e-7)  # the matrix exponential itself loses digits in short steps


@pytest.mark.parametrize("dt", [1e-3, 0.1, 2.0])
@pytest.mark.parametrize("noise_rate", [0.1, 3.0])
@pytest.mark.parametrize("drift_rate", [0.0, 0.5])
def test_correlated_noise_on_top_is_the_integral_of_its_equation(dt, drift_rate, noise_rate):
    """State (bias + noise, drift, noise): the measured sum has the noise's equation in it."""
    std = 0.7
    A, Q = bias_matrices(correlated_bias, dt, strength_of(0.3, drift_rate, (noise_rate, std**2)))
    F = np.array([[0, 1, -noise_rate], [0, -drift_rate, 0], [0, 0, -noise_rate]])
    kick = std * np.sqrt(2 * noise_rate)
    L = np.array([[0, kick], [0.3, 0], [0, kick]])
    expected = van_loan(F, L, dt)
    np.testing.assert_allclose(A, expected[0], rtol=1e-9, atol=1e-13)
    np.testing.assert_allclose(Q, expected[1], rtol=1e-9, atol=1e-13)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("rate", [0.0, 1e-12, 1e-5, 1.0, 1e5, 1e12])
@pytest.mark.parametrize("dt", [0.0, 1e-6, 1e-3, 1.0, 1e4])
def test_extreme_rates_and_gaps_stay_finite(dt, rate, dtype):
    A, Q = bias_matrices(correlated_bias, dt, strength_of(1e-3, rate, (rate, 0.5)), dtype)
    assert A.dtype == Q.dtype == dtype
    assert np.isfinite(A).all()
    assert np.isfinite(Q).all()
    assert (np.diag(Q) >= 0).all()
    scale = np.sqrt(np.maximum(np.diag(Q), np.finfo(dtype).tiny))
    assert np.linalg.eigvalsh(Q / np.outer(scale, scale)).min() > -20 * np.finfo(dtype).eps
    if rate * dt == 0:
        assert Q[2, 2] == 0
    if dt == 0:
        np.testing.assert_array_equal(A, np.eye(3))
        assert not Q.any()
    elif rate * dt > 100:
        assert Q[2, 2] == pytest.approx(0.5, rel=1e-6)
        assert abs(A[2, 2]) < 1e-30


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_gradients_are_finite_and_right(dtype):
    """At rates on both sides of every series expansion, at zero, and for dt = 0."""

    def total(parameters, dt):
        rows = correlated_bias(dt, BiasStrength(*parameters))
        return sum(jnp.sum(entry) for part in rows for row in part for entry in row)

    rates = jnp.asarray([0.0, 1e-9, 1e-3, 0.9e-2, 1.1e-2, 49.0, 51.0, 1e3], dtype)
    ones = jnp.ones_like(rates)
    parameters = (0.3 * ones, rates, rates, 0.5 * ones)
    for dt in (0.0, 0.01, 10.0):
        for slope in jax.grad(total)(parameters, jnp.asarray(dt, dtype)):
            assert np.isfinite(slope).all()
    if dtype == np.float64:
        step = 1e-6
        slope = jax.grad(total)(parameters, jnp.asarray(0.01))[1][2:7]
        up, down = (
            jnp.stack([total((*parameters[:1], rates.at[i].add(by), *parameters[2:]), 0.01) for i in range(2, 7)])
            for by in (step, -step)
        )
        np.testing.assert_allclose((up - down) / (2 * step), slope, rtol=1e-4, atol=1e-8)


def test_six_axes_in_matrices_are_the_axes_one_by_one():
    """``bias_noise`` has bias, drift and noise apart; its measured sum moves as ``correlated_bias`` says."""
    strength = strength_of(np.linspace(1, 2, 6), np.linspace(0, 1, 6), (np.linspace(0.5, 3, 6), np.linspace(0.1, 1, 6)))
    A, Q = (np.asarray(x) for x in bias_noise(jnp.asarray(0.4), strength))
    assert A.shape == Q.shape == (18, 18)
    total = np.array([[1, 0, 1], [0, 1, 0], [0, 0, 1]])  # (bias, drift, noise) -> (bias + noise, drift, noise)
    for axis in range(6):
        own = np.ix_([axis, axis + 6, axis + 12], [axis, axis + 6, axis + 12])
        expected = bias_matrices(correlated_bias, 0.4, [None if x is None else x[axis] for x in strength])
        np.testing.assert_allclose(total @ A[own] @ np.linalg.inv(total), expected[0], rtol=1e-12, atol=1e-15)
        np.testing.assert_allclose(total @ Q[own] @ total.T, expected[1], rtol=1e-12, atol=1e-15)
    assert np.count_nonzero(Q) == 6 * 5
