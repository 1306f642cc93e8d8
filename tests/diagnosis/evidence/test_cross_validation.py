"""Held-out errors, against least squares on the other folds."""

import numpy as np
import pytest
from small_fits import shift, small_fit

from ftbias_jax.diagnosis.evidence.cross_validation import Judge
from ftbias_jax.diagnosis.hypothesis import Hypothesis
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.thresholds import BLOCK_SECONDS, FOLDS

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
    np.testing.assert_allclose(Judge(problem)(fit, fit.error).error, expected, atol=1e-5)


def test_a_fit_is_held_out_once_and_judged_against_any_reference(problem):
    hold_out, fit = Judge(problem), made_up(1)
    worse, better = (hold_out(fit, scale * fit.error) for scale in (2.0, 0.5))
    assert worse.error is better.error
    for held, scale in ((worse, 2.0), (better, 0.5)):
        gain = ((scale * fit.error) ** 2 - held.error**2).sum() / 2
        assert held.nats == pytest.approx(gain / SECONDS, rel=1e-9)
    assert hold_out(made_up(2), fit.error).error is not worse.error
