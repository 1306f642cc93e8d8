"""Sums over a filtered log against the formulas, for any partition into parts."""

from dataclasses import replace
from itertools import pairwise

import by_params
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ftbias_jax.filtering.quality import summary
from ftbias_jax.filtering.quality.summary import Summary
from ftbias_jax.filtering.result import ARRAYS, Filtered

COUNT = 60


@pytest.fixture(scope="module")
def filtered():
    """Random numbers; one axis is missing for a while, and another throughout."""
    rng = np.random.default_rng(0)
    fields = {name: rng.normal(size=(COUNT, 6)) for name in ARRAYS}
    fields["t"] = 100 + np.cumsum(rng.uniform(0.01, 0.3, COUNT))
    fields["nis"] = rng.uniform(0, 12, COUNT)
    fields["in_contact"] = np.zeros(COUNT, bool)
    for name in ("wrench_unbiased", "innovation"):
        fields[name][10:20, 1] = np.nan
        fields[name][:, 4] = np.nan
    return Filtered(**fields)


@pytest.fixture(scope="module")
def noise(params):
    """Slow errors on all axes but one, and a drift that reverts on all axes but another."""
    slow = {"correlated_std": np.array([0, 1, 1, 1, 1, 1.0]), "correlated_time": np.linspace(0.5, 3, 6)}
    return params.bias._replace(**slow, drift_time=np.array([2.0, 3, 4, 5, 6, 1e6]))


def summarised(filtered, noise):
    return summary.finish(summary.add(summary.start(), filtered, noise))


def test_summary_is_the_formulas_in_a_loop(filtered, noise):
    got = summarised(filtered, noise)
    t, bias, drift, slow, tool, corrected = (
        filtered.t,
        *(getattr(filtered, name) for name in ("bias", "drift", "slow_error", "wrench_tool", "wrench_unbiased")),
    )
    for axis in range(6):
        raw, residual, ahead = [], [], []
        for i in range(COUNT):
            if np.isnan(corrected[i, axis]):
                continue
            raw.append(corrected[i, axis] - bias[i, axis])
            residual.append(corrected[i, axis] - tool[i, axis])
            old = [j for j in range(COUNT) if t[j] <= t[i] - 1]
            if old:
                then, passed = old[-1], t[i] - t[old[-1]]
                reverts, forgotten = noise.drift_time[axis], noise.correlated_time[axis]
                now = bias[then, axis] + reverts * (1 - np.exp(-passed / reverts)) * drift[then, axis]
                now += np.exp(-passed / forgotten) * slow[then, axis]
                ahead.append((raw[-1] - (tool[i, axis] - now)) ** 2)
        expected = (np.std(raw), np.std(residual), np.sqrt(np.mean(ahead))) if raw else (np.nan,) * 3
        found = [x[axis] for x in (got.raw_std, got.residual_std, got.one_second_rms)]
        np.testing.assert_allclose(found, expected, rtol=1e-9)
    np.testing.assert_allclose(got.mean_nis, filtered.nis.sum() / np.isfinite(corrected).sum())
    assert got.samples == COUNT
    assert got.seconds == t[-1] - t[0]
    np.testing.assert_array_equal([got.bias, got.drift], [bias[-1], drift[-1]])


@given(cuts=st.lists(st.integers(0, COUNT), max_size=6))
def test_cutting_a_result_into_parts_changes_nothing(filtered, noise, cuts):
    tally = summary.start()
    edges = [0, *sorted(cuts), COUNT]
    for first, last in pairwise(edges):
        tally = summary.add(tally, by_params.part_of(filtered, slice(first, last)), noise)
    whole = summarised(filtered, noise)
    for name in Summary._fields:
        np.testing.assert_allclose(getattr(summary.finish(tally), name), getattr(whole, name), rtol=1e-12)


def test_what_the_prior_says_before_any_reading_counts_is_no_prediction(filtered, noise):
    innovation = filtered.innovation.copy()
    innovation[:10] = np.nan
    late = summarised(by_params.part_of(filtered, slice(10, None)), noise)
    got = summarised(replace(filtered, innovation=innovation), noise)
    np.testing.assert_allclose(got.one_second_rms, late.one_second_rms)
    assert got.samples == COUNT


def test_what_the_gate_keeps_out_beside_contact_is_a_finding_about_the_model(filtered, noise):
    innovation, touched = filtered.innovation.copy(), np.zeros(COUNT, bool)
    innovation[30:40], touched[36:] = np.nan, True
    got = summarised(replace(filtered, innovation=innovation, in_contact=touched), noise)
    residual = (filtered.wrench_unbiased - filtered.wrench_tool)[30:36]
    assert (got.gated, got.off) == (10, 6)
    expected = np.sqrt((residual**2).mean(0))
    np.testing.assert_allclose(got.off_rms, expected)
    force, torque = (np.sqrt(np.nansum(x**2)) for x in (expected[:3], expected[3:]))
    words = (
        f"6 samples (10%) outside of contact were rejected by the gate: the model is off by {force:.2g} N, "
        f"{torque:.2g} Nm"
    )
    assert words in summary.format_summary(got)
    touched[30:] = True
    assert "contact?" in summary.format_summary(
        summarised(replace(filtered, innovation=innovation, in_contact=touched), noise)
    )
