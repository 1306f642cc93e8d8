"""Joint readings that no arm can have are found, and nothing else is."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from ftbias_jax.io import glitches
from ftbias_jax.io.glitches import find_repeats

SECONDS = 12.0
RATES = (50.0, 125.0, 500.0, 1000.0)


def find_jumps(t, x, order=2):
    off, breaks = glitches.find_jumps(t, x, order)
    assert not len(breaks)
    return off


def arm(rate, seed=0, noise=1e-5, joints=3):
    """Times in s, (T, joints) rad of a swinging arm, and its speeds."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, SECONDS, 1 / rate)
    turns, phase, size = rng.uniform(0.5, 3, joints), rng.uniform(0, 6, joints), rng.uniform(0.3, 1, joints)
    q = 1.2 + size * np.sin(turns * t[:, None] + phase) + noise * rng.normal(size=(len(t), joints))
    return t, q, size * turns * np.cos(turns * t[:, None] + phase)


def braking(t):
    """(T, 1) rad of a joint that moves at 1 rad/s and brakes at 10 rad/s^2 to a standstill."""
    return np.cumsum(np.clip(10 * (6 - t), 0, 1))[:, None] * (t[1] - t[0])


@pytest.mark.parametrize("rate", RATES)
@given(seed=st.integers(0, 10**6), noise=st.sampled_from([0.0, 1e-5, 1e-3]), digits=st.sampled_from([2, 3, 5, 12]))
def test_an_arm_that_moves_has_none(rate, seed, noise, digits):
    t, q, dq = arm(rate, seed, noise)
    lost = np.random.default_rng(seed).uniform(size=len(t)) < 0.05
    for x, order in ((np.round(q, digits), 2), (np.round(dq, digits), 1)):
        assert not len(find_jumps(t, x, order))
        assert not len(find_repeats(t, x))
        assert not len(find_jumps(t[~lost], x[~lost], order))
    assert not len(find_jumps(t, (q + np.pi) % (2 * np.pi) - np.pi))  # a wrapped angle
    stepped = q + 0.5 * (t > 7)[:, None]
    off, breaks = glitches.find_jumps(t, stepped)  # a lasting jump may be true
    assert not len(off)
    assert list(breaks) == [np.argmax(t > 7)]


@pytest.mark.parametrize("rate", RATES)
def test_an_arm_that_brakes_to_a_halt_has_none(rate):
    t = np.arange(0, SECONDS, 1 / rate)
    assert not len(find_repeats(t, braking(t)))
    assert not len(find_jumps(t, braking(t)))


@given(
    seed=st.integers(0, 10**6),
    rate=st.sampled_from(RATES),
    row=st.integers(0, 599),
    run=st.sampled_from([1, 2, 5, 20]),
    value=st.sampled_from([0.0, 5.0, -3.0]),
)
def test_readings_of_one_value_between_others_are_found(seed, rate, row, run, value):
    assume(run / rate < 0.2)
    t, q, _ = arm(rate, seed)
    off = np.arange(row, min(row + run, len(t)))
    q[off] = value
    np.testing.assert_array_equal(find_jumps(t, q), off)


@pytest.mark.parametrize(("rate", "size"), [(125.0, 0.02), (500.0, 0.002), (1000.0, 0.001)])
def test_small_jumps_and_speeds_are_found(rate, size):
    t, q, dq = arm(rate, noise=1e-6)
    q[[0, 300, 400, -1], 1] += size
    np.testing.assert_array_equal(find_jumps(t, q), [0, 300, 400, len(t) - 1])
    dq[[300, 400], 2] -= 200 / rate
    np.testing.assert_array_equal(find_jumps(t, dq, order=1), [300, 400])


def test_rows_that_are_not_measured_are_no_rows():
    t, q, _ = arm(250.0)
    q[::3] = np.nan
    q[100] = 9
    np.testing.assert_array_equal(find_jumps(t, q), [100])
    q[::2, 0] = np.nan  # joints may have clocks of their own
    q[401] = [np.nan, 9, np.nan]
    np.testing.assert_array_equal(find_jumps(t, q), [100, 401])
    assert not len(find_jumps(t, np.full_like(q, np.nan)))
    assert not len(find_repeats(t, np.full_like(q, np.nan)))
    assert not len(find_jumps(t[:99], q[20:119]))


@given(seed=st.integers(0, 10**6), rate=st.sampled_from([125.0, 500.0]), run=st.integers(1, 20))
def test_readings_that_are_repeated_in_motion_are_found(seed, rate, run):
    """The repeats are in the middle, at the end, and at the beginning."""
    t, q, _ = arm(rate, seed, noise=0.0)
    beside = (np.abs(np.diff(q[row : row + 5], axis=0)) for row in (run, len(t) - run - 5))
    least = 3 * glitches.HALT / rate**2
    assume(all((steps.min(0) > np.maximum(least, 0.6 * steps.max(0))).any() for steps in beside))  # no joint turns back
    stale = np.r_[1 : run + 1, 500 : 500 + run, len(t) - run : len(t)]
    for first in (499, len(t) - run - 1):
        q[first + 1 : first + run + 1] = q[first]
    q[:run] = q[run]
    np.testing.assert_array_equal(find_repeats(t, q), stale)


def test_an_arm_that_rests_for_long_is_believed():
    t, q, _ = arm(500.0, noise=0.0)
    q[2000:3000] = q[2000]
    assert not len(find_repeats(t, q))
