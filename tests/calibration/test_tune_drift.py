"""Choice of the drift model for series simulated with one drift, with another, or with none."""

import numpy as np
import pytest
from made_series import STD, gauss_markov, stamps

from ftbias_jax.calibration.tune_drift import HORIZONS, Drift, Series, choose_drift, score
from ftbias_jax.filtering.noise.block_filter import Filtered, Grid, filter_series

STATED, NEVER = 0.01 * STD, np.full(6, np.inf)
EACH = np.arange(6)
BLOCK = STD / 5
SLOW = (np.zeros(6), np.ones(6))
PRIOR = np.concatenate([20 * STD, 0.05 * STD])


def drifting(rng, density, time=np.inf, seconds=300):
    """A series of blocks of 0.3 s whose drift has this (6,) density and this reversion time."""
    t = stamps(seconds, 1 / 0.3)
    kept = np.exp(-0.3 / time)
    drift, bias = np.zeros(6), np.zeros((len(t), 6))
    for k in range(1, len(t)):
        bias[k] = bias[k - 1] + 0.3 * drift
        drift = kept * drift + np.sqrt(0.3) * density * rng.normal(size=6)
    y = bias + BLOCK * rng.normal(size=bias.shape)
    return Series(t, y, np.broadcast_to(BLOCK**2, y.shape), PRIOR)


def chosen(logs, slow=SLOW, fitted=STATED, group=EACH):
    return choose_drift(logs, slow, Drift(STATED, NEVER), fitted, group)


def test_a_right_drift_stays_and_a_much_stronger_one_is_found():
    found = chosen([drifting(np.random.default_rng(0), STATED)])
    assert (found.density == STATED).sum() >= 5
    assert np.isinf(found.time[found.density == STATED]).all()
    found = chosen([drifting(np.random.default_rng(1), 30 * STATED)], fitted=30 * STATED)
    assert (found.density > 5 * STATED).all()


def test_a_drift_that_reverts_is_found_and_forecasts_better():
    series = drifting(np.random.default_rng(2), 100 * STATED, time=10.0)
    found = chosen([series], fitted=100 * STATED)
    assert np.isfinite(found.time).all()
    pair = Drift(*(np.stack(x) for x in zip(found, (100 * STATED, NEVER), strict=True)))
    reverting, never = score([series], SLOW, pair).squares[1]
    assert (reverting < never).all()


def test_slow_errors_do_not_make_a_drift():
    """A random walk would be likelier than constant bias with white noise, but would forecast worse."""
    rng = np.random.default_rng(3)
    series = drifting(rng, 0 * STD)
    series = series._replace(y=series.y + gauss_markov(rng, series.t, 2 * STD, 3.0))
    found = chosen([series], fitted=100 * STATED)
    before, after = (score([series], SLOW, Drift(x.density[None], x.time[None])) for x in (Drift(STATED, NEVER), found))
    assert (after.squares <= before.squares).all()


def test_what_is_expected_ahead_is_what_results_of_a_filter_forecast():
    """Forecasts improve with the slow error that a filter separates from the bias, decaying with its time constant."""
    rng = np.random.default_rng(6)
    series = drifting(rng, STATED)
    series = series._replace(y=series.y + gauss_markov(rng, series.t, 2 * STD, 3.0))
    slow, stated = (2 * STD, np.full(6, 3.0)), Drift(STATED[None], NEVER[None])
    known = score([series], slow, stated)
    t, y = series.t, series.y
    grid = Grid(np.ones((1, 6)), slow[0][None], slow[1][None])
    found = filter_series(t, y, series.variance, grid, PRIOR.reshape(2, 6), STATED)
    steps = [Filtered(*step) for step in zip(*found, strict=True)]
    half = np.median(np.diff(t)) / 2
    for ahead, squares in zip(HORIZONS, known.squares, strict=True):
        errors = []
        for now in range(len(t)):
            then = [k for k in range(now + 1) if t[k] <= t[now] - ahead]
            if then:
                state = steps[then[-1]]
                expected = state.bias + ahead * state.drift + np.exp(-(ahead - half) / 3.0) * state.slow
                errors.append(y[now] - expected[0])
        np.testing.assert_allclose(squares[0], np.mean(np.square(errors), 0), rtol=1e-6)
    assert (known.squares[0] < score([series], SLOW, stated).squares[0]).all()


def test_axes_of_a_group_are_decided_together():
    density = STATED * np.array([1, 1, 100, 1, 1, 1])
    found = chosen([drifting(np.random.default_rng(4), density)], fitted=density, group=EACH * 2 // 6)
    assert len(set(found.density[:3] / STATED[:3] * (found.density[:3] != density[:3]))) <= 2
    np.testing.assert_array_equal(found.density[3:], STATED[3:])


@pytest.mark.parametrize("missing", [[2], [0, 4]])
def test_axes_that_were_never_measured_keep_what_is_stated(missing):
    series = drifting(np.random.default_rng(5), 30 * STATED)
    y = series.y.copy()
    y[:, missing] = np.nan
    found = chosen([series._replace(y=y)], fitted=30 * STATED)
    np.testing.assert_array_equal(found.density[missing], STATED[missing])
