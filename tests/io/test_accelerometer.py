"""Calibration errors of an accelerometer, from gravity where the sensor rests between motions."""

import numpy as np
import pytest

from ftbias_jax.io.accelerometer import calibrate_accelerometer

RATE, DURATION = 250, 20.0
GAINS = np.array([[0.02, 0.01, 0.0], [-0.01, -0.015, 0.02], [0.0, 0.01, 0.025]])
OFFSET = np.array([0.3, -0.2, 0.15])


def log_of(seed, *, restless=False):
    """Stamps, specific force of an ideal accelerometer, and minus gravity, for turns between rests."""
    rng, t = np.random.default_rng(seed), np.arange(int(RATE * DURATION)) / RATE
    path = np.clip(t[:, None] % 4 - 1, 0, 2) / 2 + t[:, None] // 4  # a second of rest, two of motion, a second of rest
    moves = np.ones_like(path) if restless else (t[:, None] % 4 > 1) & (t[:, None] % 4 < 3)
    angles = path * rng.uniform(0.5, 1.5, 2)
    (a, b), (ca, cb) = np.sin(angles).T, np.cos(angles).T
    against = 9.81 * np.stack([a, -ca * b, ca * cb], 1)
    phase, size = rng.uniform(0, 2 * np.pi, 3), rng.uniform(0.3, 2, 3)
    motion = moves * size * np.cos(rng.uniform(3, 9, 3) * t[:, None] + phase)
    return t, against + motion + 0.05 * rng.standard_normal(against.shape), against


@pytest.mark.parametrize("seed", range(5))
def test_offset_and_gains_are_taken_off_within_their_standard_deviation(seed):
    t, force, against = log_of(seed)
    off = OFFSET + against @ GAINS.T
    found = calibrate_accelerometer(t, force + off, against)
    assert (np.abs(found.correction - off) < 4 * found.std).all()
    assert (found.std < 0.1).all()
    assert np.abs(found.correction - off).max() < 0.3 * np.abs(off).max()


@pytest.mark.parametrize("restless", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_a_right_accelerometer_is_left_alone(seed, restless):
    t, force, against = log_of(seed, restless=restless)
    found = calibrate_accelerometer(t, force, against)
    assert not found.correction.any()
    assert (found.std > 0).all()


@pytest.mark.parametrize(
    "spoil",
    [lambda force: force / 9.81, lambda force: -force, lambda force: force[:, [1, 0, 2]]],
    ids=["in g", "other sign", "axes exchanged"],
)
def test_a_mistake_of_units_or_axes_is_not_calibrated_away(spoil):
    t, force, against = log_of(0)
    assert calibrate_accelerometer(t, spoil(force), against) is None


def test_a_second_tells_nothing():
    t, force, against = (x[:RATE] for x in log_of(0))
    assert calibrate_accelerometer(t, force, against) is None
