"""Logs in bins: means of the wrench, parabolas through the joints."""

import numpy as np
import small_checks

import ftbias_jax as ft
from ftbias_jax.check.bins import bins_of

SETUP = ft.parse_setup(small_checks.TABLES)


def log_of(arrays, setup=SETUP):
    return ft.Log.from_arrays(setup, **arrays)


def test_a_bin_has_the_motion_at_the_mean_time_of_its_wrench():
    _, arrays = small_checks.right_log()
    bins = bins_of(log_of(arrays), SETUP)
    q, dq, ddq = small_checks.motion_of_joints(bins.t)
    assert len(bins.t) == 300
    assert np.abs(bins.q - q).max() < 1e-4
    assert np.abs(bins.dq - dq).max() < 5e-3
    assert np.sqrt(np.mean((bins.ddq - ddq) ** 2)) < 0.05
    first = arrays["t"] < 0.0999
    np.testing.assert_allclose(bins.wrench[0], arrays["wrench"][first].mean(0))
    np.testing.assert_allclose(bins.t[0], arrays["t"][first].mean())


def test_positions_alone_and_a_slow_wrench_at_its_own_stamps_do():
    _, arrays = small_checks.right_log()
    del arrays["dq"]
    slow = np.arange(len(arrays["t"])) % 20 == 7
    arrays["wrench"] = np.where(slow[:, None], arrays["wrench"], np.nan)
    bins = bins_of(log_of(arrays), SETUP)
    q, dq, _ = small_checks.motion_of_joints(bins.t)
    np.testing.assert_allclose(bins.t, arrays["t"][slow], atol=1e-9)
    assert np.abs(bins.q - q).max() < 2e-4
    assert np.sqrt(np.mean((bins.dq - dq) ** 2)) < 5e-3
    np.testing.assert_array_equal(bins.count, 1)


def test_poses_a_second_apart_stand_still():
    _, arrays = small_checks.right_log(duration=60, rate=2)
    bins = bins_of(log_of(arrays), SETUP)
    assert len(bins.t) == 120
    assert not bins.dq.any()
    assert not bins.ddq.any()
    np.testing.assert_allclose(bins.q, arrays["q"], atol=1e-6)


def test_a_long_log_is_looked_at_in_stretches(monkeypatch):
    monkeypatch.setattr("ftbias_jax.check.bins.MOST", 2000)
    monkeypatch.setattr("ftbias_jax.check.bins.SEGMENT_BINS", 50)
    _, arrays = small_checks.right_log(duration=60)
    bins = bins_of(log_of(arrays), SETUP)
    assert 190 < len(bins.t) < 220
    assert bins.t[-1] > 59
    assert np.abs(bins.q - small_checks.motion_of_joints(bins.t)[0]).max() < 2e-3
