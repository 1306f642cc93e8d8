"""Forecasts of a filtered log against a Kalman filter of (bias, drift, slow error) continued without readings."""

from types import SimpleNamespace

import numpy as np
import pytest

from ftbias_jax.filtering.quality.ahead import SOONER, forecast

STEP, SIGMA, TIME, WHITE, DENSITY = 0.02, 0.3, 4.0, 0.02, 1e-3
"""s, N, s, N, N/s^1.5."""
STATE = np.array([2.0, 0.05, -0.2])


def process(seconds):
    """A and Q of (bias, drift, slow error)."""
    kept = np.exp(-seconds / TIME)
    A = np.array([[1, seconds, 0], [0, 1, 0], [0, 0, kept]])
    cross = DENSITY**2 * seconds**2 / 2
    Q = np.array([[DENSITY**2 * seconds**3 / 3, cross, 0], [cross, DENSITY**2 * seconds, 0], [0, 0, 0]])
    Q[2, 2] = SIGMA**2 * (1 - kept**2)
    return A, Q


def sooner(seconds):
    """The same, if the slow error decays faster."""
    (A, Q), kept = process(seconds), np.exp(-SOONER * seconds / TIME)
    A[2, 2], Q[2, 2] = kept, SIGMA**2 * (1 - kept**2)
    return A, Q


@pytest.fixture(scope="module")
def covariance():
    """(3, 3) covariance after 20 s of readings."""
    A, Q = process(STEP)
    C, P = np.array([1.0, 0, 1]), np.diag([1.0, 1e-4, SIGMA**2])
    for _ in range(round(20 / STEP)):
        P = A @ P @ A.T + Q
        K = P @ C / (C @ P @ C + WHITE**2)
        P = P - np.outer(K, C @ P)
    return P


def result_of(covariance, **changes):
    six = np.ones((1, 6))
    std = np.sqrt(np.diag(covariance))
    bias = SimpleNamespace(
        density=np.full(6, DENSITY), drift_time=None, correlated_std=np.full(6, SIGMA), correlated_time=np.full(6, TIME)
    )
    values = {
        "bias": STATE[0] * six,
        "drift": STATE[1] * six,
        "slow_error": STATE[2] * six,
        "bias_std": std[0] * six,
        "drift_std": std[1] * six,
        "reading_std": np.hypot(WHITE, SIGMA) * six,
        "params": SimpleNamespace(bias=bias),
    }
    return SimpleNamespace(**values | changes)


@pytest.mark.parametrize("seconds", [0.5, 1.0, 10.0, 100.0])
def test_a_forecast_is_that_of_the_filter_run_on(covariance, seconds):
    found = forecast(result_of(covariance), seconds)
    C = np.array([1.0, 0, 1])
    np.testing.assert_allclose(found.mean, C @ process(seconds)[0] @ STATE)
    # A result has no covariances: those of bias and drift are as in the steady state, of bias and slow error opposite.
    exact, careful = (
        np.sqrt(C @ (A @ covariance @ A.T + Q) @ C + WHITE**2) for A, Q in (process(seconds), sooner(seconds))
    )
    np.testing.assert_allclose(found.std, careful, rtol=0.1)
    assert (found.std > 0.99 * exact).all()


@pytest.mark.parametrize("density", [1e-3, 2e-2])
@pytest.mark.parametrize("seconds", [0.1, 2.0, 10.0])
def test_without_slow_errors_the_forecast_is_that_of_bias_and_drift(density, seconds):
    def process(seconds):
        cross = seconds**2 / 2
        return np.array([[1, seconds], [0, 1]]), density**2 * np.array([[seconds**3 / 3, cross], [cross, seconds]])

    A, Q = process(STEP)
    C, P = np.array([1.0, 0]), np.diag([1.0, 1e-4])
    for _ in range(round(60 / STEP)):
        P = A @ P @ A.T + Q
        K = P @ C / (C @ P @ C + WHITE**2)
        P = P - np.outer(K, C @ P)
    white = result_of(np.diag(np.diag(P)), slow_error=None, reading_std=np.full((1, 6), WHITE))
    white.params.bias.density[:] = density
    A, Q = process(seconds)
    found = forecast(white, seconds)
    np.testing.assert_allclose(found.mean, STATE[0] + seconds * STATE[1])
    np.testing.assert_allclose(found.std, np.sqrt(C @ (A @ P @ A.T + Q) @ C + WHITE**2), rtol=0.01)


def test_an_axis_whose_noise_is_white_keeps_all_doubt_of_its_bias(covariance):
    result = result_of(covariance, reading_std=np.full((1, 6), WHITE))
    result.params.bias.correlated_std[0] = 0.0
    result.slow_error[:, 0] = 0.0
    result.reading_std[:, 1:] = np.hypot(WHITE, SIGMA)
    result.params.bias.density[:] = 0.0
    (bias,), (drift,) = result.bias_std[:, 0], result.drift_std[:, 0]
    expected = np.sqrt(bias**2 + np.sqrt(2) * bias * drift + drift**2 + WHITE**2)
    found = forecast(result, 1.0)
    np.testing.assert_allclose(found.std[0, 0], expected)
    assert found.std[0, 1] != pytest.approx(expected)


@pytest.mark.parametrize("time", [0.5, 3.0, 1e3, 1e4, np.inf])
def test_process_noise_of_a_drift_that_reverts_is_the_sum_over_its_impulses(covariance, time):
    quiet, loud = (result_of(covariance, slow_error=None) for _ in range(2))
    for result, density in ((quiet, 0.0), (loud, 0.1)):
        result.params.bias.drift_time, result.params.bias.density[:] = np.full(6, time), density
    since = (np.arange(2000) + 0.5) * 10 / 2000
    moved = since if np.isinf(time) else -time * np.expm1(-since / time)
    more = forecast(loud, 10.0).std ** 2 - forecast(quiet, 10.0).std ** 2
    np.testing.assert_allclose(more, 0.1**2 * 10 * np.mean(moved**2), rtol=1e-4)


def test_a_drift_that_reverts_moves_the_bias_by_less(covariance):
    result = result_of(covariance)
    result.params.bias.drift_time = np.full(6, 5.0)
    moved = 5 * (1 - np.exp(-2))
    kept = np.exp(-10 / TIME)
    np.testing.assert_allclose(forecast(result, 10.0).mean, STATE[0] + moved * STATE[1] + kept * STATE[2])
