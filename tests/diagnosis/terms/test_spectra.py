"""Lines in synthetic series, and noise that follows a drive."""

from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.terms.noise import _fitted, _score
from ftbias_jax.diagnosis.terms.spectra import fast_lines, lines


class Bins(NamedTuple):
    t: np.ndarray
    log: np.ndarray
    durations: tuple[float, ...]


class Recorded(NamedTuple):
    t: np.ndarray


class Seen(NamedTuple):
    clean_wrench: np.ndarray
    noise_std: np.ndarray


def test_a_line_is_found_and_white_noise_has_none():
    rng = np.random.default_rng(0)
    t = np.arange(2000) * 0.01
    error = rng.normal(size=(2000, 6))
    bins = Bins(t, np.zeros(2000, int), (20.0,))
    assert lines(bins, error) == []
    error[:, 1] += 1.0 * np.sin(2 * np.pi * 13.3 * t)
    assert abs(lines(bins, error)[0] - 13.3) < 0.02


def test_a_line_above_the_range_of_the_bins_is_found_in_the_samples():
    rng = np.random.default_rng(0)
    t = np.arange(5000) / 500
    slow = np.sin(2 * np.pi * 0.4 * t)[:, None] * np.arange(1, 7)
    wrench = slow + 0.05 * rng.normal(size=(5000, 6))
    logs, std = [Recorded(t)], np.full(6, 0.05)
    assert fast_lines(logs, [Seen(wrench, std)]) == []
    wrench[:, 2] += 0.05 * np.sin(2 * np.pi * 150.2 * t)
    assert abs(fast_lines(logs, [Seen(wrench, std)])[0] - 150.2) < 0.02


def test_noise_that_follows_a_drive_gains_and_other_noise_does_not():
    rng = np.random.default_rng(0)
    drive = np.repeat(np.linspace(0, 1, 4000)[:, None], 6, 1)
    white = rng.normal(size=(4000, 6))
    block = np.arange(4000) // 200
    assert _score(drive, white**2) < 12
    grown = white**2 * (1 + 3 * drive)
    assert _score(drive, grown) > 100
    growing = _fitted("time", drive, grown, block, 1)
    assert growing.nats > 100
    np.testing.assert_allclose(growing.weight, [np.ones(6), np.full(6, 3.0)], rtol=0.35)
    np.testing.assert_array_less(np.abs(growing.weight[1] - 3.0), 4 * growing.stderr[1])
