"""Comparisons of predictions, on synthetic errors."""

from dataclasses import replace

import numpy as np
import pytest
from made_judged import SEGMENT, T, judged

from ftbias_jax.calibration.judgement import HORIZONS
from ftbias_jax.cli.commands import demo
from ftbias_jax.commissioning.judged import HEAD, compare, judge, table
from ftbias_jax.filtering.samples import FORGOTTEN
from ftbias_jax.model.simulate_log import simulate
from ftbias_jax.setup import parse_setup

SETUP = parse_setup(demo.SETUP)


def test_errors_that_are_smaller_by_more_than_chance_are_better():
    difference = compare(judged(0.9, 1), judged(1.0, 2))
    assert difference.is_better
    assert not difference.is_worse
    assert abs(difference.share - np.log(0.9)) < 4 * difference.stderr
    reverse = compare(judged(1.0, 2), judged(0.9, 1))
    assert reverse.is_worse
    assert not reverse.is_better
    np.testing.assert_allclose((reverse.share, reverse.stderr), (-difference.share, difference.stderr))


def test_the_standard_error_is_that_of_chance():
    """The scatter over draws of errors that are equally large."""
    found = [compare(judged(seed=2 * i), judged(seed=2 * i + 1)) for i in range(60)]
    ratios = [x.share / x.stderr for x in found]
    assert 0.7 < np.std(ratios) < 1.5
    assert sum(x.is_better or x.is_worse for x in found) <= 6


@pytest.mark.parametrize(
    ("new", "costs"),
    [
        ({"used": 0.9}, "fewer samples"),
        ({"inside": 0.7}, "too few readings"),
        ({}, ""),
    ],
)
def test_smaller_errors_are_not_bought_by_leaving_out_or_by_being_sure(new, costs):
    difference = compare(judged(0.5, 1, **new), judged(1.0, 2))
    assert costs in difference.costs
    assert costs in str(difference)
    assert difference.is_better is not bool(costs)
    assert difference.is_worse is bool(costs)


@pytest.mark.parametrize(("size", "better"), [(1.0, True), (1.3, False)])
def test_far_more_samples_are_better_if_the_errors_are_no_larger(size, better):
    """A filter that takes the motion of a wrong tool for contact predicts what is left, at rest, no worse."""
    difference = compare(judged(size, 1), judged(1.0, 2, used=0.3))
    assert difference.is_better is better
    assert "70 % more samples used" in str(difference)
    assert compare(judged(1.0, 2, used=0.3), judged(size, 1)).is_worse


def test_one_bad_stretch_is_no_reason():
    """A single segment decides the mean, which the jackknife detects."""
    old = judged(1.0, 1)
    errors = old.errors.copy()
    errors[:, SEGMENT == 3] *= 3
    assert not compare(old, old._replace(errors=errors)).is_better


def test_only_what_both_used_is_compared():
    old = judged(1.0, 1)
    errors = old.errors.copy()
    errors[:, :100] = np.nan
    difference = compare(old._replace(errors=errors), old)
    assert difference.share == 0
    assert str(difference) == "errors as before"


def test_the_table_has_a_row_for_each_horizon_and_a_dash_for_what_is_not_known():
    nothing = judged()._replace(
        errors=np.full((len(HORIZONS), T, 6), np.nan), inside=np.full((len(HORIZONS), T, 6), np.nan)
    )
    rows = table({"a": judged(2.0), "b": nothing})
    assert [row[:2] for row in rows] == [("a", "1 s"), ("b", "1 s"), ("a", "10 s"), ("b", "10 s")]
    assert all(len(row) == len(HEAD) for row in rows)
    np.testing.assert_allclose([float(x) for x in rows[0][2:8]], 2, rtol=0.1)
    assert set(rows[1][2:8]) == {"-"}
    assert rows[0][8:] == ("95 %", "100 %")


@pytest.mark.slow
def test_to_wait_until_a_lag_is_forgotten_costs_nothing():
    """The first readings contain what the sensor read before the log began; a setup that models this is no worse."""
    lagging = replace(SETUP, effects={"low_pass": {"cutoff": 1.5}})
    log = _cut(simulate(lagging, duration=12, rate=50, seed=3).log, 200)
    without, knowing = (judge(setup, [log], 1.0) for setup in (SETUP, lagging))
    waited = np.isnan(knowing.used)
    assert waited.sum() == pytest.approx(-50 * np.log(FORGOTTEN) / (2 * np.pi * 1.5), abs=1)
    assert waited[: waited.sum()].all()
    assert not compare(knowing, without).costs
    assert compare(knowing, without).share < 0


def _cut(log, first):
    rows = {name: getattr(log, name)[first:] for name in ("q", "dq", "wrench", "temperature")}
    return log._replace(t=log.t[first:] - log.t[first], **rows)


def test_setups_that_leave_out_samples_are_compared_with_those_that_do_not():
    """A setup that models repetitions gives them no weight; they do not count as samples that it leaves out."""
    log = simulate(SETUP, duration=4, rate=50, seed=3).log
    wrench = log.wrench.copy()
    wrench[150:190:2] = wrench[149:189:2]
    log = log._replace(wrench=wrench)
    known = replace(SETUP, effects={"dropped_samples": {"rate": 0.1, "repeated": 1.0}})
    without, knowing = (judge(setup, [log], 0.5) for setup in (SETUP, known))
    assert without.errors.shape == knowing.errors.shape == (len(HORIZONS), 100, 6)
    assert np.isnan(knowing.used).sum() == 20
    assert not np.isnan(without.used).any()
    assert compare(knowing, without).fewer <= 0
    assert np.isfinite(compare(knowing, without).share)
