"""A bias that wanders more than is stated: how much, by likelihood on the means of blocks, and whether it is the bias.

An error of the model that follows a smooth motion is described by a bias that wanders, too. But it comes back with the
motion, while white noise that is integrated twice goes the further the longer the log is.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ftbias_jax.filtering.noise.block_filter import Grid, Means, filter_blocks
from ftbias_jax.filtering.noise.slow_noise import LEAST_GAIN, LEVELS, nats_of
from ftbias_jax.types import Array

FACTORS = 2.0 ** np.arange(-1, 15)
"""Densities that are tried, in those that are stated."""
LEAST_WENT, LEAST_WENT_OF_ALL = 0.01, 0.1
"""Of the mean square by which a bias leaves a straight line, what one with the density that was found does leave it by:
on an axis, and in the mean over all that wander. Less in 1 of 1000 logs, with three axes in 4 of 1000."""


class Wander(NamedTuple):
    """How much the bias wanders; (6,)."""

    density: Float[Array, " 6"]
    """N/s^1.5, Nm/s^1.5."""
    gain: Float[Array, " 6"]
    """nats over the stated density with white noise of any level."""
    wanders: Bool[Array, " 6"]
    """Where that is more than chance, and the bias goes as far as it says."""


def fit_wander(means: Means, density: Float[Array, " 6"], prior_std: Float[Array, "2 6"]) -> Wander:
    """The likeliest density of each axis; density: as stated; prior_std: square root of P_0, of bias and drift."""
    count, dtype = len(FACTORS), density.dtype
    levels = jnp.repeat(jnp.asarray(np.r_[np.ones(count), LEVELS], dtype)[:, None], 6, 1)
    densities = jnp.asarray(np.r_[FACTORS, np.ones(len(LEVELS))], dtype)[:, None] * density[None]
    nats = nats_of(*filter_blocks(means, Grid(levels, 0 * levels, 1 + 0 * levels), prior_std, densities)[:2])
    octave, _ = most_likely(nats[:count])
    found, gain = density * float(FACTORS[0]) * 2**octave, nats[:count].max(0) - nats[count:].max(0)
    seen, expected = departures(means.t, means.y, means.variance)
    went = seen / jnp.maximum(expected * found**2, 1e-30)
    return Wander(found, gain, goes_far((gain > LEAST_GAIN) & (found > density), went))


def most_likely(nats: Float[Array, "G 6"]) -> tuple[Array, Array]:
    """Place (6,) of the largest of equally spaced nats, by a parabola through its neighbours, and its standard error.

    NumPy or JAX.
    """
    xp = nats.__array_namespace__()
    at = xp.clip(nats.argmax(0), 1, len(nats) - 2)
    low, top, high = (nats[at + i, xp.arange(6)] for i in (-1, 0, 1))
    bend = xp.maximum(2 * top - low - high, 1e-9)
    return at + xp.clip((high - low) / (2 * bend), -1, 1), 1 / xp.sqrt(bend)


def goes_far(wanders: Bool[Array, " 6"], went: Float[Array, " 6"]) -> Bool[Array, " 6"]:
    """Of axes that wander, those on which the bias goes far enough; none if it does not in the mean over these.

    How far it ``went`` is the mean square from a straight line per that of the density; NumPy or JAX.
    """
    xp = went.__array_namespace__()
    wanders = wanders & (went > LEAST_WENT)
    of_all = xp.where(wanders, went, 0).sum() / xp.maximum(wanders.sum(), 1)
    return wanders & (of_all > LEAST_WENT_OF_ALL)


def departures(t: Float[Array, " N"], y: Float[Array, "N 6"], variance: Float[Array, "N 6"]) -> tuple[Array, Array]:
    """How far a bias y goes from a straight line, mean square (6,), and one of unit density; NumPy or JAX.

    White noise that is integrated twice over T departs from its own line by sigma_Q^2 T^3 / 420. The variance is of
    the noise of y; NaN = not measured.
    """
    xp = y.__array_namespace__()
    seen = xp.isfinite(y)
    count = xp.maximum(seen.sum(0), 1)

    def mean(x: Array) -> Array:
        return xp.where(seen, x, 0).sum(0) / count

    t = t[:, None] - mean(t[:, None])[None]
    y = y - mean(y)[None]
    spread = xp.maximum(mean(t**2), 1e-12)
    departs = mean(y**2) - mean(t * y) ** 2 / spread - mean(variance)
    return xp.maximum(departs, 0), (12 * spread) ** 1.5 / 420  # evenly spread times have the variance T^2 / 12
