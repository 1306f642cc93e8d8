"""Kalman filter of bias, drift and slow error on the means of blocks, for many sets of noise parameters together."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ftbias_jax.filtering.process_models import BiasStrength, reverting_drift
from ftbias_jax.filtering.samples import room_for
from ftbias_jax.io.stamps.clock import LONG_PAUSE
from ftbias_jax.runtime.compiled_loops import compile_whole
from ftbias_jax.runtime.kept_programs import keep_program
from ftbias_jax.types import Array

SHORTEST = 1e-5
"""Shortest length of a block in correlation times; a shorter one is numerically a point."""


class Means(NamedTuple):
    """Means of N blocks, to which a log is reduced for the estimation of slow noise."""

    seconds: Float[Array, ""]
    """s, length of a block."""
    t: Float[Array, " N"]
    """s, middles of blocks."""
    y: Float[Array, "N 6"]
    """N, Nm, means of the measured bias; NaN = not measured, or in contact."""
    variance: Float[Array, "N 6"]
    """N^2, Nm^2, variance of these means if the noise is white."""


class Grid(NamedTuple):
    """Parameters (G, 6) of G filters on six axes: factor of the white variance, std and time of the slow error."""

    white: Array
    std: Array
    time: Array


class Filtered(NamedTuple):
    """State and innovation at every block after its update; (N, G, 6)."""

    innovation: Array
    """N, Nm; NaN = not measured."""
    variance: Array
    """N^2, Nm^2, of the innovation."""
    bias: Array
    """N, Nm."""
    drift: Array
    """N/s, Nm/s."""
    slow: Array
    """N, Nm, slow error at the end of the block."""


class Averaged(NamedTuple):
    """Coefficients of a Gauss-Markov process of variance 1 averaged over a block, given its value at the beginning."""

    kept: Array
    """Factor of that value in the value at the end."""
    mean: Array
    """Factor of that value in the mean over the block."""
    scatter: Array
    """Variance of the mean given that value."""
    cross: Array
    """Covariance of the mean with the value at the end, given that value."""


def filter_blocks(
    means: Means, grid: Grid, prior_std: Float[Array, "2 6"], density: Array, drift_rate: Array | None = None
) -> Filtered:
    """Filter the means of blocks.

    This is the Kalman filter of (bias, drift, slow error at the end of the block), for all sets together. It measures
    the mean of the slow error over the block, which is smoother than the error itself (``Averaged``); the bias hardly
    curves within a block, so its mean is its value in the middle. The density sigma_Q is (6,) or (G, 6), the rate at
    which the drift reverts to zero, 1/s, (G, 6).
    """
    (seconds, t, y, variance), shape = means, grid.std.shape
    sets = (grid, averaged(seconds / grid.time), BiasStrength(density, drift_rate), tuple(prior_std))
    sets = jax.tree.map(lambda x: jnp.broadcast_to(x, shape).reshape(-1), sets)
    h = jnp.diff(t, prepend=t[:1])[:, None]
    of_blocks = (jnp.tile(x, (1, shape[0])) for x in (y, jnp.where(jnp.isfinite(variance), variance, 1)))
    found = _filter(sets, h, jnp.maximum(h - seconds, 0), *of_blocks)
    return Filtered(*(x.reshape(len(t), *shape) for x in found))


def filter_series(
    t: np.ndarray, y: np.ndarray, variance: np.ndarray, grid: Grid, prior_std: Array, density: Array, rate: Any = None
) -> Filtered:
    """``filter_blocks`` of NumPy arrays, with blocks as long as their usual distance; lengths share a few programs."""
    count = len(t)
    more = room_for(count, 64) - count
    seconds = np.asarray(np.median(np.diff(t)) if count > 1 else 1.0)
    t = np.pad(np.cumsum(np.minimum(np.diff(t, prepend=t[:1]), LONG_PAUSE)), (0, more), mode="edge")
    y, variance = (np.pad(x, [(0, more), (0, 0)], constant_values=np.nan) for x in (y, variance))
    rate = None if rate is None else np.broadcast_to(rate, grid.std.shape)
    found = _program(Means(seconds, t, y, variance), grid, prior_std, density, rate)
    return Filtered(*(np.asarray(x)[:count] for x in found))


_program = keep_program()(filter_blocks)


@compile_whole
def _filter(sets: Any, h: Array, pause: Array, y: Array, variance: Array) -> Filtered:
    """Filter blocks (N, G * 6): h (N, 1) s since the middle of the previous one, pause (N, 1) s since its end."""
    grid, block, strength, (bias_std, drift_std) = sets
    zero, stationary = jnp.zeros_like(grid.std), grid.std**2

    def step(state: Any, sample: Any) -> tuple[Any, Filtered]:
        (b, d, g), (bb, bd, bg, dd, dg, gg) = state
        h, pause, y, variance = sample
        # Predict the bias to the middle of this block and the slow error, through any pause, to its beginning.
        f = jnp.exp(-pause / grid.time)
        ((_, moved), (_, kept)), ((of_bias, cross), (_, of_drift)) = reverting_drift(h, strength)
        b, d, g = b + moved * d, kept * d, f * g
        bb, bg = bb + 2 * moved * bd + moved**2 * dd + of_bias, f * (bg + moved * dg)
        bd, dd = kept * (bd + moved * dd) + cross, kept**2 * dd + of_drift
        dg, gg = f * kept * dg, stationary + f**2 * (gg - stationary)
        seen = jnp.isfinite(y)
        v = jnp.where(seen, y - b - block.mean * g, jnp.nan)
        to_b, to_d, to_g = bb + block.mean * bg, bd + block.mean * dg, bg + block.mean * gg
        s = to_b + block.mean * to_g + block.scatter * stationary + grid.white * variance
        to_g = block.kept * to_g + block.cross * stationary
        g, bg, dg = block.kept * g, block.kept * bg, block.kept * dg
        gg = stationary + block.kept**2 * (gg - stationary)
        w, by = jnp.where(seen, 1 / s, 0), jnp.where(seen, v, 0)
        b, d, g = b + to_b * w * by, d + to_d * w * by, g + to_g * w * by
        bb, bd, bg = bb - to_b * w * to_b, bd - to_b * w * to_d, bg - to_b * w * to_g
        dd, dg, gg = dd - to_d * w * to_d, dg - to_d * w * to_g, gg - to_g * w * to_g
        return ((b, d, g), (bb, bd, bg, dd, dg, gg)), Filtered(v, s, b, d, g)

    covariance = (bias_std**2, zero, zero, drift_std**2, zero, stationary)
    return jax.lax.scan(step, ((zero, zero, zero), covariance), (h, pause, y, variance))[1]


def averaged(x: Array) -> Averaged:
    """Moments of the mean over a block that is x correlation times long.

    With the autocorrelation exp(-|u|), the value at the end of the block has the correlation (1 - exp(-x)) / x with its
    mean, and the mean the variance 2 (x - 1 + exp(-x)) / x^2; the part explained by the value at the beginning is
    subtracted.
    """
    x = jnp.maximum(x, SHORTEST)
    kept = jnp.exp(-x)
    mean = (1 - kept) / x
    return Averaged(kept, mean, 2 * (x - 1 + kept) / x**2 - mean**2, mean * (1 - kept))
