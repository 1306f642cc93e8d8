"""Trends beyond scatter over many logs: lines and onsets."""

import numpy as np
import pytest

from ftbias_jax.fleet.alarms import appears, trend

DAY = 86400.0


def histories(kind, count, times, seed=0):
    rng = np.random.default_rng(seed)
    for _ in range(times):
        t, noise = np.sort(rng.uniform(0, 200 * DAY, count)), rng.normal(size=count)
        yield t, np.cumsum(noise) if kind == "walk" else noise


@pytest.mark.parametrize("kind", ["white", "walk"])
@pytest.mark.parametrize("count", [12, 40, 400])
def test_scatter_is_no_trend(kind, count):
    sure = [trend(t, y).is_sure for t, y in histories(kind, count, 200)]
    assert np.mean(sure) <= 0.02


@pytest.mark.parametrize("count", [30, 400])
def test_a_trend_is_found_with_its_slope(count):
    for t, noise in histories("white", count, 20):
        found = trend(t, 3.0 + 0.5 * noise + 0.1 * t / DAY)
        assert found.is_sure
        assert found.slope * DAY == pytest.approx(0.1, abs=5 * found.stderr * DAY)
        assert found.start + found.slope * (t.mean() - found.first) == pytest.approx(
            3.0 + 0.1 * t.mean() / DAY, abs=0.5
        )


def test_the_slope_is_that_of_least_squares():
    ((t, noise),) = histories("white", 40, 1)
    assert trend(t, noise).slope == pytest.approx(np.polyfit(t, noise, 1)[0])


def test_logs_without_a_number_are_left_out_and_few_logs_have_no_trend():
    t = np.arange(20.0)
    y = np.where(t % 2 == 0, np.nan, t)
    assert trend(t, y) is None
    assert trend(t, t).slope == pytest.approx(1.0)
    assert trend(np.zeros(20), t) is None


@pytest.mark.parametrize(
    ("flags", "first"),
    [
        ("00111", 2),
        ("00011", 3),
        ("000001", None),  # a single log
        ("0000010000", None),  # it has disappeared again
        ("11111", None),  # it was always there
        ("00000000010110111", 9),
        ("1", None),
        ("", None),
    ],
)
def test_what_appears_stays_and_was_not_there_before(flags, first):
    assert appears([flag == "1" for flag in flags]) == first


def test_what_comes_and_goes_by_chance_seldom_appears():
    rng = np.random.default_rng(0)
    assert np.mean([appears(rng.random(50) < 0.1) is not None for _ in range(500)]) < 0.05
