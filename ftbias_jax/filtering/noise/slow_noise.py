"""Errors that vary slowly, of the model more than of the sensor: a first-order Gauss-Markov process on each axis.

A filter that models only white noise averages such errors as if they were new at every sample, and reports an error of
the bias a hundred times too small. Their size and duration are estimated by maximum likelihood on the means of blocks:
fast noise averages out there, and a log is reduced to a few hundred numbers.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ftbias_jax.filtering.noise.block_filter import Grid, Means, filter_blocks
from ftbias_jax.filtering.noise.blocks import nan_median
from ftbias_jax.types import Array

MOST_BLOCKS = 1000
LEAST_GAIN = 12.0
"""nats on an axis below which its noise is taken as white."""
RATIOS, TIMES = 0.3 * 2.0 ** np.arange(7), 8
"""Trial standard deviations of the slow error, in those of a block's mean, and number of trial correlation times. A
large, long error is likely wherever a small, short one is, so a coarse grid misses the top of that ridge."""
WHITE = np.array([1.0, 4.0])
"""Trial factors of the variance of a block's mean, because vibration is not quite white."""
LEVELS = np.geomspace(0.25, 16, 25)
"""Trial factors of that variance where there is no slow error."""
SPREADS = (0.5, 0.2)
"""Logarithmic spacings of the two finer grids around the best point."""


class SlowNoise(NamedTuple):
    """First-order Gauss-Markov noise of each axis; (6,)."""

    std: Float[Array, " 6"]
    """N, Nm; 0 where the noise is white."""
    time: Float[Array, " 6"]
    """s, correlation time."""
    gain: Float[Array, " 6"]
    """nats, gain of log-likelihood over white noise."""


def fit_slow_noise(means: Means, density: Float[Array, " 6"], prior_std: Float[Array, "2 6"]) -> SlowNoise:
    """Fit slow noise by a grid search, refined twice around the best point.

    ``density`` is sigma_Q of the bias, ``prior_std`` the square root of P_0, of bias and drift.
    """
    span, step, axes = means.t[-1] - means.t[0], means.seconds, jnp.arange(6)
    unit = jnp.nan_to_num(jnp.sqrt(nan_median(jnp.where(jnp.isfinite(means.y), means.variance, jnp.nan))))
    times = jnp.geomspace(2 * step, jnp.maximum(span / 6, 4 * step), TIMES, dtype=unit.dtype)
    white, ratio = (x.ravel()[:, None] for x in np.meshgrid(WHITE, np.r_[0, RATIOS], indexing="ij"))
    # White noise of any level is searched as finely, so that a gain must be due to the correlation.
    levels = jnp.broadcast_to(jnp.asarray(LEVELS, unit.dtype)[:, None], (len(LEVELS), 6))
    plain = Grid(levels, 0 * levels, 1 + 0 * levels)

    def on_all(x: Array, repeats: int) -> Array:
        return jnp.broadcast_to(jnp.repeat(x, repeats, 0), (len(x) * repeats, 6))

    slow = Grid(
        on_all(jnp.asarray(white, unit.dtype), TIMES),
        on_all(jnp.asarray(ratio, unit.dtype) * unit[None], TIMES),
        jnp.broadcast_to(jnp.tile(times, len(ratio))[:, None], (TIMES * len(ratio), 6)),
    )
    number = len(slow.std)
    near = np.linspace(-2, 2, 5)
    steps = np.stack([x.ravel() for x in np.meshgrid(near[1:4], near, near, indexing="ij")])
    steps = np.pad(steps, [(0, 0), (0, number - steps.shape[1])])  # missing points repeat the middle

    def refine(slow: Grid, spread: Array) -> tuple[Grid, tuple[Grid, Array, Array]]:
        grid = Grid(*map(jnp.concatenate, zip(slow, plain, strict=True)))
        nats = nats_of(*filter_blocks(means, grid, prior_std, density)[:2])
        best = nats[:number].argmax(0)
        at = Grid(*(x[best, axes] for x in slow))
        a, b, c = jnp.exp(spread * jnp.asarray(steps, unit.dtype))[:, :, None]
        finer = Grid(a * at.white[None], b * jnp.where(at.std > 0, at.std, 0.1 * unit)[None], c * at.time[None])
        return finer, (at, nats[:number].max(0), nats[number:].max(0))

    _, (best, nats, flat) = jax.lax.scan(refine, slow, jnp.asarray([*SPREADS, 0.0], unit.dtype))
    gain, at = nats[-1] - flat[-1], jax.tree.map(lambda x: x[-1], best)
    slower = gain > LEAST_GAIN
    return SlowNoise(jnp.where(slower, at.std, 0), jnp.where(slower, jnp.clip(at.time, step, span), 1.0), gain)


def nats_of(v: Float[Array, "N G 6"], s: Float[Array, "N G 6"]) -> Float[Array, "G 6"]:
    """Log-likelihood, nats, of innovations N, Nm, NaN = not measured, with these variances."""
    seen = jnp.isfinite(v)
    return -jnp.where(seen, jnp.log(jnp.where(seen, s, 1)) + jnp.where(seen, v, 0) ** 2 / s, 0).sum(0) / 2


def join_blocks(means: Means, number: Array) -> Means:
    """Join neighbouring blocks until there are at most MOST_BLOCKS; ``number`` () of them belong to the log."""
    if len(means.t) <= MOST_BLOCKS:
        return means
    join = coarseness(number)
    index = jnp.arange(len(means.t))
    group = jnp.where(index < number // join * join, index // join, MOST_BLOCKS)

    def total(x: Array) -> Array:
        return jax.ops.segment_sum(x, group, MOST_BLOCKS + 1, indices_are_sorted=False)[:MOST_BLOCKS]

    seen = jnp.isfinite(means.y)
    weight = jnp.where(seen, 1 / jnp.where(seen, means.variance, 1), 0)
    all_weight, count = total(weight), total(jnp.ones_like(means.t))
    measured = all_weight > 0
    divisor = jnp.where(measured, all_weight, 1)
    mean = total(weight * jnp.where(seen, means.y, 0)) / divisor
    t = jnp.where(count > 0, total(means.t) / jnp.maximum(count, 1), 0)
    t = jax.lax.cummax(t)  # rows after the last block stay at its time
    y = jnp.where(measured, mean, jnp.nan)
    return Means(means.seconds * join, t, y, jnp.where(measured, 1 / divisor, jnp.nan))


def coarseness(number: Any) -> Any:
    """How many neighbouring blocks are joined into one, for this number of blocks."""
    return -(-number // MOST_BLOCKS) + (number == 0)
