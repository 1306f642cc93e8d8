"""Timestamp jitter: noise along the direction in which the wrench changes, proportional to its rate of change.

A stamp that is late by tau adds tau dW/dt to all six channels together. Vibration and contact excite other directions
too, so each window's noise is split into the part along dW/dt and the part across it, both in noise sigmas.
"""

from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis import thresholds
from ftbias_jax.diagnosis.samples.bins import moving_mean
from ftbias_jax.diagnosis.samples.noise import TOP, robust_std
from ftbias_jax.diagnosis.samples.types import Finding
from ftbias_jax.model.effects.fitting import JITTER

ROUNDS = 20
CONSTANT_RATE = 0.05
"""Relative error of the result, because the rate is taken as constant during the delay."""


class Jitter(NamedTuple):
    """Scatter of the time of measurement around the stamps, independent from sample to sample."""

    std: float
    """s; 0 = none."""
    stderr: float
    nats: float
    visible: float
    """Noise sigmas that it adds in the fastest twentieth of the log."""
    across: float
    """Ratio of the variance across the direction of change to that along it."""
    even: float
    """Variance in the upper half of the waves relative to the lower half: 1 for jitter, less for jerky motion."""
    noise_std: np.ndarray
    """(k,) N, Nm, white noise without the jitter."""
    correlation: float = 0.0
    """Lag-one correlation of the error along dW/dt where it is fast: 0 for jitter, more for vibration."""

    @property
    def detected(self) -> bool:
        """Whether the jitter is significant, large enough to matter, and nothing but jitter."""
        certain = self.nats > thresholds.JITTER_NATS and self.visible > thresholds.JITTER_VISIBLE
        alike = (
            self.across < thresholds.ACROSS and self.even > thresholds.EVEN and self.correlation < thresholds.CORRELATED
        )
        return certain and self.std < thresholds.MOST_JITTER and alike

    @property
    def finding(self) -> Finding:
        """Finding of scatter along the direction in which the wrench changes."""
        sentence = "the noise does not grow with the rate of the wrench, in its direction"
        if self.detected:
            fast = f"{self.visible:.2g} sigmas where it is fast"
            sentence = f"noise along dW/dt grows with it, by {fast}; across it does not"
        return Finding(JITTER, self.detected, {"std": self.std}, {"std": self.stderr}, self.nats, sentence)


def no_jitter(noise_std: np.ndarray) -> Jitter:
    """Result without jitter, for noise (k,) N, Nm."""
    return Jitter(0.0, 0.0, 0.0, 0.0, 0.0, 1.0, noise_std)


def measure_jitter(amplitude: np.ndarray, rate: np.ndarray, noise_std: np.ndarray) -> Jitter:
    """Jitter from the high-frequency part of the signal.

    Args:
        amplitude: (M, 8, k) N, Nm, amplitudes of the waves in M windows.
        rate: (M, k) N/s, Nm/s, dW/dt.
        noise_std: (k,) N, Nm, of a log without jitter.
    """
    sigma = noise_std
    speed = np.linalg.norm(rate / sigma, axis=1)
    slow = speed <= np.quantile(speed, 0.3)
    sigma = np.minimum(sigma, robust_std(amplitude[slow].reshape(-1, amplitude.shape[2])))
    std = 0.0
    for _ in range(ROUNDS):
        before = std
        spread = np.sqrt(1 + std**2 * (rate / sigma) ** 2)
        sigma = robust_std((amplitude / spread[:, None]).reshape(-1, amplitude.shape[2]))
        along, across, speed = _split(amplitude / sigma, rate / sigma)
        quiet = across < thresholds.LOUD
        along, across, speed = along[quiet], across[quiet], speed[quiet]
        if not quiet.any() or not speed.any():
            return no_jitter(noise_std)
        variance_across, _, _ = _fit(across, speed, np.ones_like(speed), TOP * (amplitude.shape[2] - 1))
        ground = 1 + variance_across * speed**2
        variance, stderr, nats = _fit(along, speed, ground, TOP)
        std = float(np.sqrt(variance))
        if abs(std - before) <= 1e-3 * std:
            break
    visible = std * float(np.quantile(speed, 0.95))
    share = variance_across / variance if variance > 0 else 0.0
    halves = np.split(amplitude / sigma, 2, axis=1)
    low, high = (_fit(_split(half, rate / sigma)[0][quiet], speed, ground, TOP // 2)[0] for half in halves)
    even = high / low if low > 0 else 1.0
    error = float(np.hypot(stderr / (2 * std), CONSTANT_RATE * std)) if std > 0 else 0.0
    return Jitter(std, error, nats, visible, share, even, sigma)


def correlation_along(error: np.ndarray, rate: np.ndarray, noise_std: np.ndarray) -> float:
    """Lag-one correlation of the error (N, k) N, Nm along dW/dt (N, k), in the faster half of a log."""
    speed = np.linalg.norm(rate / noise_std, axis=1)
    direction = rate / noise_std / np.maximum(speed, 1e-12)[:, None]
    along = ((error - moving_mean(error)) / noise_std * direction).sum(1) * (speed >= np.median(speed))
    power = float((along**2).sum())
    return float((along[1:] * along[:-1]).sum()) / power if power > 0 else 0.0


def _split(amplitude: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean square (M,) of whitened waves along and across the whitened rate, and its size (M,) in sigmas per second."""
    speed = np.linalg.norm(rate, axis=1)
    direction = rate / np.maximum(speed, 1e-12)[:, None]
    along = (np.einsum("mjk,mk->mj", amplitude, direction) ** 2).mean(1)
    across = ((amplitude**2).sum(2).mean(1) - along) / (rate.shape[1] - 1)
    return along, across, speed


def _fit(power: np.ndarray, speed: np.ndarray, ground: np.ndarray, dof: int) -> tuple[float, float, float]:
    """Maximum likelihood of tau^2 in E[power] = ground + tau^2 speed^2.

    Args:
        power: (M,) mean squares of ``dof`` normal numbers.
        speed: (M,) rate of change of the signal; tau times it is the error due to jitter.
        ground: (M,) expectation of ``power`` without jitter.
        dof: degrees of freedom of each entry of ``power``.

    Returns:
        tau^2 and its standard error in s^2 (robust to jitter that is not normal), and the gain in nats without the
        windows that gain most, because a jump or a corner of the motion is one event.
    """
    x = speed**2

    def likelihood(tau2: np.ndarray) -> np.ndarray:
        expected = ground[:, None] + tau2 * x[:, None]
        return -dof / 2 * (np.log(expected) + power[:, None] / expected).sum(0)

    grid = np.concatenate([[0.0], np.logspace(-3, 4, 57) / np.quantile(x, 0.95)])
    for _ in range(3):
        values = likelihood(grid)
        best = int(np.argmax(values))
        low, high = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
        grid = np.concatenate([[0.0], np.linspace(low, high, 21)])
    values = likelihood(grid)
    best = int(np.argmax(values))
    expected = ground + grid[best] * x
    score = dof / 2 * (power / expected - 1) * x / expected
    information = dof / 2 * ((x / expected) ** 2).sum()
    gain = dof / 2 * (power / ground - power / expected - np.log(expected / ground))
    events = max(thresholds.FEW_WINDOWS, len(gain) // 100)
    nats = np.sort(gain)[:-events].sum() if len(gain) > events else 0.0
    return float(grid[best]), float(np.sqrt((score**2).sum()) / information), float(max(nats, 0.0))
