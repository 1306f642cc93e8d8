"""A bias that wanders more than stated: its density by likelihood on block means, and a test that it is the bias.

A model error that follows a smooth motion is also described by a wandering bias. But it returns with the motion,
whereas doubly integrated white noise departs further the longer the log is.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ftbias_jax.filtering.noise.block_filter import Grid, Means, filter_blocks
from ftbias_jax.filtering.noise.slow_noise import LEAST_GAIN, LEVELS, nats_of
from ftbias_jax.types import Array

FACTORS = 2.0 ** np.arange(-1, 15)
"""Trial densities, in units of the stated ones."""
LEAST_WENT, LEAST_WENT_OF_ALL = 0.01, 0.1
"""Smallest ratio of the bias's mean-square departure from a straight line to that expected at the fitted density: on an
axis, and in the mean over all that wander. It is smaller in 1 of 1000 logs, with three axes in 4 of 1000."""


class Wander(NamedTuple):
    """How much the bias of each axis wanders; (6,)."""

    density: Float[Array, " 6"]
    """N/s^1.5, Nm/s^1.5: most likely density."""
    gain: Float[Array, " 6"]
    """nats, gain of log-likelihood over the stated density with white noise of any level."""
    wanders: Bool[Array, " 6"]
    """Whether the gain exceeds chance and the bias departs as far as this density implies."""


def fit_wander(means: Means, density: Float[Array, " 6"], prior_std: Float[Array, "2 6"]) -> Wander:
    """Most likely density of each axis; density: as stated; prior_std: square root of P_0, of bias and drift."""
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
    """Axes, among those that wander, on which the bias goes far enough; none if it does not in the mean over these.

    ``went`` is the ratio of its mean-square departure from a straight line to that expected; NumPy or JAX.
    """
    xp = went.__array_namespace__()
    wanders = wanders & (went > LEAST_WENT)
    of_all = xp.where(wanders, went, 0).sum() / xp.maximum(wanders.sum(), 1)
    return wanders & (of_all > LEAST_WENT_OF_ALL)


def departures(t: Float[Array, " N"], y: Float[Array, "N 6"], variance: Float[Array, "N 6"]) -> tuple[Array, Array]:
    """Mean-square departure (6,) of a bias y from a straight line, and that expected for unit density; NumPy or JAX.

    Doubly integrated white noise over T departs from its own line by sigma_Q^2 T^3 / 420. The variance is of the noise
    of y; NaN = not measured.
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
