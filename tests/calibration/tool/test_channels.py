"""Gains and crosstalk recovered from synthetic readings with slow errors, and not found where there are none."""

import numpy as np
import pytest

from ftbias_jax.calibration.tool.channels import UNITS, fit_channels

RATE, SECONDS = 20, 60
T = np.arange(0, SECONDS, 1 / RATE)
DRIFT_STD = np.repeat([0.01, 5e-4], 3)
TRUTH = np.eye(6) + 0.04 * UNITS * np.random.default_rng(7).normal(size=(6, 6))


def loads():
    """(T, 6) N, Nm: wrench of 1.2 kg at 0.1 m that turns through all directions."""
    a, b = 0.31 * T, 0.23 * T
    down = 9.81 * np.stack([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)], 1)
    return np.concatenate([1.2 * down, np.cross([0.01, -0.02, 0.1], 1.2 * down)], 1)


def slow_errors(seed, std=0.1, time=2.0):
    """(T, 6) first-order Gauss-Markov noise, a tenth as large in the torques, plus white noise."""
    rng = np.random.default_rng(seed)
    kept = np.exp(-1 / RATE / time)
    x = np.zeros((len(T), 6))
    x[0] = rng.normal(size=6)
    for i in range(1, len(T)):
        x[i] = kept * x[i - 1] + np.sqrt(1 - kept**2) * rng.normal(size=6)
    return std * UNITS[:, 0] * (x + rng.normal(size=x.shape))


def fitted(matrix, seed, bias=0.0, zeroed_at=()):
    load = loads()
    reading = load @ matrix.T - bias + slow_errors(seed)
    return fit_channels(T, load, load - reading, DRIFT_STD, zeroed_at)


def test_gains_and_leaks_are_found_within_their_standard_errors():
    found = [fitted(TRUTH, seed, bias=3.0) for seed in range(3)]
    assert all(each.shown for each in found)
    off = np.array([(each.matrix - TRUTH) / each.stderr for each in found])
    assert 0.6 < np.sqrt((off**2).mean()) < 1.4
    before = np.sqrt(np.mean(((TRUTH - np.eye(6)) / UNITS) ** 2))
    after = np.sqrt(np.mean([((each.matrix - TRUTH) / UNITS) ** 2 for each in found]))
    assert after < 0.7 * before


def test_a_sensor_that_is_right_is_left_as_it_is():
    found = [fitted(np.eye(6), seed, bias=3.0) for seed in range(5)]
    assert not any(each.shown for each in found)
    assert max(np.abs((each.matrix - np.eye(6)) / UNITS).max() for each in found) < 0.02


def test_a_bias_that_jumps_where_the_sensor_is_zeroed_is_no_leak():
    jump = np.where(T > 25.03, 8.0, 0.0)[:, None]
    found = fitted(TRUTH, 1, bias=jump, zeroed_at=(25.03,))
    assert found.shown
    np.testing.assert_allclose(found.matrix, fitted(TRUTH, 1).matrix, atol=0.01 * UNITS.max())
    assert np.abs((found.matrix - TRUTH) / found.stderr).max() < 4


def test_unmeasured_samples_are_left_out():
    load = loads()
    measured = load - load @ TRUTH.T + slow_errors(2)
    whole = fit_channels(T, load, measured, DRIFT_STD, ())
    measured[::50] = np.nan
    found = fit_channels(T, load, measured, DRIFT_STD, ())
    np.testing.assert_allclose(found.matrix, whole.matrix, atol=0.005 * UNITS.max())


@pytest.mark.parametrize("samples", [0, 100])
def test_a_log_of_a_few_seconds_shows_nothing(samples):
    load = loads()[: samples or None]
    measured = load - load @ TRUTH.T
    if not samples:
        measured[:, 4] = np.nan
    found = fit_channels(T[: len(load)], load, measured, DRIFT_STD, ())
    assert not found.shown
    np.testing.assert_array_equal(found.matrix, np.eye(6))
