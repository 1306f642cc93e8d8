import numpy as np
import pytest

from ftbias_jax.io.draft.evidence import quietest_noise, scatter_in_motion
from ftbias_jax.io.pose import arm_rotations
from ftbias_jax.setup import parse_setup

SETUP = parse_setup({"robot": {"model": "ur5e"}, "sensor": {"noise_std": [0.1, 0.004]}})
NOISE = np.array([0.1, 0.2, 0.3, 0.01, 0.02, 0.03])


def moving(t, seed=0):
    """The weight of a tool while the arm turns throughout, and the sensor's rotations."""
    q = np.random.default_rng(seed).uniform(-1, 1, 6) + np.sin(2.5 * t)[:, None] * [0.3, 0.5, 0.7, 0.9, 1.1, 1.3]
    rotations = arm_rotations(SETUP.robot, SETUP.sensor, q)
    force = 15 * rotations[:, 2]
    return np.hstack([force, np.cross([0, 0, 0.08], force)]), rotations


def test_the_noise_is_that_of_the_quietest_second():
    rng = np.random.default_rng(2)
    t = np.arange(5000) / 500
    wrench = rng.normal(size=(5000, 6)) * NOISE
    wrench[:4000] *= 5  # the robot moves until 8 s
    wrench += np.sin(t)[:, None] * [20, 20, 20, 0.8, 0.8, 0.8]
    unknown = np.full((10000, 3, 3), np.nan)
    np.testing.assert_allclose(quietest_noise(t, wrench, unknown[:5000])[0], NOISE, rtol=0.2)
    repeated = np.repeat(wrench, 2, axis=0)
    np.testing.assert_allclose(quietest_noise(np.arange(10000) / 1000, repeated, unknown)[0], NOISE, rtol=0.2)
    assert quietest_noise(t[:10], wrench[:10], unknown[:10]) is None
    assert quietest_noise(t, np.zeros((5000, 6)), unknown[:5000]) is None


@pytest.mark.parametrize("rate", [5.0, 10.0, 100.0, 500.0])
@pytest.mark.parametrize("smooth", [1, 3])
def test_rest_shows_the_noise_at_every_rate(rate, smooth):
    """Five seconds of rest in the middle of fast motion; the sensor's own filter may have smoothed its noise."""
    t = np.arange(round(40 * rate)) / rate
    wrench, rotations = moving(np.where(t < 15, t, np.maximum(t - 5, 15)))
    white = np.random.default_rng(3).normal(size=(len(t), 6))
    white = np.apply_along_axis(np.convolve, 0, white, np.ones(smooth) / np.sqrt(smooth), "same")
    found, where = quietest_noise(t, wrench + white * NOISE, rotations)
    assert where == "of a usual second at rest"
    np.testing.assert_allclose(found, NOISE, rtol=0.6 if rate < 20 else 0.25)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("rate", [5.0, 10.0, 20.0, 100.0, 500.0])
def test_motion_is_not_noise(rate, seed):
    """The arm never rests: no noise is stated, or the true one."""
    t = np.arange(round(40 * rate)) / rate
    wrench, rotations = moving(t, seed)
    wrench += np.random.default_rng(seed).normal(size=wrench.shape) * 0.01 * NOISE
    found = quietest_noise(t, wrench, rotations)
    assert found is None or ("never at rest" in found[1] and (found[0] < 0.013 * NOISE).all())


def test_single_poses_are_not_noise():
    """Forty poses with one reading each: their weights differ as noise would."""
    rng = np.random.default_rng(4)
    wrench, rotations = moving(rng.uniform(0, 1e3, 40))
    assert quietest_noise(np.arange(40) * 20.0, wrench, rotations) is None


@pytest.mark.parametrize("rate", [50.0, 500.0])
def test_what_motion_adds_to_the_noise_is_measured_in_motion(rate):
    """The arm rests until 10 s, then moves while the tool is shaken by 2 N."""
    rng, t = np.random.default_rng(5), np.arange(round(30 * rate)) / rate
    _, rotations = moving(np.maximum(t, 10))
    std = np.hypot(NOISE[:3], np.where(t > 10, 2.0, 0)[:, None])
    found = scatter_in_motion(t, rng.normal(size=(len(t), 3)) * std, rotations, NOISE[:3])
    assert found == pytest.approx(2.0, rel=0.1)
    still = scatter_in_motion(t[t < 10], rng.normal(size=(len(t), 3))[t < 10], rotations[t < 10], NOISE[:3])
    assert still is None


def test_an_axis_without_readings_has_the_noise_of_its_neighbours():
    t = np.arange(3000) / 500
    wrench = np.random.default_rng(4).normal(size=(3000, 6)) * NOISE
    wrench[:, 5] = np.nan
    unknown = np.full((3000, 3, 3), np.nan)
    found = quietest_noise(t, wrench, unknown)[0]
    np.testing.assert_allclose(found[:5], NOISE[:5], rtol=0.2)
    assert found[5] == pytest.approx(np.mean(found[3:5]), rel=0.05)
    wrench[:, 3:] = np.nan
    assert quietest_noise(t, wrench, unknown) is None
