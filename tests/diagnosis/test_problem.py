"""Logs in bins: noise of coarse readings, and blocks that keep logs apart."""

from dataclasses import replace
from types import SimpleNamespace

import jax
import numpy as np
import pytest

from ftbias_jax.cli.commands.demo import SETUP
from ftbias_jax.diagnosis.problem import Problem, make_problem, noise_on_lattice
from ftbias_jax.diagnosis.regression.evaluate import whitened
from ftbias_jax.diagnosis.samples.bins import BINS, bins_of, mean_of_bins
from ftbias_jax.filtering.samples import FORGOTTEN
from ftbias_jax.model.simulate_log import simulate
from ftbias_jax.setup import parse_setup

STATED = np.full(6, 0.1)


def findings(step, noise_std):
    return SimpleNamespace(lattice=SimpleNamespace(parameters={"step": step}), noise_std=noise_std)


def test_a_fine_lattice_leaves_the_noise_as_measured():
    noise, coherent = noise_on_lattice(findings([0.05] * 6, np.full(6, 0.12)), STATED)
    np.testing.assert_array_equal(noise, 0.12)
    np.testing.assert_array_equal(coherent, 0)


@pytest.mark.parametrize("ratio", [1.5, 2.0, 4.0, 8.0])
def test_noise_of_a_coarse_lattice_is_that_of_rounding(ratio):
    """Against simulated rounding: the scatter of one sample, and of means of many samples of a slow signal."""
    step = ratio * STATED[0]
    noise, coherent = noise_on_lattice(findings([step] * 6, np.full(6, 1e-9)), STATED)
    rng = np.random.default_rng(0)
    signal = rng.uniform(0, 100 * step, 400)[:, None]
    read = step * np.round((signal + STATED[0] * rng.normal(size=(400, 2000))) / step)
    assert noise[0] == pytest.approx((read - signal).std(), rel=0.05)
    means = (read.mean(1) - signal[:, 0]).std()
    # The first harmonic of the saw tooth has six tenths of its variance, so the estimate is conservative.
    assert 0.8 * means < np.sqrt(coherent[0] + noise[0] ** 2 / 2000) < 1.4 * means


def test_a_sensor_that_a_stated_effect_makes_quieter_has_noise_all_the_same():
    """The variance of the reading is then below the sensor's stated one, and that of the joints is not negative."""
    setup = replace(parse_setup(SETUP), effects={"noise_level": {"scale": np.full(6, 0.1)}})
    with jax.enable_x64(True):
        problem, _ = make_problem(setup, [simulate(setup, duration=4, rate=100, seed=1).log])
    (part,) = problem.parts
    assert (np.asarray(part.wrench.variance) > 0).all()


def test_a_log_that_begins_in_motion_is_silent_until_a_lag_is_forgotten():
    setup, effects = parse_setup(SETUP), {"low_pass": {"cutoff": 1.0}}
    with jax.enable_x64(True):
        log = simulate(setup, duration=12, rate=50, seed=1).log
        resting = log._replace(q=np.broadcast_to(log.q[0], log.q.shape), dq=np.zeros_like(log.dq))
        problem, _ = make_problem(setup, [log, resting])
        settled = problem.settled(effects)
    early = problem.t < -np.log(FORGOTTEN) / (2 * np.pi)
    assert 0.05 < early[problem.log == 0].mean() < 0.1
    moving, rested = (np.where(problem.log == i, early, False) for i in (0, 1))
    np.testing.assert_array_equal(settled.samples, np.where(moving[:, None], 0, problem.samples))
    white = whitened(settled, np.ones((1, len(problem.t), 6)))[0]
    assert not white[moving].any()
    assert white[rested].any()
    assert settled.parts[1] is problem.parts[1]
    assert problem.settled({}) is problem


def test_blocks_do_not_reach_over_two_logs():
    log, t = np.array([0, 0, 0, 1, 1]), np.array([0.5, 1.5, 2.5, 0.1, 2.2])
    problem = Problem((), t, log, *[np.zeros(0)] * 3, (3.0, 3.0), np.ones(6), {})
    np.testing.assert_array_equal(problem.block(2.0), [0, 0, 1, 2, 3])


def test_bins_hold_the_mean_of_what_is_known():
    """Means over each hundredth of a second; a bin without a sample is left out, one without a reading is NaN."""
    t = np.array([0.001, 0.004, 0.012, 0.018, 0.031, 0.039, 0.04])
    x = np.array([[1.0, 2.0], [3.0, np.nan], [5.0, 6.0], [7.0, 9.0], [8.0, np.nan], [4.0, np.nan], [2.0, 1.0]])
    index, used, padded = bins_of(t, 0.04)
    np.testing.assert_array_equal(index, [0, 0, 1, 1, 2, 2, 3])
    assert (used, padded) == (4, BINS[0])
    np.testing.assert_array_equal(mean_of_bins(index, x), [[2, 2], [6, 7.5], [6, np.nan], [2, 1]])
    np.testing.assert_allclose(mean_of_bins(index, t), [0.0025, 0.015, 0.035, 0.04])
