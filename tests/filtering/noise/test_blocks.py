"""Blocks against a straight line that numpy fits to each of them."""

import numpy as np
import pytest
from made_series import STD, blocks_of, cut, free_motion, stamps

from ftbias_jax.filtering.noise.blocks import (
    BESIDE,
    BLOCK_SECONDS,
    FEWEST,
    Layout,
    jumps_in,
    layout_of,
    nan_median,
    without_jumps,
)

LAYOUT = Layout(12, 0.048)
"""Layout of a log at 250 Hz."""


@pytest.fixture
def log():
    """t, y with holes, velocity and variance of 1003 samples at 250 Hz, with jitter."""
    rng = np.random.default_rng(0)
    t = stamps(1003 / 250, 250) + rng.uniform(-2e-4, 2e-4, 1003)
    y = free_motion(rng, t) + np.sin(3 * t)[:, None]
    y[rng.random(y.shape) < 0.1] = np.nan
    y[24:39, 1] = np.nan  # a block without a sample
    y[39:50, 2] = np.nan  # blocks with few samples
    y[50:63, 3] = np.nan
    return t, y, rng.normal(size=(len(t), 3)), rng.uniform(1, 2, y.shape) * STD**2


def test_a_block_is_its_mean_and_the_scatter_about_its_straight_line(log):
    t, y, velocity, variance = log
    blocks, size = cut(LAYOUT, *log), LAYOUT.size
    assert layout_of(np.diff(stamps(4, 250))) == LAYOUT
    assert len(blocks.t) == blocks.number == len(t) // size
    for k in range(len(blocks.t)):
        rows = slice(k * size, (k + 1) * size)
        assert blocks.t[k] == pytest.approx(t[rows].mean())
        np.testing.assert_allclose(blocks.stated[k], variance[rows].mean(0))
        np.testing.assert_allclose(blocks.motion[k], (velocity[rows] ** 2).mean(0))
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


@pytest.mark.parametrize(("rate", "size"), [(1000, 50), (500, 25), (250, 12), (100, FEWEST), (20, FEWEST)])
def test_a_block_lasts_a_twentieth_of_a_second_but_has_ten_samples(rate, size):
    t = stamps(10, rate)
    layout = layout_of(np.diff(t))
    assert layout.size == size
    assert layout.seconds == pytest.approx(size / rate, rel=0.05)
    assert size / rate == pytest.approx(BLOCK_SECONDS, rel=0.05) or size == FEWEST


def test_padding_makes_no_block(log):
    t, y, velocity, variance = log
    whole = cut(LAYOUT, *log)
    longer = [np.concatenate([x, np.repeat(x[-1:], 500, 0)]) for x in (t, y, velocity, variance)]
    found = cut(LAYOUT, *longer, length=len(t))
    number = len(t) // LAYOUT.size
    assert found.number == number
    for name in ("t", "mean", "count", "scatter", "motion", "stated"):
        np.testing.assert_allclose(getattr(found, name)[:number], getattr(whole, name), rtol=1e-9, err_msg=name)
    assert np.isnan(found.mean[number:]).all()
    assert not found.count[number:].any()


def test_jumps_where_the_sensor_was_set_to_zero_are_taken_out():
    """The reference is the series without jumps; a block with samples of both sides is not used."""
    rng = np.random.default_rng(3)
    t = stamps(20, 500)
    y = free_motion(rng, t)
    at = [4.01, 4.9, 13.0]
    jumped = y + sum(10 * STD * rng.normal(size=6) * (t >= time)[:, None] for time in at)
    rezeroed = np.isin(np.arange(len(t)), np.searchsorted(t, at)).astype(float)
    blocks, layout = blocks_of(t, jumped)
    mean = np.asarray(without_jumps(blocks, jumps_in(layout, rezeroed)).mean)
    expected = np.asarray(blocks_of(t, y)[0].mean)
    for time in at:
        assert np.isnan(mean[int(time / layout.seconds)]).all()
    seen = np.isfinite(mean).all(1)
    assert seen.sum() == len(mean) - 3
    np.testing.assert_allclose(mean[seen], expected[seen], atol=6 * STD.max() / np.sqrt(layout.size * BESIDE / 2))


def test_the_median_is_that_of_numpy():
    x = np.random.default_rng(4).normal(size=(31, 6))
    x[np.random.default_rng(5).random(x.shape) < 0.3] = np.nan
    x[:, 2] = np.nan
    with np.errstate(all="ignore"), pytest.warns(RuntimeWarning):
        expected = np.nanmedian(x, 0)
    np.testing.assert_array_equal(nan_median(x), expected)
    np.testing.assert_array_equal(nan_median(x[:30, 3]), np.nanmedian(x[:30, 3]))
