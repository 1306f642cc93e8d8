"""The noise of measured joints, separated from their motion."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.cli.commands.demo import SETUP
from ftbias_jax.filtering.noise.joint_scatter import (
    UNUSED,
    departs,
    derived,
    no_less_than_shown,
    remark_of_joints,
    scatter,
)
from ftbias_jax.filtering.params_for_log import max_likelihood_params
from ftbias_jax.filtering.samples import samples_from_log
from ftbias_jax.model.effects.responses import lagged
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.model.simulate_log import simulate
from ftbias_jax.setup import parse_setup

STD = 2e-5
T = np.arange(8000) / 250
SPEEDS = np.array([0.02, 0.3, 2.0])
"""Largest speeds, rad/s."""


def moving(t):
    return 0.5 * SPEEDS * np.sin(2 * t[:, None] + np.arange(3))


def noisy(t, std=STD):
    return moving(t) + std * np.random.default_rng(0).normal(size=(len(t), 3))


def test_white_noise_is_measured_at_any_speed():
    np.testing.assert_allclose(scatter(T, noisy(T)), STD, rtol=0.15)


def test_irregular_steps_are_no_noise():
    """At the times of the samples, which are up to 5 % of a step early or late."""
    jitter = np.random.default_rng(1).uniform(-0.05, 0.05, len(T)) / 250
    t = T + jitter
    np.testing.assert_allclose(scatter(t, noisy(t)), STD, rtol=0.15)
    speed = (moving(t + 1e-6) - moving(t - 1e-6)) / 2e-6 + 1e-3 * np.random.default_rng(2).normal(size=(len(t), 3))
    assert not derived(t, noisy(t), speed, scatter(t, noisy(t))).any()


def test_motion_is_no_noise():
    assert (scatter(T, moving(T)) < 0.01 * STD).all()
    slow = np.arange(400) / 50
    vibrating = moving(slow) + 1e-3 * np.sin(150 * slow)[:, None]
    assert not scatter(slow, vibrating).any()


@pytest.mark.parametrize("degrees", [0.01, 0.05])
def test_rounding_is_that_of_the_step_whether_or_not_it_looks_white(degrees):
    step = np.radians(degrees)
    found = scatter(T, step * np.round(noisy(T, 1e-7) / step))
    assert (found >= 0.99 * step / np.sqrt(12)).all()
    assert (found[1:] < 1.3 * step / np.sqrt(12)).all()


def test_a_slower_stream_has_the_noise_that_it_has():
    """Between its readings, rows are missing or repeat the last reading."""
    every = T[::2]
    slower = noisy(every)
    missing = np.full((len(T), 3), np.nan)
    missing[::2] = slower
    for values in (np.repeat(slower, 2, axis=0), missing):
        np.testing.assert_allclose(scatter(T, values), STD, rtol=0.2)


def test_pauses_and_joints_at_rest_do_not_count():
    values, t = noisy(T), T + 3.0 * (T > 4.0)
    values[3000:7000] = values[3000]
    np.testing.assert_allclose(scatter(t, values), STD, rtol=0.2)
    assert not scatter(T, np.broadcast_to(values[0], values.shape)).any()
    assert not scatter(T[:20], values[:20]).any()


@pytest.mark.parametrize(
    ("changed", "which"),
    [
        (lambda dq: dq, [False, False, False]),
        (lambda dq: np.asarray(lagged(jnp.asarray(T), jnp.asarray(dq), 1 / (2 * np.pi * 0.02))), [True, True, True]),
        (lambda dq: dq * [1.0, 1.02, 0.98], [False, True, True]),
        (lambda dq: np.where(np.arange(len(T))[:, None] % 8, np.nan, dq), [False, False, False]),
        (lambda dq: np.zeros_like(dq), [True, True, True]),
        (lambda dq: np.full_like(dq, np.nan), [False, False, False]),
    ],
)
def test_velocities_must_add_up_to_the_change_of_the_positions(changed, which):
    exact = SPEEDS * np.cos(2 * T[:, None] + np.arange(3))
    dq = changed(exact + 1e-4 * np.random.default_rng(1).normal(size=exact.shape))
    np.testing.assert_array_equal(departs(T, noisy(T), dq, np.full(3, STD)), which)


def test_a_planned_motion_is_in_order():
    """Without noise the only difference is that of a sum from an integral."""
    exact = SPEEDS * np.cos(2 * T[:, None] + np.arange(3))
    assert not departs(T[::4], moving(T[::4]), exact[::4], np.full(3, STD)).any()
    resting = np.zeros((len(T), 3))
    assert not departs(T, resting, resting, np.full(3, STD)).any()


@pytest.mark.parametrize("late", [False, True])
def test_differences_of_positions_are_no_measurement(late):
    q = noisy(T)
    slopes = np.diff(q, axis=0, prepend=q[:1] - 0.01) * 250 if late else np.gradient(q, T, axis=0)
    noise = np.full(3, STD)
    assert derived(T, q, slopes, noise).all()
    assert not derived(T, q, slopes + STD * 250 * np.random.default_rng(1).normal(size=q.shape), noise).any()
    exact = SPEEDS * np.cos(2 * T[:, None] + np.arange(3))
    assert not derived(T, q, exact, noise).any()


def test_velocities_that_do_not_follow_are_not_used_and_that_is_told():
    setup = parse_setup(SETUP)
    log = simulate(setup, duration=20, rate=100, seed=2).log
    with jax.enable_x64(True):
        params = max_likelihood_params(setup, samples_from_log(log._replace(dq=0.9 * log.dq)))
    assert (params.joint.velocity_std >= UNUSED).all()
    (said,) = remark_of_joints(setup, params)
    assert said.what.startswith("joint velocities lag")


@pytest.mark.parametrize("wide", [True, False])
def test_what_is_stated_too_small_is_taken_from_the_log_and_told(wide):
    setup = parse_setup(SETUP)
    log = simulate(setup, duration=20, rate=100, seed=2).log
    with jax.enable_x64(wide):
        samples, stated = samples_from_log(log), params_from_setup(setup)
        same = no_less_than_shown(stated.joint, samples)
        for one, other in zip(same, stated.joint, strict=True):
            np.testing.assert_array_equal(one, other)
            assert one.dtype == other.dtype
        assert remark_of_joints(setup, stated) == ()
        quiet = replace(setup, joints=replace(setup.joints, position_noise_std=setup.joints.position_noise_std / 5))
        params = max_likelihood_params(quiet, samples)
        np.testing.assert_allclose(params.joint.position_std, stated.joint.position_std, rtol=0.3)
        np.testing.assert_array_equal(params.joint.velocity_std, stated.joint.velocity_std)
        (said,) = remark_of_joints(quiet, params)
    assert said.what.startswith("joint positions scatter")
    assert not said.lost
