"""Growth of the noise with the speed of the joints, for noise whose variance is known exactly."""

import numpy as np
import pytest
from scipy.optimize import minimize

from ftbias_jax.diagnosis.samples.growth import measure_growth
from ftbias_jax.diagnosis.samples.variance_fit import fit_variance
from ftbias_jax.model.motion_noise import effective_speed_squared

REST = np.array([0.01, 0.04])
SLOPE = np.array([[0.05, 0.0], [0.2, 0.1], [0.0, 0.3]])


def moving_log(seed, count=6000, rate=100.0):
    """Stamps (N,), speeds (N, 3) with pauses at rest, and normal numbers (N, 2)."""
    rng = np.random.default_rng(seed)
    t = np.arange(count) / rate
    frequency, phase = rng.uniform(0.1, 0.5, 3), rng.uniform(0, 6, 3)
    speed = np.sin(2 * np.pi * frequency * t[:, None] + phase) * (np.sin(0.7 * t[:, None]) > -0.3)
    return t, speed, rng.normal(size=(count, 2))


def growing(speed, white):
    return (REST + speed**2 @ SLOPE) * white**2


def measure(t, squares, speed):
    return measure_growth(t, squares, speed, len(t))


@pytest.mark.parametrize("expected", [None, 0.01])
def test_the_fit_is_the_maximum_of_the_likelihood_and_of_the_prior(expected):
    _, speed, white = moving_log(1, 800)
    design = np.column_stack([np.ones(len(speed)), speed**2])
    squares = growing(speed, np.clip(white, -2.5, 2.5))[:, :1]  # nothing that the fit would consider an event

    def loss(x):
        variance = design @ np.exp(x)
        prior = 2 * np.exp(x[1:]).sum() / expected if expected else 0.0
        return (np.log(variance) + squares[:, 0] / variance).sum() + prior

    best = min((minimize(loss, np.log([0.02, a, b, c])) for a in (0.1, 1e-4) for b in (0.1, 1e-4) for c in (0.1, 1e-4)),
               key=lambda result: result.fun)  # fmt: skip
    found = fit_variance(design, squares, expected=np.array([expected]) if expected else None)
    assert loss(np.log(found[:, 0])) <= best.fun + 0.01


def test_a_joint_that_hardly_moves_is_not_told_to_shake_more_than_the_one_that_moves():
    t, speed, white = moving_log(4)
    both = np.column_stack([speed[:, 0], 0.05 * speed[:, 0]])  # both speeds explain the same
    found = measure(t, (REST + both[:, :1] ** 2 @ SLOPE[1:2]) * white**2, both)
    assert found.detected
    assert (found.variance[1] < SLOPE[1]).all()
    np.testing.assert_allclose(found.variance[0], SLOPE[1], rtol=0.2)


def test_growth_comes_back_within_its_errors_in_nineteen_of_twenty():
    inside, certain = [], 0
    for seed in range(20):
        t, speed, white = moving_log(seed)
        found = measure(t, growing(speed, white), speed)
        certain += found.detected
        assert found.speed is None, seed
        inside.append(np.abs(found.variance - SLOPE) <= 3 * found.stderr + 1e-3)
        np.testing.assert_allclose(found.rest, REST, rtol=0.25)
    assert certain == 20
    assert np.mean(inside) > 0.95


@pytest.mark.parametrize("corner", [0.05, 0.2])
def test_the_speed_from_which_it_grows_with_the_speed_alone_comes_back_within_its_errors(corner):
    inside, of_weights = [], []
    for seed in range(20):
        t, speed, white = moving_log(seed)
        slope = SLOPE / corner
        squares = (REST + effective_speed_squared(speed, corner) @ slope) * white**2
        found = measure(t, squares, speed)
        assert found.speed is not None, seed
        inside.append(abs(found.speed - corner) <= 3 * found.speed_stderr)
        of_weights.append(np.abs(found.variance - slope) <= 3 * found.stderr + 2e-2 / corner)
        assert found.speed_stderr < 0.2
    assert np.mean(inside) >= 0.95
    assert np.mean(of_weights) > 0.95


def test_noise_that_does_not_grow_raises_no_alarm():
    for seed in range(40):
        t, speed, white = moving_log(seed, 4000)
        scale = np.array([0.01, 9.0])
        assert not measure(t, scale * white**2, speed).detected, seed
        heavy = np.random.default_rng(seed).standard_t(4, white.shape)
        assert not measure(t, scale * heavy**2, speed).detected, seed


def test_a_few_wild_samples_neither_make_nor_hide_growth():
    t, speed, white = moving_log(3)
    outlier_rows = np.where(np.random.default_rng(0).random(white.shape) < 2e-3, 1e4, 1.0)
    assert not measure(t, REST * white**2 * outlier_rows, speed).detected
    burst = np.where((t > 20) & (t < 20.3), 1e3, 1.0)[:, None]
    assert not measure(t, REST * white**2 * burst, speed).detected
    found = measure(t, growing(speed, white) * outlier_rows, speed)
    assert found.detected
    np.testing.assert_allclose(found.variance[2, 1], SLOPE[2, 1], rtol=0.3)


def test_the_gain_is_that_of_the_true_variances():
    t, speed, white = moving_log(4, 20000)
    squares, variance = growing(speed, white), REST + speed**2 @ SLOPE
    constant = squares.mean(0)
    expected = ((squares / constant - squares / variance - np.log(variance / constant)) / 2).sum()
    found = measure(t, squares, speed)
    assert found.nats == pytest.approx(expected, rel=0.05)
    assert found.nats_stderr < found.nats / 3


def test_a_joint_that_hardly_moves_and_a_log_at_rest_show_nothing():
    t, speed, white = moving_log(5)
    speed[:, 0] *= 1e-3
    found = measure(t, growing(speed, white), speed)
    assert not found.variance[0].any()
    assert not found.stderr[0].any()
    still = measure(t, REST * white**2, np.zeros_like(speed))
    assert not still.detected
    assert still.variance.shape == (3, 2)


def test_long_logs_are_averaged_and_answer_the_same():
    t, speed, white = moving_log(6, 60000, 1000.0)
    found = measure(t, growing(speed, white), speed)
    np.testing.assert_allclose(found.variance[1:, 1], SLOPE[1:, 1], rtol=0.15)
