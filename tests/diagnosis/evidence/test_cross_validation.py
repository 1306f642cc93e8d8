"""Held-out errors, against least squares on the other folds."""

import numpy as np
import pytest
from small_fits import shift, small_fit

from ftbias_jax.diagnosis.evidence.gap import (
    CrossValidation,
    excess_by_chance,
    excess_by_channel,
    excess_by_size,
    excess_over_quiet,
)
from ftbias_jax.diagnosis.hypothesis import Hypothesis
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.thresholds import BLOCK_SECONDS, FOLDS, LEAST_SIGMAS

BINS, SECONDS = 240, 24.0


@pytest.fixture(scope="module")
def problem():
    t = np.linspace(0, SECONDS, BINS, endpoint=False)
    return Problem((), t, np.zeros(BINS), np.ones((BINS, 6)), np.ones((BINS, 6)), t, (SECONDS,), np.ones(6), {})


def made_up(seed, local=False):
    rng = np.random.default_rng(seed)
    columns, error = 30 * rng.normal(size=(3, BINS, 6)), rng.normal(size=(BINS, 6))
    hypothesis = Hypothesis("contact" if local else "tool_com", local=local)
    return small_fit(columns, error, (0, 1, 2), (hypothesis,))


@pytest.mark.parametrize("local", [False, True])
def test_each_fold_is_told_by_the_others(problem, local):
    fit = made_up(0, local)
    fold = (np.arange(BINS) if local else (problem.t // BLOCK_SECONDS).astype(int)) % FOLDS
    expected = fit.error.copy()
    for k in range(FOLDS):
        others = shift(fit.columns.moving[:, fold != k], fit.error[fold != k])
        expected[fold == k] += np.tensordot(others, fit.columns.moving[:, fold == k], 1)
    np.testing.assert_allclose(CrossValidation(problem)(fit, fit.error).error, expected, atol=1e-5)


def test_a_fit_is_held_out_once_and_judged_against_any_reference(problem):
    hold_out, fit = CrossValidation(problem), made_up(1)
    worse, better = (hold_out(fit, scale * fit.error) for scale in (2.0, 0.5))
    assert worse.error is better.error
    for held, scale in ((worse, 2.0), (better, 0.5)):
        gain = ((scale * fit.error) ** 2 - held.error**2).sum() / 2
        assert held.nats == pytest.approx(gain / SECONDS, rel=1e-9)
    assert hold_out(made_up(2), fit.error).error is not worse.error


def test_what_acts_in_one_block_is_gained_surely_where_the_prediction_was_right(problem):
    """The gain scatters over blocks as much as it can, but noise contributes hardly anything to this scatter."""
    error = np.random.default_rng(3).normal(size=(BINS, 6))
    there = (problem.t < BLOCK_SECONDS)[:, None]
    held = CrossValidation(problem)(small_fit(np.zeros((0, BINS, 6)), error, ()), error + 20.0 * there)
    assert held.nats < 2 * held.nats_stderr
    assert held.nats > 10 * held.nats_by_noise


def test_what_happens_in_one_block_is_not_gained_surely_by_a_prediction_of_a_part_of_it(problem):
    error = np.random.default_rng(4).normal(size=(BINS, 6)) + 20.0 * (problem.t < BLOCK_SECONDS)[:, None]
    held = CrossValidation(problem)(small_fit(np.zeros((0, BINS, 6)), error, ()), 1.1 * error)
    assert 0 < held.nats < 2 * held.nats_by_noise


def test_the_gain_of_a_wrong_prediction_moves_by_chance_as_noise_moves_it(problem):
    """On noise alone, a prediction of size s has a gain with the standard error sqrt(s^2)."""
    rng = np.random.default_rng(5)
    change = 0.3 * rng.normal(size=(BINS, 6))
    made = []
    for _ in range(200):
        error = rng.normal(size=(BINS, 6))
        held = CrossValidation(problem)(small_fit(np.zeros((0, BINS, 6)), error, ()), error + change)
        made.append((held.nats, held.nats_by_noise))
    gains, chances = np.transpose(made)
    assert np.sqrt((chances**2).mean()) == pytest.approx(gains.std(), rel=0.15)


def test_the_excess_scatters_as_the_innovations_and_the_measured_noise_do(problem):
    """Bins with the noise's own size, against the scatter of the excess over many logs."""
    rng, samples = np.random.default_rng(6), 300
    logs = []
    for _ in range(400):
        measured = rng.chisquare(samples, 6) / samples
        logs.append(excess_by_channel(problem, rng.normal(size=(BINS, 6)) / np.sqrt(measured)).mean())
    known = problem._replace(noise_stderr=np.full(6, np.sqrt(1 / (2 * samples))))
    assert np.hypot(excess_by_chance(known), excess_by_size(known)) == pytest.approx(np.std(logs), rel=0.12)
    assert excess_by_chance(known) < 0.85 * np.std(logs)


@pytest.mark.parametrize(
    ("first_block", "elsewhere", "left"),
    [
        pytest.param(3.8, 0.2, 3.6 / 12, id="one block shows though the joints are known better than believed"),
        pytest.param(2.0, 1.5, 0.5 + 0.5 / 12, id="what is left everywhere is no less for that"),
    ],
)
def test_what_is_left_over_quiet_bins(problem, first_block, elsewhere, left):
    """Squares of 1 are expected; channels that were never measured have no excess."""
    error = np.sqrt(np.where(problem.t < BLOCK_SECONDS, first_block, elsewhere)[:, None] * np.ones(6))
    assert (excess_by_channel(problem, error) < 0).all() == (elsewhere < 1)
    np.testing.assert_allclose(excess_over_quiet(problem, error), left)
    blind = problem._replace(samples=problem.samples * [1, 1, 1, 1, 1, 0])
    np.testing.assert_allclose(excess_over_quiet(blind, error), [*[left] * 5, 0], atol=1e-9)


def test_noise_alone_leaves_less_than_an_owner_would_see(problem):
    """The median of chi-squared is below its mean: the floor must not turn noise into a gap."""
    bins = problem._replace(samples=25 * problem.samples, variance=problem.variance / 25)
    error = np.random.default_rng(5).normal(size=(200, BINS, 6))
    left = np.mean([np.maximum(excess_over_quiet(bins, e), 0).mean() for e in error])
    assert left < LEAST_SIGMAS**2
