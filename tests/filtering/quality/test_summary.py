"""Sums over a filtered log against the formulas, however it is cut into parts."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ftbias_jax.filtering.quality import summary
from ftbias_jax.filtering.quality.summary import Summary
from ftbias_jax.filtering.result import Filtered

COUNT = 60


@pytest.fixture(scope="module")
def filtered():
    """Random numbers; one axis is missing for a while, another always."""
    rng = np.random.default_rng(0)
    fields = {name: rng.normal(size=(COUNT, 6)) for name in Filtered._fields}
    fields["t"] = 100 + np.cumsum(rng.uniform(0.01, 0.3, COUNT))
    fields["nis"] = rng.uniform(0, 12, COUNT)
    for name in ("wrench_unbiased", "innovation"):
        fields[name][10:20, 1] = np.nan
        fields[name][:, 4] = np.nan
    return Filtered(**fields)


def test_summary_is_the_formulas_in_a_loop(filtered):
    got = summary.summarise(filtered)
    t, bias, drift, tool, corrected = (
        filtered.t,
        *(getattr(filtered, name) for name in ("bias", "drift", "wrench_tool", "wrench_unbiased")),
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
                now = bias[old[-1], axis] + (t[i] - t[old[-1]]) * drift[old[-1], axis]
                ahead.append((raw[-1] - (tool[i, axis] - now)) ** 2)
        expected = (np.std(raw), np.std(residual), np.sqrt(np.mean(ahead))) if raw else (np.nan,) * 3
        found = [x[axis] for x in (got.raw_std, got.residual_std, got.one_second_rms)]
        np.testing.assert_allclose(found, expected, rtol=1e-12)
    np.testing.assert_allclose(got.mean_nis, filtered.nis.sum() / np.isfinite(corrected).sum())
    assert got.samples == COUNT
    assert got.seconds == t[-1] - t[0]
    np.testing.assert_array_equal([got.bias, got.drift], [bias[-1], drift[-1]])


@given(cuts=st.lists(st.integers(0, COUNT), max_size=6))
def test_cutting_a_result_into_parts_changes_nothing(filtered, cuts):
    tally = summary.start()
    edges = [0, *sorted(cuts), COUNT]
    for first, last in pairwise(edges):
        tally = summary.add(tally, Filtered(*(x[first:last] for x in filtered)))
    whole = summary.summarise(filtered)
    for name in Summary._fields:
        np.testing.assert_allclose(getattr(summary.finish(tally), name), getattr(whole, name), rtol=1e-12)
