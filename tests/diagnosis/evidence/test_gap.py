"""The verdict for gaps of every size and causes of every kind, and the verdict of each of several logs."""

import numpy as np
import pytest
from small_fits import residual, shift, small_fit

from ftbias_jax.diagnosis.evidence.gap import least_beside_joints, refit_one_log, verdict_of
from ftbias_jax.diagnosis.problem import Part, Problem
from ftbias_jax.diagnosis.report.sentence import headline
from ftbias_jax.diagnosis.result import Gap


@pytest.fixture
def problem():
    """10,000 bins of one sample each: a gap of 0.1 noise sigmas exceeds chance."""
    bins = 10_000
    ones = np.ones((bins, 6))
    t = 0.01 * np.arange(bins)
    return Problem((), t, np.zeros(bins, int), ones, ones, np.zeros(bins), (t[-1],), np.ones(6), {})


@pytest.mark.parametrize(("variance", "least"), [(0.0, 0.0), (0.2, 0.03), (4.0, 0.09)])
def test_the_less_the_joints_are_known_the_more_must_a_cause_remove(problem, variance, least):
    part = Part(*[None] * 5, coherent=np.full((10_000, 6), variance))
    assert least_beside_joints(problem._replace(parts=(part,))) == pytest.approx(least)
    assert least_beside_joints(problem) == 0.0


def gap(before, after, shrink_stderr=0.01):
    """A gap before and after, in noise sigmas without the noise itself."""
    six = np.ones(6)
    sigmas = (float(np.hypot(1, size)) for size in (before, after))
    return Gap(six, six, six, *sigmas, 1 - after**2 / max(before, 1e-9) ** 2, shrink_stderr)


@pytest.mark.parametrize(
    ("before", "after", "causes", "found", "sure", "verdict"),
    [
        (0.01, 0.01, 0, 0, True, "none"),
        (2.0, 2.0, 0, 0, True, "unknown"),
        (0.01, 0.01, 1, 1, True, "explained"),  # spikes, with a right mean reading
        (2.0, 2.0, 1, 1, True, "unknown"),  # spikes do not explain the mean reading
        (2.0, 0.02, 1, 0, True, "explained"),
        (2.0, 0.02, 1, 0, False, "partly_explained"),
        (2.0, 0.8, 1, 0, True, "partly_explained"),
        (2.0, 0.8, 2, 1, True, "partly_explained"),
        (2.0, 1.9, 1, 0, True, "unknown"),
        (2.0, 1.9, 2, 1, True, "unknown"),
    ],
)
def test_the_verdict(problem, before, after, causes, found, sure, verdict):
    assert verdict_of(problem, gap(before, after), causes, found, sure) == verdict


def test_a_gap_that_the_error_of_the_measured_noise_explains_is_none_but_does_not_close_another(problem):
    """The noise of a short log is known to a few per cent."""
    unsure = problem._replace(noise_stderr=np.full(6, 0.03))
    assert verdict_of(problem, gap(0.2, 0.2), 0, 0, True) == "unknown"
    assert verdict_of(unsure, gap(0.2, 0.2), 0, 0, True) == "none"
    assert verdict_of(unsure, gap(0.3, 0.3), 0, 0, True) == "unknown"
    assert verdict_of(unsure, gap(1.0, 0.13), 1, 0, True) == verdict_of(problem, gap(1.0, 0.13), 1, 0, True)


def test_a_share_within_two_standard_errors_of_zero_explains_nothing(problem):
    assert verdict_of(problem, gap(2.0, 0.8, 0.5), 1, 0, True) == "unknown"
    assert verdict_of(problem, gap(2.0, 0.8, 0.4), 1, 0, True) == "partly_explained"


def test_a_gap_that_closes_by_chance_as_well_is_not_explained(problem):
    """The likelihood supports the cause itself, so it is named; how far the gap shrinks is not known."""
    assert verdict_of(problem, gap(2.0, 0.02, 0.6), 1, 0, True) == "partly_explained"
    assert verdict_of(problem, gap(2.0, 0.02, 0.4), 1, 0, True) == "explained"
    assert verdict_of(problem, gap(2.0, 0.02, 0.6), 0, 0, True, 1) == "partly_explained"


def test_what_single_samples_show_stays_told_where_the_mean_reading_is_not_explained(make_diagnosis):
    (cause,) = make_diagnosis().causes
    spikes = cause._replace(effect="outliers", indistinguishable_from=(), statement="1.9 % of the samples are spikes")
    sentence = headline("unknown", gap(2.0, 2.0), (spikes,))
    assert sentence.startswith("No known effect explains the gap: the error is ")
    assert "Seen in single samples: 1.9 % of the samples are spikes." in sentence


@pytest.mark.parametrize("seed", range(3))
def test_a_logalone_in_is_least_squares_on_its_bins(seed):
    rng = np.random.default_rng(seed)
    columns, error = 30 * rng.normal(size=(2, 60, 6)), rng.normal(size=(60, 6))
    own = np.arange(60) < 25
    alone, gain = refit_one_log(small_fit(columns, error, (3, 1)), own)
    np.testing.assert_allclose(alone.z[[3, 1]], shift(columns[:, own], error[own]), rtol=1e-4)
    left = residual(columns[:, own], error[own])
    assert gain == pytest.approx(((error[own] ** 2).sum() - (left**2).sum()) / 2, rel=1e-4)
    np.testing.assert_array_equal(alone.columns.moving[:, ~own], 0)  # its standard errors are those of this log
