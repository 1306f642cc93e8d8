"""Recurrences against loops over the samples, and a swinging mass against its differential equation."""

import numpy as np
import pytest

from ftbias_jax.model.effects.responses import low_passed, recurrence, swing


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
