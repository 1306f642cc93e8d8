"""The rows of a log that have a wrench, with what the model says about them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.thresholds import SLOW_LOG
from ftbias_jax.io.log import Log
from ftbias_jax.model.motion_noise import MotionNoise
from ftbias_jax.types import Array

REACH = 16
"""Samples before and after, for the rate of a noisy wrench."""


class Samples(NamedTuple):
    """N = rows, k = channels that are measured."""

    row: np.ndarray
    """(N,) of the log."""
    channels: np.ndarray
    """(6,) bool."""
    t: np.ndarray
    """(N,) s."""
    wrench: np.ndarray
    """(N, k) N, Nm."""
    signal: np.ndarray
    """(N, k) N, Nm: the error of the model if known, else the wrench."""
    rate: np.ndarray
    """(N, k) N/s, Nm/s, of the model if known, else of the wrench."""
    stated: np.ndarray
    """(k,) N, Nm, noise."""
    speed: np.ndarray | None
    """(N, n) rad/s, of the joints, if known."""
    modelled: bool
    """Whether ``signal`` is the error of the model."""

    @property
    def too_slow(self) -> bool:
        """Whether what looks like noise may be motion."""
        return not self.modelled and float(np.median(np.diff(self.t))) > SLOW_LOG

    def only(self, keep: np.ndarray) -> Samples:
        """The rows marked in (N,)."""
        parts = (self.t[keep], self.wrench[keep], self.signal[keep], self.rate[keep])
        speed = None if self.speed is None else self.speed[keep]
        return Samples(self.row[keep], self.channels, *parts, self.stated, speed, self.modelled)

    def at_rest(self, growth: MotionNoise) -> Samples:
        """The fast part of the signal with the noise that it would have at rest.

        Args:
            growth: what the motion adds to the variance of the channels, per variance at rest.
        """
        if self.speed is None or not growth.per_speed.any():
            return self
        louder = np.sqrt(1 + growth.variance(self.speed))
        fast = self.signal - moving_mean(self.signal)  # a slow error divided by a fast factor would be noise
        return self._replace(signal=fast / louder, rate=self.rate / louder)


def select(
    log: Log, stated: np.ndarray, error: Array | None, rate: Array | None, speed: Array | None = None
) -> Samples:
    """The rows with all channels that share the clock of the most frequent one, and a prediction if there is any.

    Args:
        log: the samples as recorded.
        stated: (6,) N, Nm, noise.
        error: (T, 6) N, Nm.
        rate: (T, 6) N/s, Nm/s.
        speed: (T, n) rad/s, of the joints.
    """
    wrench = np.asarray(log.wrench, float)
    finite = np.isfinite(wrench)
    most = finite[:, finite.sum(0).argmax()]
    channels = (finite & most[:, None]).sum(0) > most.sum() / 2
    signal = wrench if error is None else np.asarray(error, float)
    row = np.flatnonzero(finite[:, channels].all(1) & np.isfinite(signal[:, channels]).all(1) & most)
    t, measured = np.asarray(log.t, float)[row], wrench[row][:, channels]
    rates = _own_rate(t, measured) if rate is None else np.nan_to_num(np.asarray(rate, float)[row][:, channels])
    speeds = None if speed is None else np.asarray(speed, float)[row]
    signals, modelled = signal[row][:, channels], error is not None
    return Samples(row, channels, t, measured, signals, rates, stated[channels], speeds, modelled)


def moving_mean(x: np.ndarray) -> np.ndarray:
    """(N, k) means over the REACH rows around each."""
    padded = np.pad(x, ((REACH // 2 + 1, REACH // 2), (0, 0)), mode="edge").cumsum(0)
    mean: np.ndarray = (padded[REACH + 1 :] - padded[: -REACH - 1]) / (REACH + 1)
    return mean


def _own_rate(t: np.ndarray, wrench: np.ndarray) -> np.ndarray:
    """(N, k) N/s, Nm/s: from the mean of the REACH samples before to that of the REACH samples after each."""
    if len(t) < 2:
        return np.zeros_like(wrench)
    padded = np.pad(np.column_stack([t, wrench]), ((REACH, REACH), (0, 0)), mode="edge").cumsum(0)
    total = np.pad(padded, ((1, 0), (0, 0)))
    mean = (total[REACH:] - total[:-REACH]) / REACH
    change = mean[REACH + 1 : REACH + 1 + len(t)] - mean[: len(t)]
    rate: np.ndarray = change[:, 1:] / change[:, :1]
    return rate
