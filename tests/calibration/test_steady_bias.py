"""Which bias ``identify --bias`` writes: a constant one, or that at the end of a log that drifts."""

from types import SimpleNamespace

import numpy as np
import pytest

from ftbias_jax.calibration import identify_tool
from ftbias_jax.calibration.identify_tool import CLEARLY, STEADY
from ftbias_jax.cli.commands import demo
from ftbias_jax.setup import parse_setup

SETUP = parse_setup(demo.SETUP)


@pytest.fixture
def filtered(monkeypatch):
    """Results of a filter that are made up, and the setups that asked for them."""
    asked = []

    def results(gain):
        def filtered_with(setup, log):
            asked.append(setup.bias)
            still = not setup.bias.initial_drift_std.any()
            nats, bias = (100.0, 1.0) if still else (100.0 + gain, 2.0)
            both = np.stack([np.zeros(6), np.full(6, bias)])
            return SimpleNamespace(log_likelihood=nats, bias=both, bias_std=both / 10), None

        monkeypatch.setattr(identify_tool, "filtered_with", filtered_with)
        return asked

    return results


@pytest.mark.parametrize(("gain", "expected"), [(-20.0, 1.0), (CLEARLY / 2, 1.0), (2 * CLEARLY, 2.0)])
def test_the_bias_is_constant_unless_a_drift_is_clearly_likelier(filtered, gain, expected):
    asked = filtered(gain)
    bias, std = identify_tool._steady_bias(SETUP, log=None)
    np.testing.assert_array_equal(bias, expected)
    np.testing.assert_allclose(std, expected / 10)
    still, given = asked
    np.testing.assert_allclose(still.noise_density, STEADY * given.noise_density)
    np.testing.assert_array_equal(given.initial_drift_std, SETUP.bias.initial_drift_std)
