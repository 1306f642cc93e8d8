"""The rows of a log that have a wrench, with what the model says about them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ftbias_jax.io.log import Log
from ftbias_jax.model.motion_noise import MotionNoise
from ftbias_jax.types import Array

REACH = 16
"""Samples before and after together, over which the slow part of a signal is a mean."""


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
    error: np.ndarray
    """(N, k) N, Nm, of the model."""
    rate: np.ndarray
    """(N, k) N/s, Nm/s, of the model."""
    stated: np.ndarray
    """(k,) N, Nm, noise."""
    speed: np.ndarray
    """(N, n) rad/s, of the joints; n = 0 if there are none."""

    def only(self, keep: np.ndarray) -> Samples:
        """The rows marked in (N,)."""
        per_row = ("row", "t", "wrench", "error", "rate", "speed")
        return self._replace(**{name: getattr(self, name)[keep] for name in per_row})

    def at_rest(self, growth: MotionNoise) -> Samples:
        """The fast part of the error with the noise that it would have at rest.

        Args:
            growth: what the motion adds to the variance of the channels, per variance at rest.
        """
        if not self.speed.size or not growth.per_speed.any():
            return self
        louder = np.sqrt(1 + growth.variance(self.speed))
        fast = self.error - moving_mean(self.error)  # a slow error divided by a fast factor would be noise
        return self._replace(error=fast / louder, rate=self.rate / louder)


def select(log: Log, stated: np.ndarray, error: Array, rate: Array, speed: Array | None) -> Samples:
    """The rows with all channels that share the clock of the most frequent one. Arguments as of ``inspect_samples``."""
    wrench, error = np.asarray(log.wrench, float), np.asarray(error, float)
    finite = np.isfinite(wrench)
    most = finite[:, finite.sum(0).argmax()]
    channels = (finite & most[:, None]).sum(0) > most.sum() / 2
    row = np.flatnonzero((finite & np.isfinite(error))[:, channels].all(1) & most)
    rates = np.nan_to_num(np.asarray(rate, float)[row][:, channels])
    speeds = np.zeros((len(row), 0)) if speed is None else np.asarray(speed, float)[row]
    measured, errors = (x[row][:, channels] for x in (wrench, error))
    return Samples(row, channels, np.asarray(log.t, float)[row], measured, errors, rates, stated[channels], speeds)


def moving_mean(x: np.ndarray) -> np.ndarray:
    """(N, k) means over the REACH rows around each."""
    padded = np.pad(x, ((REACH // 2 + 1, REACH // 2), (0, 0)), mode="edge").cumsum(0)
    return (padded[REACH + 1 :] - padded[: -REACH - 1]) / (REACH + 1)
