"""The Kalman filter of bias, drift and slow error on the means of blocks, for many sets of noise at once."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.io.clock import LONG_PAUSE
from ftbias_jax.runtime.compiled_loops import compile_whole
from ftbias_jax.runtime.kept_programs import keep_program
from ftbias_jax.types import Array

if TYPE_CHECKING:
    from jaxtyping import Float

SHORTEST = 1e-5
"""Length of a block in correlation times, below which it is a point, as far as numbers can tell."""
NEVER = 1e-3
"""Share of the drift that reverts in a block, below which it does not."""


class Grid(NamedTuple):
    """Parameters of G filters for each of six axes; (G, 6)."""

    white: Array
    std: Array
    time: Array


class Filtered(NamedTuple):
    """Blocks after they were used; (N, G, 6)."""

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
    """A Gauss-Markov process of variance 1 over a block, given its value at the beginning."""

    kept: Array
    """What of that value is left at the end."""
    mean: Array
    """What of it is in the mean over the block."""
    scatter: Array
    """Variance of that mean about it."""
    cross: Array
    """Covariance of the mean with the value at the end."""


class _Sets(NamedTuple):
    """What a filter of blocks is given beside them, (G * 6,) each."""

    white: Array
    time: Array
    stationary: Array
    density: Array
    drift_rate: Array | None
    block: Averaged
    bias_std: Array
    drift_std: Array


def filter_blocks(
    seconds: float | Array,
    t: Float[Array, " N"],
    y: Float[Array, "N 6"],
    variance: Float[Array, "N 6"],
    grid: Grid,
    prior_std: Float[Array, "2 6"],
    density: Array,
    drift_rate: Array | None = None,
) -> Filtered:
    """Filter the means of blocks.

    The Kalman filter of (bias, drift, slow error at the end of the block), over all sets at once. What is measured is
    the mean of the slow error over the block, which is smoother than the error itself (``Averaged``); the bias hardly
    curves within a block, so its mean is its value in the middle.

    Args:
        seconds: length of a block.
        t: (N,) s, middles of blocks.
        y: (N, 6); NaN = not measured.
        variance: (N, 6).
        grid: the sets.
        prior_std: (2, 6) of bias and drift.
        density: (6,) or (G, 6) sigma_Q.
        drift_rate: 1/s at which the drift reverts to zero, (G, 6); None = never.
    """
    shape, count = grid.std.shape, len(t)

    def lanes(x: Array | float) -> Array:
        return jnp.broadcast_to(x, shape).reshape(-1)

    block = Averaged(*map(lanes, averaged(seconds / grid.time)))
    white, time, stationary, strength = map(lanes, (grid.white, grid.time, grid.std**2, density))
    rate = None if drift_rate is None else lanes(drift_rate)
    sets = _Sets(white, time, stationary, strength, rate, block, *map(lanes, prior_std))
    h = jnp.diff(t, prepend=t[:1])[:, None]
    of_blocks = (jnp.tile(x, (1, shape[0])) for x in (y, jnp.where(jnp.isfinite(variance), variance, 1)))
    found = _filter(sets, h, jnp.maximum(h - seconds, 0), *of_blocks)
    return Filtered(*(x.reshape(count, *shape) for x in found))


def filter_series(
    t: np.ndarray, y: np.ndarray, variance: np.ndarray, grid: Grid, prior_std: Array, density: Array, rate: Any = None
) -> Filtered:
    """``filter_blocks`` of NumPy arrays, as long as the usual distance between them; lengths share a few programs."""
    count = len(t)
    more = room_for(count) - count
    seconds = np.asarray(np.median(np.diff(t)) if count > 1 else 1.0)
    t = np.cumsum(np.minimum(np.diff(t, prepend=t[:1]), LONG_PAUSE))
    y, variance = (np.pad(x, [(0, more), (0, 0)], constant_values=np.nan) for x in (y, variance))
    rate = None if rate is None else np.broadcast_to(rate, grid.std.shape)
    found = _program(seconds, np.pad(t, (0, more), mode="edge"), y, variance, grid, prior_std, density, rate)
    return Filtered(*(np.asarray(x)[:count] for x in found))


def room_for(count: int) -> int:
    """Blocks of the shortest program that takes so many: 64, 96, 128, 192 and so on."""
    half = 1 << max(0, (count - 1).bit_length() - 1)
    return max(64, half + half // 2 if count <= half + half // 2 else 2 * half)


_program = keep_program()(filter_blocks)


def _filter(sets: _Sets, h: Array, pause: Array, y: Array, variance: Array) -> Filtered:
    """Blocks (N, G * 6): h (N, 1) s after the middle of the one before, pause (N, 1) s after its end."""

    @compile_whole
    def loop(sets: _Sets, h: Array, pause: Array, y: Array, variance: Array) -> Filtered:
        zero, block, q = jnp.zeros_like(sets.white), sets.block, sets.density**2

        def step(state: Any, sample: Any) -> tuple[Any, Filtered]:
            (b, d, g), (bb, bd, bg, dd, dg, gg) = state
            h, pause, y, variance = sample
            # The bias to the middle of this block; the slow error, through a pause if there is one, to its beginning.
            f = jnp.exp(-pause / sets.time)
            moved, kept, of_bias, cross, of_drift = drift_over(h, sets.drift_rate)
            b, d, g = b + moved * d, kept * d, f * g
            bb, bg = bb + 2 * moved * bd + moved**2 * dd + of_bias * q, f * (bg + moved * dg)
            bd, dd = kept * (bd + moved * dd) + cross * q, kept**2 * dd + of_drift * q
            dg, gg = f * kept * dg, sets.stationary + f**2 * (gg - sets.stationary)
            seen = jnp.isfinite(y)
            v = jnp.where(seen, y - b - block.mean * g, jnp.nan)
            to_b, to_d, to_g = bb + block.mean * bg, bd + block.mean * dg, bg + block.mean * gg
            s = to_b + block.mean * to_g + block.scatter * sets.stationary + sets.white * variance
            to_g = block.kept * to_g + block.cross * sets.stationary
            g, bg, dg = block.kept * g, block.kept * bg, block.kept * dg
            gg = sets.stationary + block.kept**2 * (gg - sets.stationary)
            w, by = jnp.where(seen, 1 / s, 0), jnp.where(seen, v, 0)
            b, d, g = b + to_b * w * by, d + to_d * w * by, g + to_g * w * by
            bb, bd, bg = bb - to_b * w * to_b, bd - to_b * w * to_d, bg - to_b * w * to_g
            dd, dg, gg = dd - to_d * w * to_d, dg - to_d * w * to_g, gg - to_g * w * to_g
            return ((b, d, g), (bb, bd, bg, dd, dg, gg)), Filtered(v, s, b, d, g)

        covariance = (sets.bias_std**2, zero, zero, sets.drift_std**2, zero, sets.stationary)
        return jax.lax.scan(step, ((zero, zero, zero), covariance), (h, pause, y, variance))[1]

    found: Filtered = loop(sets, h, pause, y, variance)
    return found


def drift_over(h: Array, rate: Array | None) -> tuple[Any, ...]:
    """``process_models.reverting_drift`` over h s: entries of A and, for a density of 1, of Q.

    Returns:
        what of the drift goes into the bias, what is left of it, and variance of the bias, covariance and variance of
        the drift.
    """
    if rate is None:
        return h, 1, h**3 / 3, h**2 / 2, h
    x = rate * h
    e, near = -jnp.expm1(-jnp.where(x > NEVER, x, 1)), x <= NEVER
    safe = jnp.where(near, 1, x)
    moved = h * jnp.where(near, 1, e / safe)
    of_bias = h**3 * jnp.where(near, 1 / 3, (safe - 2 * e + e * (2 - e) / 2) / safe**3)
    of_drift = h * jnp.where(near, 1, e * (2 - e) / 2 / safe)
    return moved, jnp.where(near, 1, 1 - e), of_bias, moved**2 / 2, of_drift


def averaged(x: Array) -> Averaged:
    """Moments of the mean over a block x correlation times long.

    With the autocorrelation exp(-|u|) the value at the end of the block has the correlation (1 - exp(-x)) / x with its
    mean, and the mean the variance 2 (x - 1 + exp(-x)) / x^2; what the value at the beginning explains is taken off.
    """
    x = jnp.maximum(x, SHORTEST)
    kept = jnp.exp(-x)
    mean = (1 - kept) / x
    return Averaged(kept, mean, 2 * (x - 1 + kept) / x**2 - mean**2, mean * (1 - kept))
