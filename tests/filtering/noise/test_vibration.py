"""Noise that grows with motion, recovered from simulated scatter."""

from functools import partial

import jax
import numpy as np
import pytest
from made_series import STD

from ftbias_jax.filtering.noise import vibration
from ftbias_jax.filtering.noise.blocks import Blocks, Layout
from ftbias_jax.filtering.noise.scatter import LEAST_LEVEL
from ftbias_jax.filtering.noise.vibration import (
    Shares,
    Vibration,
    shown_variance,
    stated_shaking,
    taken_level,
    taken_variance,
)
from ftbias_jax.model.motion_noise import effective_speed_squared

COUNT, JOINTS, LAYOUT = 2000, 3, Layout(25, 0.05)
PER_SPEED = np.outer([1.0, 0.4, 2.0], 30 * STD**2)


@partial(jax.jit, static_argnames="taken")
def _fit(blocks, free, sensor, taken=True):
    return vibration.fit_vibration(blocks, LAYOUT, free, sensor, taken)


def fit_vibration(blocks, free, sensor, taken=True):
    return jax.tree.map(np.asarray, _fit(blocks, free, sensor, taken=taken))


def grown(blocks, most=np.inf):
    """(N, n) (rad/s)^2, the effective squared speed with which the noise grows."""
    return effective_speed_squared(np.sqrt(blocks.motion), most)


def moving_blocks(rng, variance=None, stated=None, count=COUNT, samples=25):
    """Blocks of an arm in motion; variance(blocks) is the true one of a sample, by default the stated one."""
    t = 0.05 * np.arange(count)
    rates = rng.uniform(0.3, 1.5, JOINTS)
    velocity = 0.6 * np.sin(t[:, None] * rates + rng.uniform(0, 6, JOINTS)) * (np.sin(0.2 * t)[:, None] > -0.3)
    stated = np.broadcast_to(STD**2 if stated is None else stated, (count, 6))
    seen = np.full((count, 6), float(samples))
    nothing = np.zeros((count, 6))
    blocks = Blocks(t, nothing, seen, stated, velocity**2, stated, nothing, np.asarray(count))
    true = stated if variance is None else variance(blocks)
    dof = samples - 2
    return blocks._replace(scatter=true * rng.gamma(dof / 2, 2 / dof, true.shape))


def free(blocks):
    return np.ones(len(blocks.t), bool)


@pytest.mark.parametrize("speed", [np.inf, 0.25, 0.0625])
def test_what_each_joint_adds_and_from_which_speed_on_it_grows_less_are_recovered(speed):
    per_speed = PER_SPEED * (1.0 if np.isinf(speed) else 0.6 / speed)

    def variance(blocks):
        return blocks.stated + grown(blocks, speed) @ per_speed

    blocks = moving_blocks(np.random.default_rng(0), variance)
    found = fit_vibration(blocks, free(blocks), STD**2)
    assert found.speed == pytest.approx(speed, rel=0.5)
    assert found.gain > 100
    assert all((share == 1).all() for share in found.shares)
    # At high speed only the product with the bend's speed matters.
    expected = per_speed * (1.0 if np.isinf(speed) else speed / found.speed)
    np.testing.assert_allclose(found.per_speed, expected, rtol=0.25)
    np.testing.assert_array_equal(found.level, 1)
    np.testing.assert_allclose(found.variance(blocks, STD**2), variance(blocks), rtol=0.15)


def test_a_long_log_is_judged_by_some_of_its_blocks(monkeypatch):
    """All blocks get their variance nevertheless."""
    monkeypatch.setattr(vibration, "MOST_BLOCKS", 700)
    blocks = moving_blocks(np.random.default_rng(9), lambda blocks: 2 * blocks.stated + blocks.motion @ PER_SPEED)
    found = vibration.fit_vibration(blocks, LAYOUT, free(blocks), STD**2)
    thinned, _, every = vibration._thinned(blocks, free(blocks))
    assert (every, thinned.number) == (3, -(-COUNT // 3))
    np.testing.assert_array_equal(thinned.scatter[: thinned.number], blocks.scatter[::3])
    np.testing.assert_allclose(found.per_speed, PER_SPEED, rtol=0.3)
    np.testing.assert_allclose(found.level, 2, rtol=0.15)
    assert found.variance(blocks, STD**2).shape == (COUNT, 6)


@pytest.mark.slow
def test_white_noise_does_not_vibrate():
    for seed in range(50):
        blocks = moving_blocks(np.random.default_rng(seed), count=200)
        found = fit_vibration(blocks, free(blocks), STD**2)
        assert not found.per_speed.any()
        assert np.isinf(found.speed)
        np.testing.assert_array_equal(found.level, 1)
        np.testing.assert_array_equal(found.variance(blocks, STD**2), blocks.stated)


@pytest.mark.parametrize("factor", [0.25, 2.25, np.array([1, 1, 4, 1, 1, 0.25])], ids=["low", "high", "by axis"])
def test_a_level_other_than_stated_is_found(factor):
    """The level is found beside vibration."""
    blocks = moving_blocks(np.random.default_rng(2), lambda blocks: factor * blocks.stated + blocks.motion @ PER_SPEED)
    found = fit_vibration(blocks, free(blocks), STD**2)
    np.testing.assert_allclose(found.level, np.broadcast_to(factor, 6), rtol=0.1)
    np.testing.assert_allclose(found.per_speed, PER_SPEED, rtol=0.2)


@pytest.mark.parametrize(
    ("share", "level", "rtol"),
    [
        pytest.param(1 / 4, 1, 0, id="scatter without the joints' share does not lower the level"),
        pytest.param(1 / 16, 1 / 4, 0.05, id="less is the sensor's"),
        pytest.param(3 / 2, 3, 0.1, id="and so is more"),
        pytest.param(1e-9, LEAST_LEVEL, 0, id="a reading that stands still keeps some noise"),
    ],
)
def test_the_level_is_the_sensors_alone(share, level, rtol):
    """Three quarters of the stated variance are due to the joints, whose errors last longer than a block."""
    blocks = moving_blocks(np.random.default_rng(4), lambda blocks: share * blocks.stated, stated=4 * STD**2)
    found = fit_vibration(blocks, free(blocks), STD**2)
    np.testing.assert_allclose(found.level, level, rtol=rtol)
    expected = np.broadcast_to((3 + level) * STD**2, (COUNT, 6))
    np.testing.assert_allclose(found.variance(blocks, STD**2), expected, rtol=0.1)


def test_each_part_of_the_stated_variance_has_a_share_of_its_own():
    """A sensor at half its variance, joints at a quarter, and stated vibration that is three times too small."""
    rng = np.random.default_rng(10)
    sensor = STD**2
    still = moving_blocks(rng)
    joints = sensor * (1 + np.sin(still.t)[:, None] ** 2)
    shaking = still.motion @ PER_SPEED
    blocks = still._replace(stated=sensor + joints + shaking, shaking=shaking)
    true = sensor / 2 + 0.25 * joints + 3 * shaking
    blocks = blocks._replace(scatter=true * rng.gamma(23 / 2, 2 / 23, true.shape))
    found = fit_vibration(blocks, free(blocks), sensor, taken=False)
    np.testing.assert_array_equal(found.level, 1)
    np.testing.assert_array_equal(found.variance(blocks, sensor), blocks.stated)
    shown = found.shares.sensor * sensor + found.shares.rest * joints
    shown += grown(blocks, found.speed) @ found.per_speed
    np.testing.assert_allclose(shown, true, rtol=0.15)


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


VELOCITY, OF_JOINTS, GROWTH = 0.2, 3.0, np.outer([1.0, 0, 2.0, 0, 0, 0, 0], STD**2)
MOTION = VELOCITY**2 / np.sqrt(1 + (VELOCITY / 0.1) ** 2) * GROWTH.sum(0)


@pytest.fixture
def stated(params):
    return params.bias._replace(wrench_variance=STD**2)


def shown_by(level=1.0, sensor=1.0, rest=1.0, per_speed=GROWTH, taken=True):
    shares = Shares(np.full(6, sensor), np.full(6, rest))
    return Vibration(np.full(6, level), per_speed, 0.1, 50.0, shares, taken)


def both(stated, noise, variance=STD**2 + OF_JOINTS):
    velocity = np.full((5, 7), VELOCITY)
    variance = np.broadcast_to(variance, (5, 6))
    return [each(stated, noise, variance, velocity)[0] for each in (taken_variance, shown_variance)]


def test_the_filter_takes_what_the_log_shows_but_never_less_than_stated(stated):
    """The log's own estimate may be lower; a sensor that an effect makes quieter leaves no negative variance."""
    as_stated = STD**2 + OF_JOINTS + MOTION
    for level, expected in ((2.25, 2.25 * STD**2 + OF_JOINTS + MOTION), (1.0, as_stated), (0.25, as_stated)):
        np.testing.assert_allclose(both(stated, shown_by(level=level))[0], expected, rtol=1e-6)
    for sensor, rest, variance, expected in (
        (1.0, 1.0, STD**2 + OF_JOINTS, as_stated),
        (0.5, 0.25, STD**2 + OF_JOINTS, STD**2 / 2 + OF_JOINTS / 4 + MOTION),
        (0.5, 3.0, STD**2 / 4, STD**2 / 2 + MOTION),
    ):
        shown = both(stated, shown_by(sensor=sensor, rest=rest), variance)[1]
        np.testing.assert_allclose(shown, expected, rtol=1e-6)


def test_what_the_log_shows_of_vibration_replaces_what_is_stated_of_it(stated):
    shaking = stated._replace(vibration=GROWTH, vibration_speed=np.asarray(0.1))
    np.testing.assert_allclose(stated_shaking(shaking, np.full((5, 7), VELOCITY))[0], MOTION, rtol=1e-6)
    assert stated_shaking(stated, np.full((5, 7), VELOCITY)) is None
    more = shown_by(per_speed=2 * GROWTH, taken=False)
    taken, shown = both(shaking, more, STD**2 + OF_JOINTS + MOTION)
    np.testing.assert_array_equal(taken, STD**2 + OF_JOINTS + MOTION)
    np.testing.assert_allclose(shown, STD**2 + OF_JOINTS + 2 * MOTION, rtol=1e-6)
    np.testing.assert_array_equal(taken_level(more), 1)
