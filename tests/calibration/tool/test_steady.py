"""The bias that ``identify --bias`` writes: a constant one, or that at the end of a log that drifts."""

from types import SimpleNamespace

import numpy as np
import pytest

from ftbias_jax.calibration.judgement import SHORT
from ftbias_jax.calibration.tool import steady
from ftbias_jax.calibration.tool.steady import CLEARLY, STEADY, SteadyBias
from ftbias_jax.cli.commands import demo
from ftbias_jax.setup import parse_setup
from ftbias_jax.setup.types import ToolSetup

SETUP = parse_setup(demo.SETUP)
NOISE = SimpleNamespace(bias=SimpleNamespace(drift_time=None, correlated_time=None))


def log_of(seconds):
    return SimpleNamespace(t=np.arange(0, seconds + 0.05, 0.1))


@pytest.fixture
def filtered(monkeypatch):
    """Made-up results of a filter, and the setups with which they were requested."""
    asked = []

    def results(gain, error_of_drift=0.5, error_of_constant=1.0):
        def filtered_with(setup, log):
            asked.append(setup.bias)
            still = not setup.bias.initial_drift_std.any()
            nats, bias, error = (100.0, 1.0, error_of_constant) if still else (100.0 + gain, 2.0, error_of_drift)
            flat = np.full((len(log.t), 6), bias)
            reading = error * np.where(np.arange(len(log.t)) % 2, 1.0, -1.0)[:, None]
            result = SimpleNamespace(
                t=log.t,
                log_likelihood=nats,
                bias=flat,
                bias_std=flat / 10,
                drift=0 * flat,
                slow_error=None,
                used=None,
                wrench_tool=0 * flat,
                wrench_unbiased=reading + 0 * flat,
            )
            return result, NOISE

        monkeypatch.setattr(steady, "filtered_with", filtered_with)
        return asked

    return results


@pytest.mark.parametrize(("gain", "expected"), [(-20.0, 1.0), (CLEARLY / 2, 1.0), (2 * CLEARLY, 2.0)])
def test_the_bias_is_constant_unless_a_drift_is_clearly_likelier(filtered, gain, expected):
    asked = filtered(gain)
    found = steady.steady_bias(SETUP, log_of(2 * SHORT))
    np.testing.assert_array_equal(found.value, expected)
    np.testing.assert_allclose(found.std, expected / 10)
    still, given = asked
    np.testing.assert_allclose(still.noise_density, STEADY * given.noise_density)
    np.testing.assert_array_equal(given.initial_drift_std, SETUP.bias.initial_drift_std)


def test_a_drift_that_is_likelier_but_predicts_worse_is_not_taken(filtered):
    filtered(2 * CLEARLY, error_of_drift=1.1)
    np.testing.assert_array_equal(steady.steady_bias(SETUP, log_of(2 * SHORT)).value, 1.0)


def test_a_short_log_has_a_constant_bias_whatever_is_likelier(filtered):
    asked = filtered(100 * CLEARLY)
    np.testing.assert_array_equal(steady.steady_bias(SETUP, log_of(0.9 * SHORT)).value, 1.0)
    assert len(asked) == 1


def test_logs_after_a_constant_bias_begin_with_the_drift_that_its_noise_makes_in_a_log(filtered):
    filtered(-20.0)
    found = steady.steady_bias(SETUP, log_of(2 * SHORT))
    wandered = SETUP.bias.noise_density * np.sqrt(2 * SHORT)
    np.testing.assert_allclose(found.drift_std, np.minimum(wandered, SETUP.bias.initial_drift_std))
    filtered(2 * CLEARLY)
    drifting = steady.steady_bias(SETUP, log_of(2 * SHORT))
    np.testing.assert_array_equal(drifting.drift_std, SETUP.bias.initial_drift_std)


def test_an_unknown_tool_widens_the_bias_by_what_its_wrench_varies():
    """Naive reference: tools drawn at random, and the wrench of each minus its mean over poses."""
    rng = np.random.default_rng(0)
    down = 9.81 * rng.normal(size=(4000, 3)) / np.sqrt(3)  # isotropic
    mass, center, stderr = 2.0, np.array([0.01, -0.02, 0.05]), np.array([0.02, 1e-3, 2e-3, 4e-3])

    def wrench(mass, center):
        return np.concatenate([mass * down, np.cross(center, mass * down)], 1)

    drawn = [
        wrench(mass + stderr[0] * rng.normal(), center + stderr[1:] * rng.normal(size=3)) - wrench(mass, center)
        for _ in range(400)
    ]
    expected = np.sqrt(np.mean([np.var(each, axis=0) for each in drawn], axis=0))
    load_std = wrench(mass, center).std(0)
    found = SteadyBias(np.zeros(6), np.full(6, 1e-6), np.zeros(6), load_std)
    tool = ToolSetup(mass, center, np.zeros(6), mass_std=stderr[0], center_of_mass_std=stderr[1:])
    np.testing.assert_allclose(found.std_with_tool(tool), expected, rtol=0.1)
