"""Effects with memory: their state before the log is unknown, and must not become bias."""

import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.filtering.samples import FORGOTTEN, LONGEST, MOST, arrays_from_log, settled_at, without_unsettled
from ftbias_jax.io.log import Log
from ftbias_jax.model.effects.responses import swing
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.setup import parse_setup

ARM = {
    "robot": {"joints": [{"axis": [0, 0, 1], "point": [0, 0, 0]}], "flange": {"translation": [0.1, 0, 0.6]}},
    "sensor": {"noise_std": [0.1, 0.004]},
    "tool": {"mass": 0.7, "center_of_mass": [0.01, 0, 0.06]},
}
T = np.arange(1000) / 50


def params_with(**effects):
    return params_from_setup(parse_setup({**ARM, "effects": effects}))


def swinging(frequency=4.0, damping_ratio=0.5):
    numbers = {"frequency": frequency, "damping_ratio": damping_ratio, "coefficients": [0.3]}
    return {"drive": "acceleration", "form": "swing", "frame": "base", "acts_as": "force", **numbers}


def test_a_swing_begun_otherwise_is_forgotten_by_then():
    """Two accelerations that differ only before some time have nearly the same effect after the wait."""
    t = np.arange(8000) / 1000
    wait = settled_at(t, params_with(term=[swinging()])) - t[0]
    assert wait == pytest.approx(-np.log(FORGOTTEN) / (2 * np.pi * 4.0 * 0.5))
    shaken = np.where(t < 1.0, np.sin(25 * t), np.sin(25.0))[:, None]
    left = np.abs(swing(np, t, shaken, 4.0, 0.5)[t >= 1.0, 0])
    largest = left[t[t >= 1.0] < 1.0 + wait / 3].max()
    assert largest > 0.1
    assert left[t[t >= 1.0] >= 1.0 + wait].max() < 3 * FORGOTTEN * largest


@pytest.mark.parametrize(
    ("effects", "wait"),
    [
        ({"low_pass": {"cutoff": 5.0}}, -np.log(FORGOTTEN) / (2 * np.pi * 5.0)),
        ({"tool_flexibility": {"frequency": 12.0, "damping_ratio": 0.1}}, -np.log(FORGOTTEN) / (2 * np.pi * 1.2)),
        ({"term": [swinging(), swinging(damping_ratio=0.9)]}, -np.log(FORGOTTEN) / (2 * np.pi * 2.0)),
        ({"term": [swinging(damping_ratio=0.001)]}, LONGEST),
        ({"tool_mass": {"mass": 0.8}}, 0.0),
    ],
)
def test_the_wait_is_that_of_the_longest_memory_within_bounds(effects, wait):
    assert settled_at(2 * T + 3, params_with(**effects)) == pytest.approx(3 + wait)
    short = T[:11]
    assert settled_at(short, params_with(**effects)) == pytest.approx(min(wait, MOST * short[-1]))


def test_without_effects_the_first_sample_counts():
    assert settled_at(T + 3, params_from_setup(parse_setup(ARM))) == 3


def test_the_wrench_alone_is_left_out_and_only_before_it_has_settled():
    nothing = np.full(len(T), np.nan)
    log = Log(T, np.zeros((len(T), 1)), np.zeros((len(T), 1)), np.ones((len(T), 6)), nothing)
    samples = arrays_from_log(log, jnp.float64)
    params = params_with(low_pass={"cutoff": 8.0})
    left = without_unsettled(samples, T, params)
    np.testing.assert_array_equal(np.isfinite(left.wrench).all(1), settled_at(T, params) <= T)
    assert 0 < np.isnan(left.wrench[:, 0]).sum() < 10
    np.testing.assert_array_equal(left.q, samples.q)
    assert without_unsettled(samples, T, params_with(tool_mass={"mass": 0.8})) is samples
