"""The white noise of the sensor, from the part of the signal that no motion can cause.

Windows of 16 samples are split into an orthonormal basis: a cubic in time, which absorbs the motion, and twelve waves
of rising frequency that are orthogonal to it. White noise has the same standard deviation in each of the twelve.
"""

from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis import thresholds
from ftbias_jax.diagnosis.samples.spikes import NORMAL_MEDIAN
from ftbias_jax.diagnosis.samples.types import Finding, name_channels
from ftbias_jax.model.effects.fitting import LEVEL

WINDOW = 16
CUBIC = 4
TOP = 8
"""First of the waves that measure the noise, which span half to all of the Nyquist frequency."""
CLIPPED_STD = 0.98658
"""Standard deviation of a standard normal that is truncated at ``thresholds.CLIP``."""
LONG_WINDOW = 256
KEEP_NOISE_STD = "keep sensor.noise_std: the noise is not of one size, and ftbias filter takes it as the log shows it"
"""Remedy for noise that is not white, or not the same in motion as at rest."""


class Waves(NamedTuple):
    """High-frequency part of a signal. M = windows, k = channels."""

    amplitude: np.ndarray
    """(M, 12, k) N, Nm, amplitudes of the waves by rising frequency."""
    row: np.ndarray
    """(M, 16) rows of the signal in each window."""
    basis: np.ndarray
    """(M, 16, 12) the waves themselves, of unit length."""

    @property
    def top(self) -> np.ndarray:
        """(M, 8, k) N, Nm: amplitudes of the waves that motion and model errors do not excite."""
        return self.amplitude[:, TOP - CUBIC :]

    @property
    def top_squares(self) -> np.ndarray:
        """(M * 16, k) N^2, Nm^2: squared part of each sample in these waves; its mean is white noise's variance."""
        basis = self.basis[:, :, TOP - CUBIC :]
        share = (basis**2).sum(2, keepdims=True)
        of_samples = np.einsum("mwj,mjk->mwk", basis, self.top) ** 2 / share
        return of_samples.reshape(-1, of_samples.shape[2])


class Noise(NamedTuple):
    """White noise of each channel (k,)."""

    std: np.ndarray
    """N, Nm; for noise that is not white, the value within the range of its spectrum nearest to the stated one."""
    stderr: np.ndarray
    low: np.ndarray
    """N, Nm: level of the quietest part of the spectrum, which hum and vibration do not raise."""
    high: np.ndarray
    """N, Nm: level of the loudest band, which a filter in the sensor does not lower."""
    coloured: np.ndarray
    """bool: whether the noise is not white."""


def fast_waves(t: np.ndarray, signal: np.ndarray) -> Waves:
    """Split a signal (N, k) with stamps (N,) s into windows of waves; windows with a pause in them are left out."""
    count = len(t) // WINDOW
    row = np.arange(count * WINDOW).reshape(count, WINDOW)
    span = np.ptp(t[row], 1)
    row = row[span < 3 * np.median(span)]
    x = t[row] - t[row].mean(1, keepdims=True)
    x /= np.abs(x).max(1, keepdims=True)
    waves = np.cos(np.pi / WINDOW * np.outer(np.arange(WINDOW) + 0.5, np.arange(CUBIC, WINDOW)))
    powers = x[:, :, None] ** np.arange(CUBIC)
    columns = np.concatenate([powers, np.broadcast_to(waves, (len(row), *waves.shape))], 2)
    basis = np.linalg.qr(columns)[0][:, :, CUBIC:]
    return Waves(np.einsum("mwj,mwk->mjk", basis, signal[row]), row, basis)


def measure_noise(waves: Waves, signal: np.ndarray, stated: np.ndarray, heavy_tailed: bool) -> Noise:
    """White noise from the fast waves of a signal (N, k) N, Nm, and the flatness of its spectrum.

    For heavy-tailed noise the large values are included.
    """
    windows, k = len(waves.amplitude), signal.shape[1]
    std = np.sqrt((waves.top**2).mean((0, 1))) if heavy_tailed else robust_std(waves.top.reshape(-1, k))
    pairs = waves.amplitude.reshape(windows, -1, 2, k)
    bands = np.stack([robust_std(pairs[:, j].reshape(-1, k)) for j in range(pairs.shape[1])])
    top = bands[(TOP - CUBIC) // 2 :]
    level, line = _spectrum(signal, std)
    low, high = np.minimum(np.minimum(top.min(0), std), level), np.maximum(bands.max(0), std)
    margin = np.exp(4 * 1.05 / np.sqrt(4 * windows))  # four standard errors of one band
    loud = (std > 1.1 * low * margin) | line | (top.max(0) > thresholds.COLOURED * margin * top.min(0))
    coloured = loud | (high > thresholds.COLOURED * margin * std)
    nearest = np.clip(stated, np.where(loud, low, std), high)
    stderr = 1.05 * std / np.sqrt(2 * TOP * windows)
    return Noise(np.where(coloured, nearest, std), stderr, low, high, coloured)


def robust_std(x: np.ndarray) -> np.ndarray:
    """(k,) standard deviation of (N, k), or of its normal part if a share of the values is larger."""
    std: np.ndarray = np.median(np.abs(x), 0) / NORMAL_MEDIAN
    for _ in range(4):
        inside = np.abs(x) <= thresholds.CLIP * std
        std = np.sqrt((x**2 * inside).sum(0) / np.maximum(inside.sum(0), 1)) / CLIPPED_STD
    return std


def _spectrum(signal: np.ndarray, usual: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Noise level (k,) between the spectral lines of the upper half of the spectrum, and whether there are lines (k,).

    Returns:
        ``usual`` (k,) and False for a signal that is too short.
    """
    count = len(signal) // LONG_WINDOW
    if count < 4:
        return usual, np.zeros(signal.shape[1], bool)
    taper = np.hanning(LONG_WINDOW)[:, None]
    blocks = signal[: count * LONG_WINDOW].reshape(count, LONG_WINDOW, -1)
    power = np.abs(np.fft.rfft((blocks - blocks.mean(1, keepdims=True)) * taper, axis=1)) ** 2 / (taper**2).sum()
    upper = np.median(power[:, LONG_WINDOW // 4 : -2], 0) / np.log(2)  # the median of an exponential
    floor = np.median(upper, 0)
    highest = 2 + 37 / count  # the median of ``count`` exponentials exceeds it once in 3e5: 2^n exp(-n x / 2)
    return np.sqrt(floor), upper.max(0) > floor * highest


def judge_noise(noise: Noise, noise_std: np.ndarray, step: np.ndarray, grows: bool, rests: bool) -> Finding:
    """Finding of white noise that differs from the stated one, without the share of the rounding to a lattice.

    Hum must not make a channel loud, nor a filter make it quiet: the quietest band must be loud, the loudest quiet.
    Where the noise grows with the motion, its level at rest depends on the form of the growth, and on that alone in a
    log that never rests.

    Args:
        noise: noise of six channels at rest.
        noise_std: (6,) N, Nm, stated.
        step: (6,) N, Nm, of lattices.
        grows: whether the noise grows with the motion.
        rests: whether the log shows the noise at rest.
    """

    own = (np.sqrt(np.maximum(std**2 - step**2 / 12, 0)) for std in (noise.std, noise.low, noise.high))
    scale, low, high = (std / noise_std for std in own)
    stderr = np.maximum(noise.stderr / noise.std * scale, 1e-6)
    # A step of more than two sigmas hides the noise, which then rarely crosses a level.
    trusted = (step < 2 * noise_std) & np.isfinite(scale) & (rests or not grows)
    floor = np.where(noise.coloured | grows, thresholds.LOUDER_IF_COLOURED, thresholds.LOUDER)
    ceiling = 1 / thresholds.LOUDER_IF_COLOURED if grows else thresholds.QUIETER
    louder = trusted & (low > floor) & (low - 1 - thresholds.STATED_WITHIN > thresholds.SURELY_LOUDER * stderr)
    quieter = (
        trusted & (high < ceiling) & (1 - thresholds.STATED_WITHIN - high > thresholds.SURELY_QUIETER * stderr)
    )  # one band has twice the error
    wrong = louder | quieter
    scale, stderr = np.where(trusted, scale, 1.0), np.where(trusted, stderr, 0.0)
    dof = 1 / (2 * np.maximum(stderr / scale, 1e-3) ** 2)
    nats = float((dof / 2 * (scale**2 - 1 - np.log(scale**2)))[wrong].sum())
    sentence = "the fastest part of the signal is as large as the stated noise"
    if wrong.any():
        words = " ".join(f"{x:.2f}" for x in scale)
        sentence = f"white noise of {name_channels(wrong)} is not the stated: {words} times as large"
    if noise.coloured.any():
        sentence += f"; {name_channels(noise.coloured)} not white (hum, vibration, ringing or a filter)"
    found = Finding(LEVEL, bool(wrong.any()), {"scale": scale.tolist()}, {"scale": stderr.tolist()}, nats, sentence)
    not_white = wrong & noise.coloured
    if not_white.any():
        found = found._replace(
            doubt=f"{name_channels(not_white)}: not white, and this is the white part", remedy=KEEP_NOISE_STD
        )
    return found._replace(remedy=KEEP_NOISE_STD) if grows else found
