import numpy as np
import pytest

from ftbias_jax.calibration.tool.steps import find_steps, is_gained, with_steps
from ftbias_jax.io.log import Log

STD = np.repeat([0.1, 0.004], 3)


def readings(rate=250.0, seconds=40.0, seed=0):
    """The residual of a tool that is slightly wrong: noise and a slow wave."""
    t = np.arange(round(rate * seconds)) / rate
    noise = STD * np.random.default_rng(seed).normal(size=(len(t), 6))
    return t, noise + 5 * STD * np.sin(1.5 * t)[:, None]


@pytest.mark.parametrize("rate", [50.0, 250.0, 1000.0])
@pytest.mark.parametrize("size", [2.0, -50.0])
def test_a_step_is_found_to_the_sample_and_measured(rate, size):
    t, left = readings(rate)
    at = len(t) // 3
    left[at:, 1] += size
    (step,) = find_steps(t, left)
    assert t[at - 1] < step.time < t[at]
    np.testing.assert_allclose(step.size[1], size, atol=1.0)
    assert str(step).startswith("fy by ")


def test_knocks_spikes_and_slow_changes_are_no_steps():
    t, left = readings()
    assert find_steps(t, left) == []
    left[3000, 2] += 40.0
    for at in (1000, 5000):  # a knock rings and decays
        left[at : at + 100, :3] += 30 * np.sin(np.arange(100))[:, None] * np.exp(-np.arange(100) / 20)[:, None]
    left[7000:7010, 0] += 20.0
    left[:, 1] += np.clip(t - 20, 0, 3) * 5
    assert find_steps(t, left) == []
    assert find_steps(t[:10], left[:10]) == []


def test_two_steps_come_in_the_order_of_time_and_missing_readings_do_not_matter():
    t, left = readings()
    left[2000:, 0] += 3.0
    left[6000:] -= [3.0, 8.0, 0, 0, 0, 0]
    left[np.random.default_rng(1).random(len(t)) < 0.3] = np.nan
    found = find_steps(t, left)
    np.testing.assert_allclose([step.time for step in found], [t[2000], t[6000]], atol=0.02)
    nothing = np.full((len(t), 6), np.nan)
    log = Log(t, nothing, nothing, left, nothing[:, 0], 0.0, rezeroed_at=(5.0,))
    assert with_steps(log, found).rezeroed_at == (5.0, *(step.time for step in found))


def test_what_chance_explains_is_no_gain():
    t, left = readings()
    log = Log(t, left, left, left, left[:, 0], 0.0)
    assert is_gained(log, 2.0, 1.0)
    assert not is_gained(log, 1.0005, 1.0)
