"""Stamps that scatter about a steady clock, by the median: gaps count for nothing."""

import numpy as np
import pytest

from ftbias_jax.io.rates import jitter


@pytest.mark.parametrize("std", [1e-3, 3e-3])
def test_the_standard_deviation_of_the_stamps_is_found(std):
    t = np.arange(20_000) * 0.01 + std * np.random.default_rng(0).normal(size=20_000)
    assert jitter(np.sort(t)) == pytest.approx(std, rel=0.1)


def test_a_steady_clock_with_gaps_does_not_jitter():
    t = np.arange(5000) * 0.002
    t[2000:] += 30.0
    t[4000:] += 0.5
    assert jitter(t) == 0
    assert jitter(t + 1e-5 * np.random.default_rng(0).normal(size=5000)) == 0


def test_a_few_stamps_say_nothing():
    assert jitter(np.array([0.0, 1.0, 1.5])) == 0
