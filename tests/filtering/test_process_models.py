"""Process models against the integral they come from, and the properties every exact discretisation has."""

import inspect

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ftbias_jax.filtering import joint_filter
from ftbias_jax.filtering.pipeline import DEFAULT_OPTIONS
from ftbias_jax.filtering.process_models import (
    JOINT_MODELS,
    acceleration_noise,
    bias_drift_noise,
    drift_noise,
    integrated_acceleration_noise,
    integrated_jerk_noise,
    matrix,
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
    """A and Q of a step belong to the same interval: taken from different ones, steps would not compose."""
    (A1, Q1), (A2, Q2), (A, Q) = (matrices(model, dt, 3.0) for dt in (first, second, first + second))
    np.testing.assert_allclose(A2 @ A1, A, rtol=1e-12)
    np.testing.assert_allclose(A2 @ Q1 @ A2.T + Q2, Q, rtol=1e-9)


@pytest.mark.parametrize("model", [*JOINT_MODELS.values(), drift_noise])
def test_no_time_changes_nothing(model):
    A, Q = matrices(model, 0.0, 3.0)
    np.testing.assert_array_equal(A, np.eye(len(A)))
    assert not Q.any()


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
