"""What a filter takes for the noise of a sample, and what its log shows."""

import numpy as np
import pytest
from made_series import STD

from ftbias_jax.filtering.adapt.sample_noise import sample_variance, shown_variance, stated_shaking
from ftbias_jax.filtering.adapt.vibration import Shares, Vibration

VELOCITY, JOINTS, PER_SPEED = 0.2, 3.0, np.outer([1.0, 0, 2.0, 0, 0, 0, 0], STD**2)
MOTION = VELOCITY**2 / np.sqrt(1 + (VELOCITY / 0.1) ** 2) * PER_SPEED.sum(0)


@pytest.fixture
def stated(params):
    return params._replace(bias=params.bias._replace(wrench_variance=STD**2))


def found(level=1.0, sensor=1.0, rest=1.0, per_speed=PER_SPEED, taken=True):
    shares = Shares(np.full(6, sensor), np.full(6, rest))
    return Vibration(np.full(6, level), per_speed, 0.1, 50.0, shares, taken)


def both(stated, noise, variance=STD**2 + JOINTS):
    velocity = np.full((5, 7), VELOCITY)
    variance = np.broadcast_to(variance, (5, 6))
    return [each(stated, noise, variance, velocity)[0] for each in (sample_variance, shown_variance)]


def test_the_filter_takes_what_the_log_shows_but_never_less_than_stated(stated):
    louder, quieter = (both(stated, found(level=level))[0] for level in (2.25, 0.25))
    np.testing.assert_allclose(louder, 2.25 * STD**2 + JOINTS + MOTION, rtol=1e-6)
    np.testing.assert_allclose(quieter, STD**2 + JOINTS + MOTION, rtol=1e-6)


def test_what_the_log_shows_may_be_less(stated):
    _, shown = both(stated, found(sensor=0.5, rest=0.25))
    np.testing.assert_allclose(shown, STD**2 / 2 + JOINTS / 4 + MOTION, rtol=1e-6)


def test_a_sensor_that_an_effect_makes_quieter_leaves_nothing_negative_beside_it(stated):
    _, shown = both(stated, found(sensor=0.5, rest=3.0), STD**2 / 4)
    np.testing.assert_allclose(shown, STD**2 / 2 + MOTION, rtol=1e-6)


def test_a_log_as_stated_shows_what_the_filter_takes(stated):
    taken, shown = both(stated, found())
    np.testing.assert_allclose(taken, shown, rtol=1e-6)


def test_a_log_that_is_too_short_changes_nothing(stated):
    taken, shown = both(stated, None)
    np.testing.assert_array_equal(taken, STD**2 + JOINTS)
    np.testing.assert_array_equal(shown, taken)


def test_what_the_log_shows_of_vibration_replaces_what_is_stated_of_it(stated):
    shaking = stated._replace(bias=stated.bias._replace(vibration=PER_SPEED, vibration_speed=np.asarray(0.1)))
    np.testing.assert_allclose(stated_shaking(shaking, np.full((5, 7), VELOCITY))[0], MOTION, rtol=1e-6)
    assert not stated_shaking(stated, np.full((5, 7), VELOCITY)).any()
    found_more = found(per_speed=2 * PER_SPEED, taken=False)
    taken, shown = both(shaking, found_more, STD**2 + JOINTS + MOTION)
    np.testing.assert_array_equal(taken, STD**2 + JOINTS + MOTION)
    np.testing.assert_allclose(shown, STD**2 + JOINTS + 2 * MOTION, rtol=1e-6)
