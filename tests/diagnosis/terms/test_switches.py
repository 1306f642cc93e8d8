"""Times at which levels change: against a naive search, on synthetic series, and beside a bias."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_states import still_state

from ftbias_jax.diagnosis.terms.phrases import intervals_in_words
from ftbias_jax.diagnosis.terms.switches import PRICE, _suggested, _ways, alternating, changes, lasting

BINS, WIDTH = 2000, 0.01


def naive(x, weight):
    """Change points by dynamic programming over all pairs of rows."""
    n, price = len(x), PRICE * np.log(len(x)) * x.shape[1]

    def cost(first, end):
        w, y = weight[first:end], x[first:end]
        return float((w * (y - (w * y).sum(0) / np.maximum(w.sum(0), 1e-300)) ** 2).sum())

    best, last = [-price], [0]
    for end in range(1, n + 1):
        wander_term = [best[first] + cost(first, end) + price for first in range(end)]
        best.append(min(wander_term))
        last.append(int(np.argmin(wander_term)))
    cuts, end = [], n
    while last[end] > 0:
        end = last[end]
        cuts.append(end)
    return cuts[::-1]


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 3))
def test_changes_are_those_of_a_naive_search(seed, channels):
    rng = np.random.default_rng(seed)
    level = np.repeat(rng.normal(size=(6, channels)), 10, 0) * rng.uniform(1, 20)
    x, weight = (
        level + rng.normal(size=level.shape),
        rng.uniform(0.2, 2, level.shape) * (rng.uniform(size=level.shape) > 0.1),
    )
    assert changes(x, weight).tolist() == naive(x, weight)


def test_noise_and_slow_drift_have_no_changes():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(1000, 6)) + 0.005 * np.cumsum(rng.normal(size=(1000, 6)), 0)
    assert not len(changes(x, np.ones_like(x)))


def test_of_changes_in_one_direction_the_largest_counts():
    assert alternating(np.array([5.0, 7.0, -6.0, 0.5, 6.0, -0.4, -5.0, -7.0]), 3.0).tolist() == [1, 2, 4, 7]


def test_of_brief_changes_the_one_that_lasts_counts():
    """Fingers push a part before they carry it: with more force than its weight, but only briefly."""
    level = np.repeat([0.0, -3.0, 2.0, 9.0, 0.0, 0.5], [40, 5, 100, 3, 40, 60])[:, None]
    cuts = np.flatnonzero(np.diff(level[:, 0])) + 1
    assert lasting(level, np.ones_like(level), cuts, 10).tolist() == [45, 148, 188]
    assert lasting(level, np.ones_like(level), cuts, 0).tolist() == cuts.tolist()
    assert not len(lasting(level, np.ones_like(level), cuts[:0], 10))


@pytest.fixture
def turning():
    """A sensor that turns all the time, with arbitrary places and accelerations."""
    rng = np.random.default_rng(1)
    angle = np.linspace(0, 9, BINS)
    c, s, zero, one = np.cos(angle), np.sin(angle), np.zeros(BINS), np.ones(BINS)
    about_x = np.stack([one, zero, zero, zero, c, -s, zero, s, c], 1).reshape(BINS, 3, 3)
    state = still_state(rng.normal(size=BINS), rng.normal(size=(BINS, 3)))
    return state._replace(t=(np.arange(BINS) + 0.5) * WIDTH, rotation=about_x, acceleration=rng.normal(size=(BINS, 3)))


@pytest.mark.parametrize("name", ["sensor", "force", "torque", "payload"])
def test_what_is_switched_is_found_beside_a_bias(turning, name):
    """The switching times are found to a fraction of a bin, whatever the axes in which the strength is constant."""
    rng = np.random.default_rng(2)
    times = np.array([2.123, 5.0, 9.437, 12.0, 17.5])
    seen = next(one for one in _ways(turning, np.zeros((BINS, 6)), np.ones((BINS, 6))) if one.name == name)
    share = np.clip((turning.t[:, None] - times) / WIDTH + 0.5, 0, 1) @ (-1.0) ** np.arange(5)
    strength = rng.normal(size=seen.axes.shape[2])
    strength *= 8 / np.linalg.norm(strength) / (10 if name == "payload" else 1)
    bias = 20 * rng.normal(size=seen.left.shape[1])
    left = share[:, None] * (seen.axes @ strength) + bias + rng.normal(size=seen.left.shape)
    found = [one for one in _suggested(turning, seen._replace(left=left)) if len(one) == 5]
    assert found
    np.testing.assert_allclose(found[0], times, atol=0.01)


def test_spells_are_told_in_words():
    assert intervals_in_words(np.array(14.2)) == "from 14.2 s on"
    assert intervals_in_words(np.array([1.0, 2.5, 7.0])) == "from 1 to 2.5 s and from 7 s on"
    assert intervals_in_words(np.arange(10.0) ** 2) == "5 times, 1 to 17 s each"
