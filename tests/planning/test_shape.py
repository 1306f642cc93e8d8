import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ftbias_jax.planning.limits import Limits, joint_shares
from ftbias_jax.planning.shape import grid, harmonics_for, motion, motion_at, random_shapes, within

DURATION, HARMONICS = 6.0, 5


def limits(speed=1.0, acceleration=2.0, jerk=15.0, reach=0.7):
    ones = np.ones(2)
    nowhere = (np.zeros((1, 3)), np.array([[-np.inf] * 3, [np.inf] * 3]), np.array([0.0, 0, 1]), -np.inf)
    any_turn = (np.array([0.0, 0, 1]), -np.inf, np.full(6, np.inf))
    return Limits(-reach * ones, 2 * reach * ones, speed * ones, acceleration * ones, jerk * ones, *nowhere, *any_turn)


def test_velocity_acceleration_and_jerk_are_the_derivatives():
    t = np.linspace(0, DURATION, 24_001)
    (coefficients,) = random_shapes(0, 1, 2, HARMONICS)
    _, q, dq, ddq, jerk = motion_at(t, DURATION, np.zeros(2), coefficients)
    for value, slope in ((q, dq), (dq, ddq), (ddq, jerk)):
        differences = np.gradient(value, t, axis=0)[2:-2]
        np.testing.assert_allclose(differences, slope[2:-2], atol=5e-4 * np.abs(slope).max())


def test_it_starts_and_ends_at_rest_in_the_first_pose_without_jerk():
    start = np.array([0.3, -1.0])
    (coefficients,) = random_shapes(1, 1, 2, HARMONICS)
    _, q, *rates = motion_at(np.array([0.0, DURATION]), DURATION, start, coefficients)
    np.testing.assert_allclose(q, [start, start], atol=1e-12)
    np.testing.assert_allclose(rates, 0, atol=1e-9)


def test_pieces_of_a_long_motion_fit_together():
    t = np.linspace(0, DURATION, 20_000)
    (coefficients,) = random_shapes(2, 1, 2, HARMONICS)
    whole = motion(grid(t, DURATION, HARMONICS), coefficients)
    np.testing.assert_allclose(motion_at(t, DURATION, np.zeros(2), coefficients).ddq, whole[2], atol=1e-12)


@given(seed=st.integers(0, 1000), size=st.floats(1e-3, 1e3), start=st.floats(-0.6, 1.3))
def test_whatever_the_numbers_are_joints_keep_to_their_limits(seed, size, start):
    points = grid(np.linspace(0, DURATION, 200), DURATION, HARMONICS)
    pose = np.full(2, start)
    free = size * random_shapes(seed, 1, 2, HARMONICS)[0]
    coefficients, moved = within(points, limits(), pose, free)
    shares = joint_shares(limits(), pose, moved)
    assert shares.max() <= 1
    np.testing.assert_allclose(moved, motion(points, coefficients), atol=1e-12)
    if size == 1e3:
        assert shares.max((0, 1)).min() > 0.8, "a motion that is too large is made as large as it may be"


def test_a_motion_that_is_small_enough_stays_as_it_is():
    points = grid(np.linspace(0, DURATION, 200), DURATION, HARMONICS)
    free = 1e-4 * random_shapes(0, 1, 2, HARMONICS)[0]
    np.testing.assert_array_equal(within(points, limits(), np.zeros(2), free)[0], free)


@pytest.mark.parametrize(("duration", "acceleration", "harmonics"), [(20.0, 2.0, 20), (4.0, 2.0, 4), (300.0, 20.0, 64)])
def test_harmonics_reach_three_times_the_frequency_at_which_speed_and_acceleration_meet(
    duration, acceleration, harmonics
):
    assert harmonics_for(limits(acceleration=acceleration), duration) == harmonics
