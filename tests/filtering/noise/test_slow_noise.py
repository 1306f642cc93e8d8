"""Slow errors of synthetic series against textbook filters, and recovered from what was simulated."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made_series import STD, gauss_markov, stamps

from ftbias_jax.filtering.noise import slow_noise
from ftbias_jax.filtering.noise.block_filter import Grid, Means, filter_blocks, filter_series
from ftbias_jax.filtering.noise.slow_noise import fit_slow_noise, join_blocks, nats_of

PRIOR = np.concatenate([20 * STD, 0.05 * STD])
DENSITY = 0.01 * STD
BLOCK = STD / 5
"""Standard deviation of the mean of 25 samples."""


def bias_course(rng, t):
    """(T, 6) a sample path of the bias."""
    dt = np.diff(t, prepend=t[0])[:, None]
    drift = PRIOR[6:] * rng.normal(size=6) + np.cumsum(np.sqrt(dt) * DENSITY * rng.normal(size=(len(t), 6)), 0)
    return PRIOR[:6] * rng.normal(size=6) + np.cumsum(dt * drift, 0)


@jax.jit
def _fit(t, y, variance):
    means = join_blocks(Means(jnp.median(jnp.diff(t)), t, y, variance), jnp.asarray(len(t)))
    return fit_slow_noise(means, DENSITY, PRIOR.reshape(2, 6))


def fit(t, y, std=BLOCK):
    return jax.tree.map(np.asarray, _fit(t, y, np.broadcast_to(std**2, y.shape)))


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
    return Means(np.median(np.diff(t)), t, y, variance), grid


STEPS = 400


def over_a_block(length, time):
    """Transition (2, 2) and noise (2, 2) of (value at the end, mean) with variance 1, by many small steps."""
    kept = np.exp(-length / STEPS / time)
    A, Q = np.array([[1.0, 0], [0, 0]]), np.zeros((2, 2))
    # The mean of each small step is approximated by the average of its beginning and end.
    step = np.array([[kept, 0], [(1 + kept) / 2 / STEPS, 1]])
    kick = np.array([1.0, 1 / 2 / STEPS])
    for _ in range(STEPS):
        A, Q = step @ A, step @ Q @ step.T + (1 - kept**2) * np.outer(kick, kick)
    return A, Q


def textbook(linear_gaussian, short, g, axis):
    """One axis and one set of parameters as matrices; the state is (bias, drift, error at block end, block mean)."""
    (_, t, _, variance), grid = short
    q, std, time = DENSITY[axis] ** 2, grid.std[g, axis], grid.time[g, axis]
    length = np.median(np.diff(t))
    into, inside = over_a_block(length, time)
    A, Q = np.zeros((2, len(t), 4, 4))
    for k, h in enumerate(np.diff(t, prepend=t[0])):
        paused = np.exp(-max(h - length, 0) / time)
        A[k, :2, :2], A[k, 2:, 2:] = [[1, h], [0, 1]], into * [paused, 0]
        Q[k, :2, :2] = [[h**3 / 3 * q, h**2 / 2 * q], [h**2 / 2 * q, h * q]]
        Q[k, 2:, 2:] = std**2 * (inside + (1 - paused**2) * np.outer(into[:, 0], into[:, 0]))
    R = grid.white[g, axis] * np.nan_to_num(variance[:, axis])[:, None, None]
    P = np.diag([PRIOR[axis] ** 2, PRIOR[6 + axis] ** 2, std**2, 0])
    return linear_gaussian(A, Q, np.array([[1.0, 0, 0, 1]]), R, np.zeros(4), P)


def test_likelihoods_are_those_of_the_one_normal_distribution_of_all_blocks(linear_gaussian, short):
    means, grid = short
    nats = nats_of(*filter_blocks(means, grid, PRIOR.reshape(2, 6), DENSITY)[:2])
    for g in range(3):
        for axis in range(6):
            y = short[0].y[:, axis]
            exact = textbook(linear_gaussian, short, g, axis).log_density(y[:, None])
            constant = np.isfinite(y).sum() * np.log(2 * np.pi) / 2
            assert nats[g, axis] - constant == pytest.approx(exact, rel=1e-4)


@pytest.mark.parametrize(("ratio", "time"), [(1.0, 0.1), (1.0, 0.5), (1.0, 3.0), (0.3, 2.0), (0.2, 1.0)])
def test_slow_errors_are_recovered(ratio, time):
    """The medians over the axes are within a factor of 1.6, for blocks of 0.05 s."""
    t = stamps(45, 200)
    rng = np.random.default_rng(1)
    y = bias_course(rng, t) + gauss_markov(rng, t, ratio * STD, time)
    found = fit(*means_of(10, t, y + np.sqrt(10) * BLOCK * rng.normal(size=y.shape)))
    assert abs(np.log(np.median(found.std / STD) / ratio)) < np.log(1.6)
    assert abs(np.log(np.median(found.time) / time)) < np.log(1.6)
    assert (found.gain > 50).all()


def means_of(size, t, y):
    """Mid times and means of blocks of ``size`` samples."""
    return t.reshape(-1, size).mean(1), y.reshape(-1, size, 6).mean(1)


@pytest.mark.parametrize("seconds", [60, 240])
def test_joined_blocks_do_not_make_slow_errors_look_slower(seconds):
    """Blocks of long logs are joined into 1000, here of up to 0.24 s for errors that last 0.3 s."""
    t = stamps(seconds, 100)
    rng = np.random.default_rng(1)
    y = bias_course(rng, t) + gauss_markov(rng, t, STD, 0.3) + STD / 2 * rng.normal(size=(len(t), 6))
    found = fit(*means_of(5, t, y), std=STD / 2 / np.sqrt(5))
    assert np.median(found.time) == pytest.approx(0.3, rel=0.2)
    assert np.median(found.std / STD) == pytest.approx(1, rel=0.15)


@pytest.mark.slow
def test_white_noise_stays_white():
    """In 100 logs on all six axes, whatever factor the noise variance has been scaled by for vibration."""
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
    means = Means(1.0, t, y, variance)
    seconds, times, mean, spread = join_blocks(means, jnp.asarray(32))
    assert seconds == 4
    np.testing.assert_array_equal(times[:8], np.arange(8) * 4 + 1.5)
    assert np.isnan(mean[8:]).all()
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
    assert join_blocks(means, jnp.asarray(32)) is means


def test_a_series_of_any_length_is_filtered_by_a_longer_program(short):
    (_, t, y, variance), grid = short
    found = filter_series(t, y, variance, grid, PRIOR.reshape(2, 6), DENSITY)
    expected = filter_blocks(short[0], grid, PRIOR.reshape(2, 6), DENSITY)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9)
    never = filter_series(t, y, variance, grid, PRIOR.reshape(2, 6), DENSITY, np.zeros((3, 6)))
    np.testing.assert_allclose(never.bias, found.bias, rtol=1e-9)
