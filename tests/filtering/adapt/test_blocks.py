"""Blocks against a straight line fitted to each of them by numpy."""

import numpy as np
import pytest
from made_series import STD, blocks_of, free_motion, stamps

from ftbias_jax.filtering.adapt.blocks import BLOCK_SECONDS, FEWEST, SPEEDS, in_blocks, join_blocks


@pytest.fixture
def log():
    """t, y with holes, velocity and variance of 1003 samples at 250 Hz, with jitter."""
    rng = np.random.default_rng(0)
    t = stamps(1003 / 250, 250) + rng.uniform(-2e-4, 2e-4, 1003)
    y = free_motion(rng, t) + np.sin(3 * t)[:, None]
    y[rng.random(y.shape) < 0.1] = np.nan
    y[24:39, 1] = np.nan  # a block without a sample
    y[39:50, 2] = np.nan  # blocks with few
    y[50:63, 3] = np.nan
    return t, y, rng.normal(size=(len(t), 3)), rng.uniform(1, 2, y.shape) * STD**2


def test_a_block_is_its_mean_and_the_scatter_about_its_straight_line(log):
    t, y, velocity, variance = log
    blocks = in_blocks(*log)
    size = blocks.size
    assert len(blocks.t) == len(t) // size
    assert size == round(BLOCK_SECONDS / np.median(np.diff(t)))
    for k in range(len(blocks.t)):
        rows = slice(k * size, (k + 1) * size)
        assert blocks.t[k] == pytest.approx(t[rows].mean())
        np.testing.assert_allclose(blocks.stated[k], variance[rows].mean(0))
        for s, most in enumerate(SPEEDS):
            speed = np.abs(velocity[rows])
            squared = speed**2 if most is None else speed**2 * np.cos(np.arctan(speed / most))
            np.testing.assert_allclose(blocks.motion[k, s], squared.mean(0))
        for axis in range(6):
            seen = np.isfinite(y[rows, axis])
            x, values = t[rows][seen], y[rows, axis][seen]
            assert blocks.count[k, axis] == len(values)
            if len(values) == 0:
                assert np.isnan(blocks.mean[k, axis])
                continue
            assert blocks.mean[k, axis] == pytest.approx(values.mean())
            if len(values) < 3:
                assert np.isnan(blocks.scatter[k, axis])
                continue
            left = values - np.polyval(np.polyfit(x - x.mean(), values, 1), x - x.mean())
            assert blocks.scatter[k, axis] == pytest.approx((left**2).sum() / (len(values) - 2), rel=1e-9)


def test_the_scatter_of_white_noise_is_its_variance_whatever_the_drift():
    rng = np.random.default_rng(1)
    t = stamps(60, 500)
    blocks = blocks_of(t, free_motion(rng, t) + 50 * t[:, None])
    np.testing.assert_allclose(blocks.scatter.mean(0), STD**2, rtol=0.05)


@pytest.mark.parametrize(("rate", "size"), [(1000, 50), (500, 25), (250, 12), (100, FEWEST), (20, FEWEST)])
def test_a_block_lasts_a_twentieth_of_a_second_but_has_ten_samples(rate, size):
    t = stamps(10, rate)
    blocks = blocks_of(t, np.zeros((len(t), 6)))
    assert blocks.size == size
    assert size / rate == pytest.approx(BLOCK_SECONDS, rel=0.05) or size == FEWEST


def test_a_log_with_nothing_measured_has_blocks_without_a_mean():
    t = stamps(1, 500)
    blocks = blocks_of(t, np.full((len(t), 6), np.nan))
    assert np.isnan(blocks.mean).all()
    assert np.isnan(blocks.scatter).all()
    assert not blocks.count.any()


@pytest.mark.parametrize("length", [0, 1, 2, 9])
def test_a_log_shorter_than_a_block_has_none(length):
    t = stamps(length / 100, 100)
    blocks = blocks_of(t, np.zeros((length, 6)))
    assert blocks.t.shape == (0,)
    assert blocks.mean.shape == (0, 6)
    assert blocks.motion.shape == (0, len(SPEEDS), 2)


def test_blocks_of_parts_are_the_blocks_of_the_whole():
    rng = np.random.default_rng(2)
    t = stamps(5, 500)
    y, velocity, variance = free_motion(rng, t), rng.normal(size=(len(t), 3)), rng.uniform(1, 2, (len(t), 6))
    y[rng.random(y.shape) < 0.1] = np.nan
    whole = in_blocks(t, y, velocity, variance)
    cuts = [slice(0, 1000), slice(1000, 2025), slice(2025, None)]
    joined = join_blocks([in_blocks(t[cut], y[cut], velocity[cut], variance[cut]) for cut in cuts])
    for name in whole._fields:
        np.testing.assert_allclose(getattr(joined, name), getattr(whole, name), rtol=1e-9, atol=1e-15, err_msg=name)
