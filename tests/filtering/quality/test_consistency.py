"""Judgement of error bars: bounds against scipy, and innovations that are right, too large, too small or not white."""

import numpy as np
import pytest
import scipy.stats

from ftbias_jax.filtering.quality import consistency

WHITE = np.random.default_rng(0).normal(size=(5000, 6))


@pytest.mark.parametrize("dof", [30, 300, 30_000])
@pytest.mark.parametrize("probability", [0.025, 0.5, 0.975])
def test_quantiles(probability, dof):
    expected = scipy.stats.chi2.ppf(probability, dof)
    np.testing.assert_allclose(consistency.chi_square_quantile(probability, dof), expected, rtol=1e-3)


def test_averages_of_chi_square_variables_lie_inside_their_bounds_95_times_in_100():
    squares = np.random.default_rng(1).chisquare(12, size=(2000, 40))
    inside = [consistency.mean_chi_square(row, 12).consistent for row in squares]
    np.testing.assert_allclose(np.mean(inside), 0.95, atol=4 * np.sqrt(0.95 * 0.05 / 2000))


def checked(white, scale=1.0):
    """Check of innovations, (T, 6) in standard deviations of a filter that states them ``scale`` times too small."""
    return consistency.check(0.1 * white, (scale * white) ** 2)


@pytest.mark.parametrize(("scale", "word"), [(1.0, "consistent"), (1.2, "overconfident"), (0.8, "underconfident")])
def test_white_innovations_of_the_stated_size_and_of_another(scale, word):
    found = checked(WHITE, scale)
    np.testing.assert_allclose(found.nis.value, scale**2 * (WHITE**2).mean())
    np.testing.assert_allclose(found.axis_nis, scale**2 * (WHITE**2).mean(0))
    assert found.nis.consistent == (scale == 1)
    assert consistency.verdict(found).startswith(word)
    np.testing.assert_allclose(found.lag_one_bound, 1.96 / np.sqrt(5000))
    assert (np.abs(found.lag_one) < 2 * found.lag_one_bound).all()
    # 20 squared normal variables over 20
    assert ((found.ljung_box > 0.3) & (found.ljung_box < 2)).all()


def test_innovations_of_the_right_size_that_hang_together():
    slow = np.empty_like(WHITE)
    slow[0] = WHITE[0]
    for i in range(1, len(WHITE)):
        slow[i] = 0.3 * slow[i - 1] + np.sqrt(1 - 0.09) * WHITE[i]
    found = checked(slow / slow.std(0))
    np.testing.assert_allclose(found.lag_one, 0.3, atol=0.05)
    assert (found.ljung_box > 10).all()
    assert "not white" in consistency.verdict(found)


def test_what_was_not_measured_is_left_out():
    """One axis has half the rate, and one is missing."""
    white = WHITE.copy()
    white[::2, 1] = white[:, 4] = np.nan
    found = checked(white)
    half = white[1::2, 1]
    np.testing.assert_allclose(found.axis_nis[1], (half**2).mean())
    np.testing.assert_allclose(found.lag_one[1], half[1:] @ half[:-1] / (half @ half))
    np.testing.assert_allclose(found.lag_one_bound[1], 1.96 / np.sqrt(2500))
    assert np.isnan([found.axis_nis[4], found.lag_one[4], found.ljung_box[4]]).all()
    np.testing.assert_allclose(found.nis.value, np.nanmean(white**2))
    assert consistency.verdict(found).startswith("consistent")
