"""Noise that grows with motion, recovered from scatter that was made with it."""

import numpy as np
import pytest
from made_series import STD, blocks_of

from ftbias_jax.filtering.adapt import vibration
from ftbias_jax.filtering.adapt.blocks import SPEEDS, Blocks
from ftbias_jax.filtering.adapt.scatter import LEAST_LEVEL
from ftbias_jax.filtering.adapt.vibration import fit_vibration
from ftbias_jax.model.motion_noise import effective_speed_squared

COUNT, JOINTS = 2400, 3
PER_SPEED = np.outer([1.0, 0.4, 2.0], 30 * STD**2)


def moving_blocks(rng, variance=None, stated=None, count=COUNT, samples=25):
    """Two minutes of an arm in motion; variance(blocks) is the true one of a sample, by default the stated one."""
    t = 0.05 * np.arange(count)
    rates = rng.uniform(0.3, 1.5, JOINTS)
    velocity = 0.6 * np.sin(t[:, None] * rates + rng.uniform(0, 6, JOINTS)) * (np.sin(0.2 * t)[:, None] > -0.3)
    motion = np.stack([effective_speed_squared(velocity, most) for most in SPEEDS], 1)
    stated = np.broadcast_to(STD**2 if stated is None else stated, (count, 6))
    seen = np.full((count, 6), float(samples))
    blocks = Blocks(t, samples, np.zeros((count, 6)), seen, stated, motion, stated, np.zeros((count, 6)))
    true = stated if variance is None else variance(blocks)
    dof = samples - 2
    return blocks._replace(scatter=true * rng.gamma(dof / 2, 2 / dof, true.shape))


def free(blocks):
    return np.ones(len(blocks.t), bool)


@pytest.mark.parametrize("speed", [None, 0.25, 0.0625])
def test_what_each_joint_adds_and_from_which_speed_on_it_grows_less_are_recovered(speed):
    per_speed = PER_SPEED * (1.0 if speed is None else 0.6 / speed)

    def variance(blocks):
        return blocks.stated + blocks.motion[:, SPEEDS.index(speed)] @ per_speed

    blocks = moving_blocks(np.random.default_rng(0), variance)
    found = fit_vibration(blocks, free(blocks), STD**2)
    assert found.speed == (speed if speed is None else pytest.approx(speed, rel=0.5))
    assert found.gain > 100
    assert all((share == 1).all() for share in found.shares)
    # At high speed the product with the speed is what counts.
    expected = per_speed * (1.0 if speed is None else speed / found.speed)
    np.testing.assert_allclose(found.per_speed, expected, rtol=0.25)
    np.testing.assert_array_equal(found.level, 1)
    np.testing.assert_allclose(found.variance(blocks, STD**2), variance(blocks), rtol=0.15)


def test_it_is_recovered_from_samples_too():
    """Scatter of blocks of Gaussian samples, as ``in_blocks`` cuts them."""
    rng = np.random.default_rng(1)
    t = np.arange(60_000) / 500
    velocity = 0.6 * np.sin(t[:, None] * [0.7, 1.1, 0.4] + [0, 1, 2])
    y = rng.normal(size=(len(t), 6)) * np.sqrt(STD**2 + velocity**2 @ PER_SPEED)
    blocks = blocks_of(t, y, velocity=velocity)
    found = fit_vibration(blocks, free(blocks), STD**2)
    assert found.speed is None
    np.testing.assert_allclose(found.per_speed, PER_SPEED, rtol=0.2)


def test_a_long_log_is_judged_by_some_of_its_blocks(monkeypatch):
    """And all of them are given their variance."""
    monkeypatch.setattr(vibration, "MOST_BLOCKS", 900)
    blocks = moving_blocks(np.random.default_rng(9), lambda blocks: 2 * blocks.stated + blocks.motion[:, 0] @ PER_SPEED)
    found = fit_vibration(blocks, free(blocks), STD**2)
    some = blocks._replace(**{x: getattr(blocks, x)[::3] for x in blocks._fields if x != "size"})
    expected = fit_vibration(some, free(some), STD**2)
    np.testing.assert_array_equal(found.per_speed, expected.per_speed)
    np.testing.assert_allclose(found.level, 2, rtol=0.15)
    assert found.variance(blocks, STD**2).shape == (COUNT, 6)


@pytest.mark.slow
def test_white_noise_does_not_vibrate():
    for seed in range(50):
        blocks = moving_blocks(np.random.default_rng(seed), count=200)
        found = fit_vibration(blocks, free(blocks), STD**2)
        assert not found.per_speed.any()
        assert found.speed is None
        np.testing.assert_array_equal(found.level, 1)
        np.testing.assert_array_equal(found.variance(blocks, STD**2), blocks.stated)


@pytest.mark.parametrize("factor", [0.5, 1.5])
def test_a_level_other_than_stated_is_found(factor):
    """Of the standard deviation; with the vibration on top."""
    blocks = moving_blocks(
        np.random.default_rng(2), lambda blocks: factor**2 * blocks.stated + blocks.motion[:, 0] @ PER_SPEED
    )
    found = fit_vibration(blocks, free(blocks), STD**2)
    np.testing.assert_allclose(np.sqrt(found.level), factor, rtol=0.05)
    np.testing.assert_allclose(found.per_speed, PER_SPEED, rtol=0.15)


def test_an_axis_has_a_level_of_its_own():
    factor = np.array([1, 1, 4, 1, 1, 0.25])
    blocks = moving_blocks(np.random.default_rng(3), lambda blocks: factor * blocks.stated)
    found = fit_vibration(blocks, free(blocks), STD**2)
    np.testing.assert_allclose(found.level, factor, rtol=0.05)
    assert (found.level[[0, 1, 3, 4]] == 1).all()


def test_scatter_without_the_joints_share_does_not_lower_the_level():
    """Of the stated variance three quarters are of the joints, whose errors last longer than a block."""
    blocks = moving_blocks(np.random.default_rng(4), lambda blocks: blocks.stated / 4, stated=4 * STD**2)
    found = fit_vibration(blocks, free(blocks), STD**2)
    np.testing.assert_array_equal(found.level, 1)
    quieter = moving_blocks(np.random.default_rng(4), lambda blocks: blocks.stated / 16, stated=4 * STD**2)
    np.testing.assert_allclose(fit_vibration(quieter, free(quieter), STD**2).level, 0.25, rtol=0.05)


def test_each_part_of_the_stated_variance_has_a_share_of_its_own():
    """A sensor at half its variance, joints at a quarter, and stated vibration that is three times too small."""
    rng = np.random.default_rng(10)
    sensor = STD**2
    still = moving_blocks(rng)
    joints = sensor * (1 + np.sin(still.t)[:, None] ** 2)
    shaking = still.motion[:, 0] @ PER_SPEED
    blocks = still._replace(stated=sensor + joints + shaking, shaking=shaking)
    true = sensor / 2 + 0.25 * joints + 3 * shaking
    blocks = blocks._replace(scatter=true * rng.gamma(23 / 2, 2 / 23, true.shape))
    found = fit_vibration(blocks, free(blocks), sensor, taken=False)
    np.testing.assert_array_equal(found.level, 1)
    np.testing.assert_array_equal(found.variance(blocks, sensor), blocks.stated)
    shown = found.shares.sensor * sensor + found.shares.rest * joints
    shown += blocks.motion[:, SPEEDS.index(found.speed)] @ found.per_speed
    np.testing.assert_allclose(shown, true, rtol=0.15)


def test_more_scatter_than_stated_is_the_sensors():
    """The joints' share stays what it is."""
    blocks = moving_blocks(np.random.default_rng(5), lambda blocks: 1.5 * blocks.stated, 4 * STD**2)
    found = fit_vibration(blocks, free(blocks), STD**2)
    np.testing.assert_allclose(found.level, 3, rtol=0.1)
    np.testing.assert_allclose(found.variance(blocks, STD**2), np.broadcast_to(6 * STD**2, (COUNT, 6)), rtol=0.05)


def test_a_reading_that_stands_still_keeps_some_noise():
    blocks = moving_blocks(np.random.default_rng(6), lambda blocks: 1e-9 * blocks.stated)
    found = fit_vibration(blocks, free(blocks), STD**2)
    np.testing.assert_array_equal(found.level, LEAST_LEVEL)


def test_contacts_and_spikes_do_not_count():
    rng = np.random.default_rng(7)
    blocks = moving_blocks(rng)
    touched = (blocks.t > 30) & (blocks.t < 50)
    scatter = np.where(touched[:, None], 1e4 * blocks.scatter, blocks.scatter)
    scatter[rng.integers(0, COUNT, 10)] *= 1e6
    found = fit_vibration(blocks._replace(scatter=scatter), ~touched, STD**2)
    np.testing.assert_allclose(found.level, 1, atol=0.2)
    assert found.gain < 100


@pytest.mark.parametrize("missing", [[2], list(range(6))])
def test_axes_that_were_never_measured_are_as_stated(missing):
    blocks = moving_blocks(np.random.default_rng(8), lambda blocks: 4 * blocks.stated)
    scatter, count = blocks.scatter.copy(), blocks.count.copy()
    scatter[:, missing], count[:, missing] = np.nan, 0
    found = fit_vibration(blocks._replace(scatter=scatter, count=count), free(blocks), STD**2)
    assert (found.level[missing] == 1).all()
    rest = np.setdiff1d(np.arange(6), missing)
    np.testing.assert_allclose(found.level[rest], 4, rtol=0.05)
    assert not found.per_speed.any()
