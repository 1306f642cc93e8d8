"""Responses against adaptive solvers, differential equations and loops over the samples."""

from itertools import pairwise

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import integrate

from ftbias_jax.model.effects.responses import delayed, lagged, low_passed, recurrence, rung, swing

T = np.sort(np.random.default_rng(1).uniform(0, 2, 300))
SIGNAL = np.stack([np.sin(5 * T), np.cos(3 * T) - T], 1)


def solved(derivative, start):
    """Output of a linear system, integrated by an adaptive method between the corners of its input."""
    states = [start]
    for a, b in pairwise(T):
        states.append(integrate.solve_ivp(derivative, (a, b), states[-1], rtol=1e-9, atol=1e-12).y[:, -1])
    return np.array(states)


def test_low_pass_is_the_solution_of_its_equation_at_irregular_stamps():
    cutoff = 2.0
    for channel in range(2):
        x = SIGNAL[:, channel]
        expected = solved(lambda t, y, x=x: 2 * np.pi * cutoff * (np.interp(t, T, x) - y), x[:1])
        np.testing.assert_allclose(lagged(T, SIGNAL, jnp.array(cutoff))[:, channel], expected[:, 0], atol=1e-7)


def test_low_pass_of_the_second_order_is_the_solution_of_its_equation_at_irregular_stamps():
    w = 2 * np.pi * 2.0
    for channel in range(2):
        x = SIGNAL[:, channel]

        def derivative(t, state, x=x):
            return [state[1], w**2 * (np.interp(t, T, x) - state[0]) - np.sqrt(2) * w * state[1]]

        expected = solved(derivative, np.array([x[0], 0.0]))
        got = lagged(T, SIGNAL, jnp.array(2.0), jnp.array(2.0))[:, channel]
        np.testing.assert_allclose(got, expected[:, 0], atol=1e-7)
    np.testing.assert_array_equal(lagged(T, SIGNAL, jnp.array(2.0), jnp.array(1.0)), lagged(T, SIGNAL, jnp.array(2.0)))


def test_ringing_is_the_solution_of_its_equation_at_irregular_stamps():
    w, zeta = 2 * np.pi * 4.0, 0.1
    slopes = np.diff(SIGNAL, axis=0) / np.diff(T)[:, None]
    for channel in range(2):
        x, slope = SIGNAL[:, channel], slopes[:, channel]

        def derivative(t, state, x=x, slope=slope):
            i = np.clip(np.searchsorted(T, t, side="right") - 1, 0, len(slope) - 1)
            spring = w**2 * (np.interp(t, T, x) - state[0])
            return [state[1], spring + 2 * zeta * w * (slope[i] - state[1])]

        expected = solved(derivative, np.array([x[0], slope[0]]))
        got = rung(T, SIGNAL, jnp.array(w / (2 * np.pi)), jnp.array(zeta))[:, channel]
        np.testing.assert_allclose(got, expected[:, 0], atol=2e-5)  # the solver steps over corners of the derivative


@pytest.mark.parametrize(
    "respond",
    [lambda t, x: lagged(t, x, jnp.inf), lambda t, x: lagged(t, x, jnp.inf, 2), lambda t, x: rung(t, x, jnp.inf, 0.1)],
)
def test_an_infinite_frequency_passes_everything(respond):
    np.testing.assert_array_equal(respond(T, SIGNAL), SIGNAL)


def test_repeated_stamps_at_the_end_do_no_harm():
    t, signal = np.r_[T, T[-1], T[-1]], np.concatenate([SIGNAL, np.zeros((2, 2))])
    for respond in (
        lambda t, x: lagged(t, x, jnp.array(2.0)),
        lambda t, x: lagged(t, x, jnp.array(2.0), 2),
        lambda t, x: rung(t, x, jnp.array(2.0), jnp.array(0.1)),
        lambda t, x: delayed(t, x, jnp.array(0.1)),
    ):
        np.testing.assert_allclose(respond(t, signal)[: len(T)], respond(T, SIGNAL), atol=1e-12)
        assert jnp.isfinite(respond(t, signal)).all()


def test_delay_reads_the_past_and_holds_the_first_value():
    got = delayed(T, np.stack([T, 2 * T], 1), jnp.array(0.3))
    np.testing.assert_allclose(got[:, 0], np.maximum(T - 0.3, T[0]), atol=1e-12)
    np.testing.assert_allclose(got[:, 1], 2 * got[:, 0], atol=1e-12)
    ahead = delayed(T, T[:, None], jnp.array(-0.3))
    np.testing.assert_allclose(ahead[:, 0], np.minimum(T + 0.3, T[-1]), atol=1e-12)


def test_a_recurrence_is_the_loop_it_stands_for():
    rng = np.random.default_rng(0)
    decay, kick = rng.uniform(0, 1, (37, 1)), rng.normal(size=(37, 3))
    expected, value = [], np.zeros(3)
    for a, b in zip(decay, kick, strict=True):
        value = a * value + b
        expected.append(value)
    np.testing.assert_allclose(recurrence(np, decay, kick), expected)


def test_a_low_pass_settles_with_its_time_constant():
    t = np.linspace(0, 3, 301)
    step = np.where(t > 0, 1.0, 0.0)[:, None]
    found = low_passed(np, t, step, np.array(0.5))
    np.testing.assert_allclose(found[:, 0], 1 - np.exp(-t / 0.5), atol=2e-2)


@pytest.mark.parametrize("damping_ratio", [0.05, 0.5])
def test_a_mass_on_a_spring_obeys_its_equation(damping_ratio):
    t = np.linspace(0, 4, 8001)
    signal = np.sin(5 * t)[:, None]
    w, h = 2 * np.pi * 1.5, t[1]
    deviation = swing(np, t, signal, np.array(1.5), np.array(damping_ratio))[:, 0]
    rate = np.gradient(deviation, h)
    left = np.gradient(rate, h) + 2 * damping_ratio * w * rate + w**2 * deviation - 25 * signal[:, 0]
    assert np.abs(left[10:-10]).max() < 0.02 * w**2 * np.abs(deviation).max()


@pytest.mark.parametrize("drive", [low_passed, lambda *x: swing(*x, np.array(0.3))])
def test_logs_one_after_the_other_do_not_know_of_each_other(drive):
    rng = np.random.default_rng(1)
    times = [np.arange(count) / 50 + start for count, start in ((900, 0.0), (700, 0.02), (500, 3.0))]
    signals = [np.cumsum(rng.normal(size=(len(t), 2)), axis=0) + 5 * k for k, t in enumerate(times)]
    alone = [drive(np, t, signal, np.array(1.4)) for t, signal in zip(times, signals, strict=True)]
    together = drive(np, np.concatenate(times), np.concatenate(signals), np.array(1.4))
    np.testing.assert_allclose(together, np.concatenate(alone), rtol=1e-9, atol=1e-9)


def test_a_negative_delay_holds_the_last_sample_and_none_of_the_padding():
    t = jnp.array([0.0, 0.1, 0.2, 0.2, 0.2])
    signal = jnp.array([[1.0], [2.0], [4.0], [jnp.nan], [jnp.nan]])
    np.testing.assert_allclose(delayed(t, signal, jnp.array(-0.05))[:3, 0], [1.5, 3.0, 4.0], rtol=1e-6)
