"""Errors that vary slowly, of the model more than of the sensor: a first-order Gauss-Markov process on each axis.

A filter that knows white noise alone averages such errors as if they were new at every sample, and claims to know the
bias to a hundredth of what it does. How large they are and how long they last is found by likelihood, on the means of
blocks: fast noise averages out there, and a log is a few hundred numbers.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ftbias_jax.filtering.adapt.blocks import unmeasured_axes
from ftbias_jax.types import Array

MOST_BLOCKS = 1000
LEAST_GAIN = 12.0
"""nats on an axis, below which its noise is white."""
RATIOS = np.array([0.3, 1.0, 4.0, 16.0])
"""Standard deviations of the slow error that are tried, in those of a block's mean."""
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


class Grid(NamedTuple):
    """Parameters of G filters for each of six axes; (G, 6)."""

    white: Array
    std: Array
    time: Array


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
    times = np.geomspace(2 * step, max(span / 6, 4 * step), 6)
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
    """(G, 6) nats of the means of blocks, for every set of parameters; arguments as for ``innovations``."""
    total = np.zeros(grid.std.shape)
    for v, s in innovations(t, y, variance, grid, prior_std, density):
        total = total - np.where(np.isfinite(v), np.log(s) + np.nan_to_num(v) ** 2 / s, 0) / 2
    return total


def innovations(
    t: Array, y: Array, variance: Array, grid: Grid, prior_std: Array, density: Array
) -> Iterator[tuple[Array, Array]]:
    """Innovation (G, 6), NaN = not measured, and its variance, block by block.

    The Kalman filter of ``process_models.correlated_bias`` without a drift that reverts, over all sets at once.

    Args:
        t: (N,) s.
        y: (N, 6); NaN = not measured.
        variance: (N, 6).
        grid: the sets.
        prior_std: (2, 6) of bias and drift.
        density: (6,) sigma_Q.
    """
    shape = grid.std.shape
    zero = np.zeros(shape)
    z, d, g = zero, zero, zero
    stationary = grid.std**2
    zz, zd, zg = prior_std[0] ** 2 + stationary, zero, stationary
    dd, dg, gg = prior_std[1] ** 2 + zero, zero, stationary
    q = density**2
    for k, h in enumerate(np.diff(t, prepend=t[0])):
        f = np.exp(-h / grid.time)
        # A P A^T + Q for A = [[1, h, f - 1], [0, 1, 0], [0, 0, f]].
        e, noise = f - 1, stationary * (1 - f**2)
        z, g = z + h * d + e * g, f * g
        row_z = zz + h * zd + e * zg, zd + h * dd + e * dg, zg + h * dg + e * gg
        zz = row_z[0] + h * row_z[1] + e * row_z[2] + h**3 / 3 * q + noise
        zd, zg = row_z[1] + h**2 / 2 * q, f * row_z[2] + noise
        dd, dg, gg = dd + h * q, f * dg, f**2 * gg + noise
        seen = np.isfinite(y[k])[None]
        s = zz + grid.white * np.nan_to_num(variance[k])
        v = np.where(seen, y[k] - z, np.nan)
        yield v, s
        w, v = np.where(seen, 1 / s, 0), np.where(seen, v, 0)
        a, b, c = zz * w, zd * w, zg * w
        z, d, g = z + a * v, d + b * v, g + c * v
        zz, zd, zg, dd, dg, gg = zz - a * zz, zd - a * zd, zg - a * zg, dd - b * zd, dg - b * zg, gg - c * zg


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
