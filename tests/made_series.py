"""Measured biases simulated with known noise, for the tests of what is estimated from a log."""

import jax
import numpy as np

from ftbias_jax.filtering.noise.blocks import Blocks, in_blocks, layout_of

cut = jax.jit(in_blocks, static_argnums=0)

STD = np.repeat([0.1, 0.004], 3)
"""N, Nm: standard deviation of one sample."""


def stamps(seconds, rate):
    """Stamps (T,) in s."""
    return np.arange(round(seconds * rate)) / rate


def gauss_markov(rng, t, std, time):
    """(T, len(std)) first-order Gauss-Markov noise, exact for equal intervals."""
    kept = np.exp(-(t[1] - t[0]) / time)
    kicks = rng.normal(size=(len(t), len(std))) * std
    x = np.empty_like(kicks)
    x[0] = kicks[0]
    for k in range(1, len(t)):
        x[k] = kept * x[k - 1] + np.sqrt(1 - kept**2) * kicks[k]
    return x


def wandering(rng, t, density):
    """(T, 6) white noise of these densities (6,), integrated twice by the sums that define it."""
    dt = np.diff(t, prepend=t[0])[:, None]
    drift = np.cumsum(density * np.sqrt(dt) * rng.normal(size=(len(t), 6)), 0)
    return np.cumsum(dt * drift, 0)


def free_motion(rng, t, std=STD):
    """(T, 6) N, Nm: an offset, a drift, and white noise."""
    drift = 0.02 * std * rng.normal(size=6)
    return 20 * std * rng.normal(size=6) + drift * t[:, None] + std * rng.normal(size=(len(t), 6))


def blocks_of(t, y, std=STD, velocity=None):
    """A log in blocks and their layout, with stated white noise and by default at rest."""
    velocity = np.zeros((len(t), 2)) if velocity is None else velocity
    layout = layout_of(np.diff(t))
    return cut(layout, t, y, velocity, np.broadcast_to(np.asarray(std) ** 2, y.shape)), layout


def made_blocks(t, mean, variance, count=25):
    """Blocks at rest with these means (N, 6) and these variances of a sample (6,)."""
    ones = np.ones_like(mean)
    motion, number = np.zeros((len(t), 2)), np.asarray(len(t))
    return Blocks(t, mean, count * ones, variance * ones, motion, variance * ones, 0 * ones, number)


def padded(blocks, more=37):
    """The same blocks, followed by padding."""
    rows = Blocks(*(np.pad(x, [(0, more), *[(0, 0)] * (x.ndim - 1)], mode="edge") for x in blocks[:-1]), blocks.number)
    return rows._replace(mean=np.concatenate([blocks.mean, np.full((more, 6), np.nan)]))
