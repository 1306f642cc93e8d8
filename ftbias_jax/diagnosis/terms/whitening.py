"""Whitening of thousands of series at once: the bias filter's gains are worked out once, the loop runs over samples.

``likelihood.whiten`` is compiled for few series, of which each costs the same; here the cost of a sample is nearly that
of a few operations on one long row, in single precision.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.problem import Part, Problem

LANES = 512
"""Series that are whitened together: more do not fit into the processor's cache."""


class Recursion(NamedTuple):
    """The bias filter of one log without its measurements, (U, 6) each."""

    gain: np.ndarray
    """Of the bias."""
    drift_gain: np.ndarray
    """1/s, of the drift."""
    weight: np.ndarray
    """One over the innovation's standard deviation; 0 where nothing was measured."""


def recursion(part: Part) -> Recursion:
    """Gains of the filter whose process is ``process_models.drift_noise``."""
    problem, used = part.wrench, part.used
    dt, variance = np.asarray(problem.dt)[:used], np.asarray(problem.variance)[:used]
    seen = np.isfinite(np.asarray(problem.wrench)[:used])
    strength = np.asarray(problem.density) ** 2
    std = np.asarray(problem.prior_std).reshape(2, 6)
    bias, cross, drift = std[0] ** 2, np.zeros(6), std[1] ** 2
    gain, drift_gain, weight = np.zeros((3, used, 6))
    for k in range(used):
        h = dt[k]
        bias = bias + h * (2 * cross + h * drift) + h**3 / 3 * strength
        cross = cross + h * drift + h**2 / 2 * strength
        drift = drift + h * strength
        spread = bias + variance[k]
        gain[k], drift_gain[k] = np.where(seen[k], bias / spread, 0), np.where(seen[k], cross / spread, 0)
        weight[k] = np.where(seen[k], 1 / np.sqrt(spread), 0)
        drift = drift - drift_gain[k] * cross
        cross, bias = cross - gain[k] * cross, bias - gain[k] * bias
    return Recursion(gain, drift_gain, weight)


def whiten_many(problem: Problem, series: list[np.ndarray]) -> np.ndarray:
    """L series (U, 6) N, Nm -> (L, U, 6) innovations of each log's bias filter in standard deviations, float32."""
    white = np.zeros((len(series), len(problem.t), 6), np.float32)
    end = 0
    for part in problem.parts:
        start, end = end, end + part.used
        own = recursion(part)
        for first in range(0, len(series), LANES):
            few = np.stack([one[start:end] for one in series[first : first + LANES]], 2, dtype=np.float32)
            _whiten(np.asarray(part.wrench.dt)[: part.used], own, few)
            white[first : first + LANES, start:end] = few.transpose(2, 0, 1)
    return white


def _whiten(dt: np.ndarray, own: Recursion, series: np.ndarray) -> None:
    """Replace series (U, 6, L) by their innovations; the lanes come last, so that every operation is a long one."""
    gain, drift_gain, weight = (x.astype(np.float32)[:, :, None] for x in own)
    bias, drift, step = np.zeros((3, *series.shape[1:]), np.float32)
    for k, h in enumerate(dt.astype(np.float32)):
        np.multiply(drift, h, out=step)
        bias += step
        innovation = series[k]
        innovation -= bias
        np.multiply(innovation, gain[k], out=step)
        bias += step
        np.multiply(innovation, drift_gain[k], out=step)
        drift += step
        innovation *= weight[k]
