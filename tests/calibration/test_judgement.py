"""Criterion of a tuned setup: its errors of predicting the reading, by the same forecast as the filter's."""

from types import SimpleNamespace

import numpy as np
import pytest

from ftbias_jax.calibration.judgement import Predicted, errors_of_constant_bias, held_out, prediction_errors

T = np.arange(50) / 8  # s, exact in binary


def noise(**values):
    return SimpleNamespace(**{"drift_time": None, "correlated_time": None} | values)


def filtered(reading, bias, drift, slow_error, used=None):
    """The filtered log of a weightless tool."""
    shape = (len(T), 6)
    bias, drift, slow_error = (np.broadcast_to(x, shape) for x in (bias, drift, slow_error))
    return SimpleNamespace(
        t=T,
        wrench_tool=np.zeros(shape),
        wrench_unbiased=reading + bias,
        bias=bias,
        drift=drift,
        slow_error=slow_error,
        used=used,
    )


@pytest.mark.parametrize("ahead", [0.5, 2.0])
def test_a_drift_and_a_slow_error_that_go_on_as_they_should_are_predicted(ahead):
    """The drift reverts to zero within 3 s, and the slow error fades within 1.5 s."""
    drift = 0.4 * np.exp(-T / 3)[:, None]
    bias = 1.0 + 3 * (0.4 - drift)
    slow = 2.0 * np.exp(-T / 1.5)[:, None]
    result = filtered(-(bias + slow) * np.ones(6), bias, drift, slow)
    errors = prediction_errors(result, noise(drift_time=np.full(6, 3.0), correlated_time=np.full(6, 1.5)), ahead)
    early = ahead > T
    assert np.isnan(errors[early]).all()
    np.testing.assert_allclose(errors[~early], 0, atol=1e-9)


def test_without_correlated_noise_bias_and_drift_go_on():
    result = filtered(-(0.1 * T[:, None] + np.zeros(6)), 0.1 * T[:, None], 0.1, 0.0)
    np.testing.assert_allclose(prediction_errors(result, noise(), 1.0)[8:], 0, atol=1e-12)


@pytest.mark.parametrize(
    ("used", "judged"),
    [
        ((T <= 0.5) | (T > 3), T > 3),
        (T >= 2, T >= 3),  # nothing is predicted before the first used reading
    ],
)
def test_what_was_not_used_is_not_judged(used, judged):
    result = filtered(np.ones((len(T), 6)), -1.0, 0.0, 0.0, used)
    np.testing.assert_array_equal(np.isfinite(prediction_errors(result, noise(), 1.0)).all(1), judged)


def test_an_axis_is_worse_where_chance_does_not_explain_it():
    predicted = Predicted(1.0, np.ones(6), np.array([1.04, 1.06, 0.5, 1, 2, 1]), np.array([1, 1.02, 0.4, 1, 1, np.nan]))
    assert predicted.worse == ["fy", "ty"]
    assert predicted.constant_better == ["fz", "ty"]


def test_a_constant_bias_is_the_mean_of_what_was_fitted_and_used():
    """Readings are 2 during contact and 5 afterwards; ty is not measured at first."""
    reading = np.where(T > 3, 5.0, np.where(T > 1, 3.0, 2.0))[:, None] * np.ones(6)
    reading[T <= 3, 4] = np.nan
    errors = errors_of_constant_bias(filtered(reading, 0.7, 0.0, 0.0, used=T > 1), T <= 3)
    np.testing.assert_allclose(errors[T > 3][:, [0, 1, 2, 3, 5]], 2.0)
    assert np.isnan(errors[:, 4]).all()


@pytest.mark.parametrize("seconds", [10.0, 400.0])
def test_scores_fall_by_chance_as_often_as_chance_has_it(seconds):
    """A loss must exceed two standard errors, which happens by chance in a fortieth of all cases."""
    rng = np.random.default_rng(3)
    before, tuned = rng.normal(1e4, 20, (2, 4000, 8)) * seconds**0.5
    found = [held_out("joint", np.stack(pair), seconds) for pair in zip(before, tuned, strict=True)]
    (score,) = found[0]
    assert score.part == "joint"
    np.testing.assert_allclose(score.before, before[0].sum() / seconds)
    losses = np.mean([score.falls for (score,) in found])
    assert 0.02 < losses < 0.06  # 0.043 by Student's t with 7 degrees of freedom


def test_a_score_that_falls_everywhere_falls():
    rng = np.random.default_rng(4)
    before = rng.normal(1e4, 20, 8)
    worse, better = held_out("wrench", np.stack([before, before - 12, before + 12]), 8.0)
    assert worse.falls
    assert not better.falls
    assert better.stderr == pytest.approx(0, abs=1e-9)
