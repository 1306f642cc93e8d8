"""Errors that vary slowly, of the model more than of the sensor: a first-order Gauss-Markov process on each axis.

A filter that knows white noise alone averages such errors as if they were new at every sample, and claims to know the
bias to a hundredth of what it does. How large they are and how long they last is found by likelihood, on the means of
blocks: fast noise averages out there, and a log is a few hundred numbers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ftbias_jax.filtering.adapt.block_filter import Grid, filter_blocks
from ftbias_jax.filtering.adapt.blocks import unmeasured_axes
from ftbias_jax.types import Array

MOST_BLOCKS = 1000
LEAST_GAIN = 12.0
"""nats on an axis, below which its noise is white."""
RATIOS, TIMES = 0.3 * 2.0 ** np.arange(7), 8
"""Standard deviations of the slow error that are tried, in those of a block's mean, and how many correlation times.
Large and long is likely wherever small and short is, so a coarse grid misses the top of that ridge."""
WHITE = np.array([1.0, 4.0])
"""Factors of the variance of a block's mean that are tried: vibration is not quite white."""


class SlowNoise(NamedTuple):
    """First-order Gauss-Markov noise; (6,)."""

    std: Array
    """N, Nm; 0 where the noise is white."""
    time: Array
    """s, correlation time."""
    gain: Array
    """nats over white noise."""


def fit_slow_noise(t: Array, y: Array, variance: Array, density: Array, prior_std: Array) -> SlowNoise:
    """Search a grid, then a finer one around its best point.

    Args:
        t: (N,) s, middles of blocks.
        y: (N, 6) N, Nm, means of the measured bias; NaN = not measured, or in contact.
        variance: (N, 6) N^2, Nm^2 of those means if the noise is white.
        density: (6,) sigma_Q of the bias.
        prior_std: (12,) square root of P_0.
    """
    t, y, variance = coarser(t, y, variance)
    span, step = t[-1] - t[0], float(np.median(np.diff(t)))
    with unmeasured_axes():
        unit = np.nan_to_num(np.sqrt(np.nanmedian(np.where(np.isfinite(y), variance, np.nan), axis=0)))
    times = np.geomspace(2 * step, max(span / 6, 4 * step), TIMES)
    white, ratio, time = (x.ravel()[:, None] for x in np.meshgrid(WHITE, np.r_[0, RATIOS], times, indexing="ij"))
    grid = Grid(*(np.broadcast_to(x, (len(x), 6)) for x in (white, ratio * unit, time)))
    start = (prior_std.reshape(2, 6), density)
    nats = log_likelihoods(t, y, variance, grid, *start)
    best = nats.argmax(0)
    for spread in (0.5, 0.2):
        at = Grid(*(x[best, np.arange(6)] for x in grid))
        near = np.exp(spread * np.linspace(-2, 2, 5))
        a, b, c = (x.ravel()[:, None] for x in np.meshgrid(near[1:4], near, near, indexing="ij"))
        grid = Grid(a * at.white, b * np.where(at.std > 0, at.std, 0.1 * unit), c * at.time)
        nats = log_likelihoods(t, y, variance, grid, *start)
        best = nats.argmax(0)
    at = Grid(*(x[best, np.arange(6)] for x in grid))
    # White noise of any level, as finely searched: what is gained must be due to the correlation.
    levels = np.broadcast_to(np.geomspace(0.25, 16, 25)[:, None], (25, 6))
    plain = log_likelihoods(t, y, variance, Grid(levels, 0 * levels, 1 + 0 * levels), *start)
    gain = nats.max(0) - plain.max(0)
    slow = gain > LEAST_GAIN
    return SlowNoise(np.where(slow, at.std, 0), np.where(slow, np.clip(at.time, step, span), 1.0), gain)


def log_likelihoods(t: Array, y: Array, variance: Array, grid: Grid, prior_std: Array, density: Array) -> Array:
    """(G, 6) nats of the means of blocks, for every set of parameters; arguments as for ``filter_blocks``."""
    found = filter_blocks(t, y, variance, grid, prior_std, density)
    return nats_of(found.innovation, found.variance)


def nats_of(v: Array, s: Array) -> Array:
    """(G, 6) nats of innovations (N, G, 6) N, Nm, NaN = not measured, with these variances."""
    nats: Array = -np.where(np.isfinite(v), np.log(s) + np.nan_to_num(v) ** 2 / s, 0).sum(0) / 2
    return nats


def coarser(t: Array, y: Array, variance: Array) -> tuple[Array, Array, Array]:
    """Neighbouring blocks joined until there are at most MOST_BLOCKS.

    Args:
        t: (N,) s.
        y: (N, 6) means of blocks; NaN = not measured.
        variance: (N, 6) of them.
    """
    join = -(-len(t) // MOST_BLOCKS)
    if join == 1:
        return t, y, variance
    number = len(t) // join
    times, values, spread = (x[: number * join].reshape(number, join, *x.shape[1:]) for x in (t, y, variance))
    weight = np.where(np.isfinite(values), 1 / spread, 0)
    total = weight.sum(1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(total > 0, (weight * np.nan_to_num(values)).sum(1) / total, np.nan)
        return times.mean(1), mean, np.where(total > 0, 1 / total, np.nan)
