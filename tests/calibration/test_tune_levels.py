"""Stated noise that is wrong by orders of magnitude does not change the result."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from made_series import gauss_markov

import ftbias_jax as ft
from ftbias_jax.calibration.tune import Fit
from ftbias_jax.calibration.tune_levels import FAR, no_less_than_scatter, start_from_observed_level
from ftbias_jax.filtering.params_for_log import max_likelihood_params
from ftbias_jax.filtering.samples import samples_from_log

STD, DENSITY = np.repeat([0.05, 0.002], 3), np.repeat([0.02, 8e-4], 3)
SETUP = ft.parse_setup(
    {
        "robot": {"model": "ur5e"},
        "sensor": {"noise_std": STD.tolist()},
        "tool": {"mass": 0.8, "center_of_mass": [0, 0.01, 0.06]},
        "bias": {"noise_density": DENSITY.tolist()},
    }
)
BOTH = ("density", "wrench_std")


@pytest.fixture(scope="module")
def log():
    return ft.simulate(SETUP, duration=120, rate=50, seed=5).log


@pytest.fixture(scope="module")
def correlated(log):
    """The log with slow errors as large as the noise of a sample."""
    slow = gauss_markov(np.random.default_rng(1), log.t, STD, 1.0)
    return log._replace(wrench=log.wrench + slow)


@pytest.fixture(scope="module")
def right(log):
    """Parameters with which the log was simulated."""
    return max_likelihood_params(SETUP, samples_from_log(log))


def off_by(params, sensor, drift):
    bias = params.bias
    return params._replace(
        bias=bias._replace(wrench_variance=sensor**2 * bias.wrench_variance, density=drift * bias.density)
    )


@pytest.mark.slow
def test_noise_that_is_right_stays_to_the_last_digit(log, right):
    found = start_from_observed_level(right, [log], BOTH, ft.Options())
    np.testing.assert_array_equal(found.bias.density, right.bias.density)
    np.testing.assert_array_equal(found.bias.wrench_variance, right.bias.wrench_variance)


@pytest.mark.parametrize(("sensor", "drift"), [(500, 500), (1 / 500, 500), (1, 1 / 500), (500, 1 / 500)])
def test_noise_that_is_wrong_by_500_comes_to_its_level(log, right, sensor, drift):
    found = start_from_observed_level(off_by(right, sensor, drift), [log], BOTH, ft.Options()).bias
    std = np.sqrt(found.wrench_variance)
    assert (np.abs(np.log(std / STD)) < np.log(FAR)).all()
    # A slow error that forecasts better by chance may replace an axis's drift: a log has few independent 10 s.
    assert (np.abs(np.log10(found.density / DENSITY)) < 1).sum() >= 5


def test_beside_slow_errors_a_drift_that_is_too_strong_comes_down(correlated, right):
    found = start_from_observed_level(off_by(right, 1, 500), [correlated], BOTH, ft.Options()).bias
    assert (found.density < 10 * DENSITY).all()


def test_what_is_not_fitted_stays_as_it_is_stated(log, right):
    wrong = off_by(right, 500, 500)
    found = start_from_observed_level(wrong, [log], ("density",), ft.Options()).bias
    assert (found.wrench_variance == wrong.bias.wrench_variance).all()
    assert jnp.all(
        start_from_observed_level(wrong, [log], ("wrench_std",), ft.Options()).bias.density == wrong.bias.density
    )


@pytest.mark.slow
def test_tuning_from_far_off_ends_where_tuning_from_the_truth_does(log):
    wrong = replace(
        SETUP,
        sensor=replace(SETUP.sensor, noise_std=STD / 500),
        bias=replace(SETUP.bias, noise_density=500 * DENSITY),
    )
    near, far = ft.tune(SETUP, [log]), ft.tune(wrong, [log], unchecked=True)
    np.testing.assert_allclose(far.setup.sensor.noise_std, near.setup.sensor.noise_std, rtol=0.1)
    for expected, found in zip(near.predicted, far.predicted, strict=True):
        assert (found.after < 1.2 * expected.after).all()


@pytest.mark.parametrize("fitted", [0.01, 1.05])
def test_a_sensor_is_no_quieter_than_its_neighbouring_readings_scatter(log, right, fitted):
    """A fit that attributes the sensor's noise to the joints, down to none at all, is corrected; others are not."""
    std = np.sqrt(np.asarray(right.bias.wrench_variance))
    params = right._replace(bias=right.bias._replace(wrench_variance=(fitted * std) ** 2))
    fit = Fit({"wrench_std": fitted * std}, {"wrench_std": np.full(6, np.inf)}, [], None)
    params, found = no_less_than_scatter(params, fit, [log])
    np.testing.assert_allclose(np.sqrt(params.bias.wrench_variance), found.values["wrench_std"], rtol=1e-6)
    if fitted > 1:
        assert found is fit
    else:
        np.testing.assert_allclose(found.values["wrench_std"], std, rtol=0.15)
        assert (found.relative_stderr["wrench_std"] < 0.1).all()
        assert "scatter" in found.determined[0]
