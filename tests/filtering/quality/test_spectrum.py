"""Lines added to white noise are found, and white noise has none."""

import numpy as np
import pytest

from ftbias_jax.filtering.quality.spectrum import find_lines, format_lines

STD = np.repeat([0.1, 0.004], 3)
RATE = 500.0
T = np.arange(0, 30, 1 / RATE)


def white(seed, t=T):
    return np.random.default_rng(seed).normal(size=(len(t), 6)) * STD


def test_white_noise_has_no_lines():
    assert sum(len(find_lines(T, white(seed))) for seed in range(40)) <= 1


def test_a_tone_is_found_with_its_size_on_its_axes():
    amplitude = np.array([0, 0.05, 0, 0, 0, 0.001])
    x = white(1) + amplitude * np.sin(2 * np.pi * 50.03 * T)[:, None]
    (line,) = find_lines(T, x)
    assert line.frequency == pytest.approx(50.03, abs=0.2)
    np.testing.assert_allclose(line.amplitude, amplitude, atol=0.1 * amplitude.max())
    assert (line.amplitude[[0, 2, 3, 4]] == 0).all()
    assert line.sharp
    assert line.mains == 50
    assert format_lines([line]).startswith("tone at 50.0 Hz (fy 0.05")
    assert "a multiple of 50 Hz" in format_lines([line])


def test_hum_above_half_the_rate_is_known_by_its_alias():
    t = np.arange(0, 60, 0.01)  # sampled at 100 Hz, 60 Hz appears at 40 Hz
    x = white(2, t) + 0.1 * np.sin(2 * np.pi * 60 * t)[:, None] * [1, 0, 0, 0, 0, 0]
    (line,) = find_lines(t, x)
    assert line.frequency == pytest.approx(40, abs=0.2)
    assert line.mains == 60


def test_a_resonance_is_wider_than_a_tone():
    """Noise through a lightly damped oscillator: a peak at 12 Hz with a damping ratio of 0.05."""
    rng = np.random.default_rng(3)
    w, zeta = 2 * np.pi * 22.0, 0.05
    a, b = 2 * np.exp(-zeta * w / RATE) * np.cos(w / RATE), -np.exp(-2 * zeta * w / RATE)
    y = np.zeros(len(T))
    drive = rng.normal(size=len(T))
    for i in range(2, len(T)):
        y[i] = a * y[i - 1] + b * y[i - 2] + drive[i]
    x = white(4)
    x[:, 2] += 0.1 * y / y.std()
    lines = find_lines(T, x)
    assert lines[0].frequency == pytest.approx(22, abs=1)
    assert not lines[0].sharp
    assert lines[0].width == pytest.approx(2 * zeta * 22, rel=0.6)
    assert lines[0].mains == 0
    assert "resonance" in format_lines(lines)


def test_gaps_and_missing_axes_show_no_lines():
    x = white(5)
    x[3000:3500] = np.nan
    x[:, 4] = np.nan
    kept = np.r_[0:8000, 9000:15000]
    assert find_lines(T[kept], x[kept]) == []


def test_a_short_log_says_nothing():
    assert find_lines(T[:500], white(6)[:500] + np.sin(2 * np.pi * 50 * T[:500])[:, None]) == []
    assert find_lines(T[:1], white(6)[:1]) == []
