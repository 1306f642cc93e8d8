"""A log of ten million samples in float32: its seven digits lose nothing."""

from functools import partial

import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.filtering.method.by_parts import PART, filter_parts
from ftbias_jax.filtering.method.filter_samples import AS_STATED
from ftbias_jax.filtering.method.ready import result_of
from ftbias_jax.filtering.pipeline import DEFAULT_OPTIONS
from ftbias_jax.filtering.result import named_arrays
from ftbias_jax.io.log import Log
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.setup import parse_setup

BLOCK = PART
SETUP = {
    "robot": {"joints": [{"axis": [0, 0, 1], "point": [0, 0, 0]}], "flange": {"translation": [0, 0, 1]}},
    "sensor": {"noise_std": [0.1, 0.004]},
    "tool": {"mass": 0.7, "center_of_mass": [0, 0, 0.06]},
    "joints": {"process_noise_density": 1.0},
}


def bias_at(t):
    """Slow waves of a tenth of a newton and milli-newton-metres, and offsets."""
    wave = np.sin(2 * np.pi * t[:, None] / [900, 1100, 1300, 700, 1700, 1900])
    return np.repeat([2.0, 0.1], 3) + np.repeat([0.1, 0.005], 3) * wave


def parts(samples, size):
    """A log of a turning vertical joint at 1 kHz, block by block."""
    rng = np.random.default_rng(0)
    for first in range(0, samples, size):
        t = 1e-3 * np.arange(first, min(first + size, samples))
        q = 0.3 * np.sin(0.5 * t)[:, None] + 2e-5 * rng.normal(size=(len(t), 1))
        weight = np.array([0, 0, 0.7 * 9.81, 0, 0, 0])
        wrench = weight - bias_at(t) + np.repeat([0.1, 0.004], 3) * rng.normal(size=(len(t), 6))
        nothing = np.full(len(t), np.nan)
        yield Log(t, q, np.full_like(q, np.nan), wrench, nothing)


def worst(samples, dtype):
    """Largest error of the bias in standard deviations after the first second, and the last standard deviation."""
    params = params_from_setup(parse_setup(SETUP), dtype)
    largest = 0.0
    found = filter_parts(params, partial(parts, samples), np.zeros(1), DEFAULT_OPTIONS, AS_STATED)
    for part in (result_of(*each, None) for each in found[-1]):
        assert part.bias.dtype == dtype
        assert all(np.isfinite(x).all() for x in named_arrays(part).values())
        error = np.abs(part.bias - bias_at(part.t)) / part.bias_std
        largest = max(largest, error[part.t > 1].max(initial=0))
    return largest, part.bias_std[-1]


@pytest.mark.slow
def test_ten_million_samples_in_float32():
    largest, std = worst(10_000_000, jnp.float32)
    settled = worst(20 * BLOCK, jnp.float64)
    assert largest < 8
    np.testing.assert_allclose(std, settled[1], rtol=0.02)


def test_float32_is_as_right_as_float64_for_a_few_blocks():
    (narrow, std), (wide, expected) = (worst(4 * BLOCK, dtype) for dtype in (jnp.float32, jnp.float64))
    assert narrow < 1.2 * wide
    np.testing.assert_allclose(std, expected, rtol=0.02)
