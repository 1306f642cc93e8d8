import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ftbias_jax.io.health import Axis, Still, extend, gaps, sample_rate

T = np.arange(1000) * 0.01
NOISE = np.random.default_rng(0).normal(size=1000)


def seen_of(values):
    return extend(Axis(), T[: len(values)], values)


def saturation(values):
    return seen_of(values).limits


def test_rate_and_gaps():
    t = np.r_[T[:300], T[300:] + 5.0]
    assert sample_rate(t) == pytest.approx(100)
    ((start, length),) = gaps(t)
    assert start == pytest.approx(2.99)
    assert length == pytest.approx(5.01)
    assert gaps(T) == gaps(T[:1]) == gaps(T[:0]) == []
    assert np.isnan(sample_rate(T[:1]))


def test_a_clipped_axis_is_found_with_its_limits():
    wave = 3 * np.sin(T) + 0.01 * NOISE
    low, high = saturation(np.clip(wave, -9, 2.5))
    assert np.isnan(low)
    assert high == 2.5
    assert saturation(np.clip(wave, -2.5, 2.5)) == (-2.5, 2.5)


@pytest.mark.parametrize(
    "values", [NOISE, np.zeros(1000), np.round(NOISE), np.round(3 * np.sin(T)), NOISE[:0], np.full(9, np.nan)]
)
def test_noisy_resting_and_coarse_axes_are_not_taken_for_clipped(values):
    assert np.isnan(saturation(values)).all()


@given(
    values=st.lists(st.sampled_from([-2.0, -1.0, 0.0, 0.5, np.nan]), max_size=9),
    runs=st.lists(st.integers(1, 300), min_size=9, max_size=9),
    cuts=st.lists(st.integers(0, 3000), max_size=5),
)
def test_cutting_an_axis_into_parts_changes_nothing(values, runs, cuts):
    values = np.repeat(values, runs[: len(values)])
    t = 0.01 * np.arange(len(values))
    seen = Axis()
    for part, stamps in zip(np.split(values, sorted(cuts)), np.split(t, sorted(cuts)), strict=True):
        seen = extend(seen, stamps, part)
    assert seen == extend(Axis(), t, values)
    expected, start = [], None  # a loop over the measured samples
    measured = np.flatnonzero(~np.isnan(values))
    if len(measured):
        assert (seen.low, seen.high) == (np.nanmin(values), np.nanmax(values))
        assert (seen.low_count, seen.high_count) == tuple((values == end).sum() for end in (seen.low, seen.high))
    for place, i in enumerate(measured):
        start = place if start is None or values[i] != values[measured[place - 1]] else start
        if place + 1 == len(measured) or values[measured[place + 1]] != values[i]:
            still = Still(values[i], t[measured[start]], t[i], place - start + 1)
            expected += [still] * bool(still.long)
    assert [*seen.long, *([seen.now] if seen.now.long else [])] == expected


def test_coarse_axes_are_not_taken_for_stuck():
    coarse = np.round(np.r_[0.2 * NOISE[:500], 3 + NOISE[:500]])
    assert extend(Axis(), T, coarse).long
    assert extend(Axis(), T, coarse).stuck == ()
