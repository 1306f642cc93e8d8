"""Innovations of the bias filter as products with matrices that are computed once per log.

The filter is linear and its gains do not depend on the filtered series (``likelihood.whiten`` states why it whitens). A
segment of several bins is therefore a matrix that maps readings to innovations, and earlier segments act only through
bias and drift. Thousands of series need only matrix products and one loop over the segments.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ftbias_jax.filtering.likelihood import WrenchProblem

SEGMENT_BINS = 32
"""Bins per segment: more make the products longer, fewer the loop."""


class Whitener(NamedTuple):
    """The bias filter of one log over n segments of L bins, channel by channel; the last segment is padded."""

    inside: np.ndarray
    """(6, n, L, L) innovations, in standard deviations, due to the readings of the same segment."""
    entering: np.ndarray
    """(6, n, L, 2) innovations due to bias and drift at the segment's start."""
    leaving: np.ndarray
    """(6, n, 2, L) bias and drift at the segment's end due to its readings."""
    passing: np.ndarray
    """(6, n, 2, 2) bias and drift at the segment's end due to those at its start."""

    def single(self) -> Whitener:
        """The same matrices in single precision, which is twice as fast."""
        return Whitener(*(x.astype(np.float32) for x in self))

    def __call__(self, series: np.ndarray) -> np.ndarray:
        """(C, U, 6) N, Nm -> (C, U, 6) innovations in standard deviations, 0 where nothing was measured.

        Series (C, U, 1) are the same in every channel.
        """
        return np.ascontiguousarray(self.by_channel(series.transpose(2, 0, 1)).transpose(1, 2, 0))

    def by_channel(self, series: np.ndarray) -> np.ndarray:
        """Innovations with channels first: (6, C, U), or (1, C, U) if the same in every channel -> (6, C, U)."""
        channels, count, used = series.shape
        _, n, length, _ = self.inside.shape
        y, white = (np.zeros((k, count, n * length), self.inside.dtype) for k in (channels, 6))
        y[:, :, :used] = series
        # Segments by series of one channel: with bins adjacent in memory, all else is a matter of strides.
        here, out = (x.reshape(-1, count, n, length).transpose(0, 2, 3, 1) for x in (y, white))
        # Pulses and steps are zero at first, and so are their innovations.
        begins = int(series.any((0, 1)).argmax()) // length if channels == 1 else 0
        inside, entering, leaving, passing = (matrices[:, begins:] for matrices in self)
        here, out = here[:, begins:], out[:, begins:]
        kicks = leaving @ here
        states = np.zeros_like(kicks)
        for k in range(n - begins - 1):
            states[:, k + 1] = passing[:, k] @ states[:, k] + kicks[:, k]
        np.matmul(inside, here, out=out)
        out += entering @ states
        return white[:, :, :used]


def make_whitener(problem: WrenchProblem, used: int) -> Whitener:
    """Matrices of the bias filter of one log that has ``used`` bins before the padding."""
    n = -(-used // SEGMENT_BINS)
    gains, weight = (_filled(x, n) for x in recursion(problem, used))
    dt = _filled(np.asarray(problem.dt)[:used], n)
    lanes = SEGMENT_BINS + 2  # a unit reading in each bin of the segment, then a unit bias and a unit drift before it
    white, (bias, drift) = np.zeros((SEGMENT_BINS, n, 6, lanes)), np.zeros((2, n, 6, lanes))
    bias[..., SEGMENT_BINS], drift[..., SEGMENT_BINS + 1] = 1, 1
    for j in range(SEGMENT_BINS):
        bias += dt[:, j, None, None] * drift
        innovation = -bias
        innovation[..., j] += 1
        white[j] = weight[:, j, :, None] * innovation
        bias += gains[:, j, 0, :, None] * innovation
        drift += gains[:, j, 1, :, None] * innovation
    by_all, states = white.transpose(2, 1, 0, 3), np.stack([bias, drift]).transpose(2, 1, 0, 3)
    parts = (
        by_all[..., :SEGMENT_BINS],
        by_all[..., SEGMENT_BINS:],
        states[..., :SEGMENT_BINS],
        states[..., SEGMENT_BINS:],
    )
    return Whitener(*(np.ascontiguousarray(part) for part in parts))


def recursion(problem: WrenchProblem, used: int) -> tuple[np.ndarray, np.ndarray]:
    """Kalman gains (U, 2, k) of bias and drift, 1 and 1/s, and (U, k) inverse standard deviations of the innovations.

    The process noise is that of ``process_models.drift_noise``, increased where the sensor was set to zero. Both
    results are 0 where nothing was measured. The k axes are six, or those of several densities side by side.
    """
    dt, variance = np.asarray(problem.dt)[:used], np.asarray(problem.variance)[:used]
    variance = np.where(np.isfinite(np.asarray(problem.wrench)[:used]), variance, np.inf)
    one, zero = np.ones_like(dt), np.zeros_like(dt)
    # Transition of the variance of the bias, its covariance with the drift, and the variance of the drift.
    steps = np.array([[one, 2 * dt, dt**2], [zero, one, dt], [zero, zero, one]]).transpose(2, 0, 1)
    noises = np.stack([dt**3 / 3, dt**2 / 2, dt], 1)[:, :, None] * np.asarray(problem.density) ** 2
    axes = variance.shape[1]
    prior = np.asarray(problem.prior_std).reshape(2, axes) ** 2
    state = np.stack([prior[0], np.zeros(axes), prior[1]])
    jump = np.zeros((used, axes)) if problem.jump is None else np.asarray(problem.jump)[:used]
    gains, spread = np.zeros((used, 2, axes)), np.zeros((used, axes))
    for k in range(used):
        state = steps[k] @ state + noises[k]
        state[0] += jump[k]
        spread[k] = state[0] + variance[k]
        gains[k] = state[:2] / spread[k]
        state = state - gains[k, [0, 0, 1]] * state[[0, 1, 1]]
    return gains, 1 / np.sqrt(spread)


def _filled(x: np.ndarray, n: int) -> np.ndarray:
    """(U, ...) -> (n, STRETCH, ...), padded with zeros at the end."""
    room = np.zeros((n * SEGMENT_BINS - len(x), *x.shape[1:]))
    return np.concatenate([x, room]).reshape(n, SEGMENT_BINS, *x.shape[1:])
