import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ftbias_jax.logs.health import Extremes, extend, gaps, mask, sample_rate, saturation, stuck_seconds

T = np.arange(1000) * 0.01
NOISE = np.random.default_rng(0).normal(size=1000)


def test_rate_and_gaps():
    t = np.r_[T[:300], T[300:] + 5.0]
    assert sample_rate(t) == pytest.approx(100)
    ((start, length),) = gaps(t)
    assert start == pytest.approx(2.99)
    assert length == pytest.approx(5.01)
    assert gaps(T) == gaps(T[:1]) == gaps(T[:0]) == []
    assert np.isnan(sample_rate(T[:1]))


def test_a_noisy_axis_has_no_trouble():
    assert stuck_seconds(T, NOISE) == 0
    assert np.isnan(saturation(NOISE)).all()


def test_a_stuck_axis_is_timed():
    values = NOISE.copy()
    values[400:700] = values[400]
    values[500] = np.nan  # a missing sample does not set it free
    assert stuck_seconds(T, values) == pytest.approx(2.99)
    assert stuck_seconds(T, np.zeros(1000)) == pytest.approx(9.99)
    assert stuck_seconds(T[:0], NOISE[:0]) == 0


def test_a_clipped_axis_is_found_with_its_limits():
    wave = 3 * np.sin(T) + 0.01 * NOISE
    low, high = saturation(np.clip(wave, -9, 2.5))
    assert np.isnan(low)
    assert high == 2.5
    assert saturation(np.clip(wave, -2.5, 2.5)) == (-2.5, 2.5)


@pytest.mark.parametrize(
    "values", [np.zeros(1000), np.round(NOISE), np.round(3 * np.sin(T)), NOISE[:0], np.full(9, np.nan)]
)
def test_resting_and_coarse_axes_are_not_taken_for_clipped(values):
    assert np.isnan(saturation(values)).all()


@given(
    values=st.lists(st.sampled_from([-2.0, -1.0, 0.0, 0.5, 2.0, np.nan]), max_size=60),
    runs=st.lists(st.integers(1, 12), min_size=60, max_size=60),
    cuts=st.lists(st.integers(0, 300), max_size=5),
)
def test_cutting_an_axis_into_parts_changes_nothing(values, runs, cuts):
    values = np.repeat(values, runs[: len(values)])
    seen = Extremes()
    for part in np.split(values, sorted(cuts)):
        seen = extend(seen, part)
    whole = extend(Extremes(), values)
    np.testing.assert_array_equal(seen, whole)
    if len(measured := values[~np.isnan(values)]):
        assert (seen.low, seen.high) == (measured.min(), measured.max())
        assert (seen.low_count, seen.high_count) == tuple((measured == end).sum() for end in seen[:2])


def test_clipped_samples_are_masked():
    wrench = np.tile(NOISE[:, None], (1, 6))
    wrench[:, 2] = np.clip(3 * np.sin(T) + 0.01 * NOISE, -2.5, 9)
    masked = mask(wrench, [saturation(axis) for axis in wrench.T])
    clipped = wrench == np.where(np.arange(6) == 2, -2.5, np.nan)
    assert clipped.sum() > 50
    np.testing.assert_array_equal(masked, np.where(clipped, np.nan, wrench))
