"""Slow errors of made-up series against textbook filters, and recovered from what was put in."""

import numpy as np
import pytest
from made_series import STD, gauss_markov, stamps

from ftbias_jax.filtering.adapt import slow_noise
from ftbias_jax.filtering.adapt.slow_noise import Grid, coarser, fit_slow_noise, innovations, log_likelihoods

PRIOR = np.concatenate([20 * STD, 0.05 * STD])
DENSITY = 0.01 * STD
BLOCK = STD / 5
"""Standard deviation of the mean of 25 samples."""


def bias_course(rng, t):
    """(T, 6) a sample path of the bias."""
    dt = np.diff(t, prepend=t[0])[:, None]
    drift = PRIOR[6:] * rng.normal(size=6) + np.cumsum(np.sqrt(dt) * DENSITY * rng.normal(size=(len(t), 6)), 0)
    return PRIOR[:6] * rng.normal(size=6) + np.cumsum(dt * drift, 0)


def fit(t, y, std=BLOCK):
    return fit_slow_noise(t, y, np.broadcast_to(std**2, y.shape), DENSITY, PRIOR)


@pytest.fixture
def short():
    """30 blocks at uneven times with holes, their variances, and a grid of 3 sets."""
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.uniform(0.03, 0.3, 30))
    y = bias_course(rng, t) + STD * rng.normal(size=(30, 6))
    y[rng.random(y.shape) < 0.2] = np.nan
    y[7] = np.nan
    variance = np.where(np.isfinite(y), rng.uniform(0.5, 2, y.shape) * BLOCK**2, np.nan)
    grid = Grid(rng.uniform(1, 4, (3, 6)), rng.uniform(0, 3, (3, 6)) * STD, rng.uniform(0.1, 5, (3, 6)))
    return t, y, variance, grid


def textbook(linear_gaussian, short, g, axis):
    """One axis and one set of parameters as matrices; the state is (bias, drift, noise)."""
    t, _, variance, grid = short
    q, std, time = DENSITY[axis] ** 2, grid.std[g, axis], grid.time[g, axis]
    A, Q = [], []
    for h in np.diff(t, prepend=t[0]):
        kept = np.exp(-h / time)
        A.append([[1, h, 0], [0, 1, 0], [0, 0, kept]])
        Q.append([[h**3 / 3 * q, h**2 / 2 * q, 0], [h**2 / 2 * q, h * q, 0], [0, 0, std**2 * (1 - kept**2)]])
    R = grid.white[g, axis] * np.nan_to_num(variance[:, axis])[:, None, None]
    P = np.diag([PRIOR[axis] ** 2, PRIOR[6 + axis] ** 2, std**2])
    return linear_gaussian(np.array(A), np.array(Q), np.array([[1.0, 0, 1]]), R, np.zeros(3), P)


def test_likelihoods_are_those_of_the_one_normal_distribution_of_all_blocks(linear_gaussian, short):
    nats = log_likelihoods(*short, PRIOR.reshape(2, 6), DENSITY)
    for g in range(3):
        for axis in range(6):
            y = short[1][:, axis]
            exact = textbook(linear_gaussian, short, g, axis).log_density(y[:, None])
            constant = np.isfinite(y).sum() * np.log(2 * np.pi) / 2
            assert nats[g, axis] - constant == pytest.approx(exact, rel=1e-9)


def test_innovations_are_those_of_a_filter_in_matrices(linear_gaussian, short):
    y = short[1]
    found = list(innovations(*short, PRIOR.reshape(2, 6), DENSITY))
    for g, axis in ((0, 0), (1, 4), (2, 2)):
        model = textbook(linear_gaussian, short, g, axis)
        x, P = model.mean, model.covariance
        filtered = list(zip(*model.filtered(y[:, axis, None]), strict=True))
        for k, (v, s) in enumerate(found):
            x, P = model.A[k] @ x, model.A[k] @ P @ model.A[k].T + model.Q[k]
            C = model.C[0]
            if np.isnan(y[k, axis]):
                assert np.isnan(v[g, axis])
            else:
                assert v[g, axis] == pytest.approx(y[k, axis] - C @ x, rel=1e-8, abs=1e-12)
                assert s[g, axis] == pytest.approx(C @ P @ C + model.R[k, 0, 0], rel=1e-9)
            x, P = filtered[k]


@pytest.mark.parametrize(("ratio", "time"), [(1.0, 0.5), (1.0, 3.0), (0.3, 2.0), (0.2, 1.0)])
def test_slow_errors_are_recovered(ratio, time):
    """Over the axes within a factor 1.5, in a log whose blocks are short with respect to the correlation time."""
    t = stamps(45, 20)
    rng = np.random.default_rng(1)
    found = fit(t, bias_course(rng, t) + gauss_markov(rng, t, ratio * STD, time) + BLOCK * rng.normal(size=(len(t), 6)))
    assert abs(np.log(np.median(found.std / STD) / ratio)) < np.log(1.5)
    assert abs(np.log(np.median(found.time) / time)) < np.log(1.5)
    assert (found.gain > 50).all()


def test_joined_blocks_do_not_make_slow_errors_look_smaller():
    """In long logs: means of blocks are smoother than the process, so its time is found too long, never too short."""
    t = stamps(120, 20)
    rng = np.random.default_rng(1)
    found = fit(t, bias_course(rng, t) + gauss_markov(rng, t, STD, 0.5) + BLOCK * rng.normal(size=(len(t), 6)))
    ratio = found.std**2 * found.time / (STD**2 * 0.5)  # what the variance of the bias depends on
    assert (ratio > 1).all()
    assert (ratio < 5).all()


@pytest.mark.slow
def test_white_noise_stays_white():
    """In 100 logs on all six axes, with any factor of the variance that vibration leaves."""
    t = stamps(20, 20)
    white = 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        factor = rng.uniform(1, 1.5)
        found = fit(t, bias_course(rng, t) + factor * BLOCK * rng.normal(size=(len(t), 6)))
        white += not found.std.any()
        assert (found.time[found.std == 0] == 1).all()
    assert white >= 98


def test_an_axis_with_slow_errors_is_told_from_the_others():
    t = stamps(60, 20)
    rng = np.random.default_rng(2)
    slow = gauss_markov(rng, t, STD * np.array([0, 1, 0, 0, 0, 2]), 0.8)
    found = fit(t, bias_course(rng, t) + slow + BLOCK * rng.normal(size=(len(t), 6)))
    np.testing.assert_array_equal(found.std > 0, [False, True, False, False, False, True])


def test_an_axis_that_was_never_measured_is_white():
    t = stamps(30, 20)
    rng = np.random.default_rng(3)
    y = bias_course(rng, t) + gauss_markov(rng, t, 2 * STD, 1.0) + BLOCK * rng.normal(size=(len(t), 6))
    y[:, 2] = np.nan
    found = fit(t, y)
    assert found.std[2] == 0
    assert (found.std[[0, 1, 3, 4, 5]] > 0).all()
    assert np.isfinite(found.std).all()


def test_joined_blocks_are_weighted_means(monkeypatch):
    monkeypatch.setattr(slow_noise, "MOST_BLOCKS", 10)
    rng = np.random.default_rng(4)
    t, y, variance = np.arange(32.0), rng.normal(size=(32, 6)), rng.uniform(1, 3, (32, 6))
    y[rng.random(y.shape) < 0.3] = np.nan
    y[4:8, 1] = np.nan
    times, mean, spread = coarser(t, y, variance)
    np.testing.assert_array_equal(times, np.arange(8) * 4 + 1.5)
    for k in range(8):
        for axis in range(6):
            rows = np.arange(4 * k, 4 * k + 4)
            rows = rows[np.isfinite(y[rows, axis])]
            if len(rows) == 0:
                assert np.isnan([mean[k, axis], spread[k, axis]]).all()
                continue
            assert mean[k, axis] == pytest.approx(np.average(y[rows, axis], weights=1 / variance[rows, axis]))
            assert spread[k, axis] == pytest.approx(1 / (1 / variance[rows, axis]).sum())
    monkeypatch.setattr(slow_noise, "MOST_BLOCKS", 32)
    assert coarser(t, y, variance)[1] is y
