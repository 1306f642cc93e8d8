"""Jitter is independent from sample to sample; vibration that grows with the motion is not."""

import numpy as np

from ftbias_jax.diagnosis.samples.jitter import correlation_along
from ftbias_jax.diagnosis.thresholds import CORRELATED

T = np.arange(4000) / 500
RATE = np.stack([np.cos(T), np.sin(T), 0.1 * np.ones_like(T)], 1)
"""N/s, rate of change of the wrench of a weight that turns."""
NOISE = np.array([0.02, 0.02, 0.02])


def errors(late):
    """White noise plus the error of samples that are ``late`` (N,) s."""
    return late[:, None] * RATE + np.random.default_rng(1).normal(size=RATE.shape) * NOISE


def test_the_error_of_jitter_is_not_correlated_along_the_change_of_the_wrench():
    late = 0.1 * np.random.default_rng(0).normal(size=len(T))
    assert abs(correlation_along(errors(late), RATE, NOISE)) < 0.1


def test_vibration_along_the_change_of_the_wrench_is_told_from_jitter():
    white = np.random.default_rng(0).normal(size=len(T) + 3)
    vibration = 0.1 * np.convolve(white, np.ones(4) / 2, "valid")
    assert correlation_along(errors(vibration), RATE, NOISE) > CORRELATED


def test_an_arm_at_rest_has_no_error_along_the_change():
    assert correlation_along(errors(np.zeros(len(T))), np.zeros_like(RATE), NOISE) == 0.0
