"""Noise that grows with motion, from the scatter within blocks."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ftbias_jax.filtering.adapt.blocks import SPEEDS, Blocks
from ftbias_jax.types import Array

ROUNDS = 300
FOLD_SECONDS = 5.0
"""Stretches that go to the two folds in turn."""
LEAST_GAIN = 10.0
"""nats on the unseen fold, over all axes, below which the log does not show that its noise grows with motion."""
HEAVY = 6.0
"""A scatter this many times the usual is no vibration but a spike: it is cut to that."""

MOST_BLOCKS = 4000
"""Of a longer log as many are taken, evenly: they tell the variance to a percent, and more would take minutes."""
LEVEL_WITHIN = 0.1
"""The stated variance is believed if the log's is within this share of it."""
LEAST_LEVEL = 0.01
"""Of the stated variance: less is a reading that stands still, or repeats itself."""


class Vibration(NamedTuple):
    """Variance of a sample: at rest, and what the speed of each joint adds."""

    level: Array
    """(6,) variance of the sensor without motion, in what is stated; 1 where the log agrees."""
    per_speed: Array
    """(n, 6) N^2/(rad/s)^2, Nm^2/(rad/s)^2, not negative."""
    speed: float | None
    """rad/s at which it stops growing (``bias_filter.effective_speed_squared``); None = never."""
    gain: float
    """nats on unseen stretches, of ``per_speed`` over a constant."""

    def variance(self, blocks: Blocks, sensor: Array) -> Array:
        """(N, 6) N^2, Nm^2 of a sample in each block; sensor (6,) is what is stated of the sensor alone."""
        motion = blocks.motion[:, SPEEDS.index(self.speed)] @ self.per_speed
        found: Array = blocks.stated + (self.level - 1) * sensor + motion
        return found


def fit_vibration(blocks: Blocks, free: Array, sensor: Array) -> Vibration:
    """Variance of samples by maximum likelihood: the scatter of a block is Gamma distributed about the model.

    Whether motion matters, and at which speed it stops to, is judged on stretches that were not fitted.

    Args:
        blocks: of the log.
        free: (N,) blocks in which nothing touches.
        sensor: (6,) N^2, Nm^2, variance that is stated of the sensor alone, without the joints' share.
    """
    every = max(1, -(-len(blocks.t) // MOST_BLOCKS))
    blocks = Blocks(size=blocks.size, **{x: getattr(blocks, x)[::every] for x in Blocks._fields if x != "size"})
    free = free[::every]
    dof, scatter = blocks.count - 2.0, blocks.scatter
    usable = free[:, None] & (dof > 0) & np.isfinite(scatter) & (blocks.stated > 0)
    dof, scatter = np.where(usable, dof, 0), np.where(usable, scatter, 1)
    step = float(np.median(np.diff(blocks.t))) if len(blocks.t) > 1 else 1.0
    fold = (np.arange(len(blocks.t)) // max(1, round(FOLD_SECONDS / step))) % 2
    nothing = np.zeros((len(blocks.t), 0))
    nats = []
    for motion in (nothing, *np.moveaxis(blocks.motion, 1, 0)):
        unseen = 0.0
        for side in (0, 1):
            here, there = (np.where((fold == which)[:, None], dof, 0) for which in (side, 1 - side))
            found = _maximise(blocks.stated, motion, scatter, here)
            unseen += _nats(_variance(blocks.stated, motion, found), scatter, there)
        nats.append(unseen)
    best = int(np.argmax(nats[1:]))
    gain = nats[1 + best] - nats[0]
    moves = gain > LEAST_GAIN
    found = _maximise(blocks.stated, blocks.motion[:, best] if moves else nothing, scatter, dof)
    level = np.where((dof > 0).any(0), _sensor_level(found[0], np.median(blocks.stated, axis=0), sensor), 1)
    per_speed = found[1:] if moves else np.zeros((blocks.motion.shape[2], 6))
    return Vibration(level, per_speed, SPEEDS[best] if moves else None, gain)


def _sensor_level(level: Array, stated: Array, sensor: Array) -> Array:
    """The level of the whole variance as one of the sensor's alone.

    The joints' errors last longer than a block, so its scatter may lack their share: what is missing of less than that
    share does not make the sensor better than stated.
    """
    more, less = 1 + (level - 1) * stated / sensor, np.minimum(level * stated / sensor, 1)
    found = np.maximum(np.where(level > 1, more, less), LEAST_LEVEL)
    return np.where(np.abs(found - 1) < LEVEL_WITHIN, 1, found)


def _variance(stated: Array, motion: Array, coefficients: Array) -> Array:
    # Never zero, as an axis that stands still would have it.
    found: Array = np.maximum(coefficients[0] * stated + motion @ coefficients[1:], LEAST_LEVEL * 1e-3 * stated)
    return found


def _maximise(stated: Array, motion: Array, scatter: Array, dof: Array) -> Array:
    """(1 + n, 6) non-negative coefficients that are likeliest, by multiplicative steps that never lose.

    The likelihood of the scatter is that of the Itakura-Saito divergence (Fevotte, Bertin and Durrieu 2009), whose
    multiplicative step with an exponent of 1/2 does not decrease it.
    """
    columns = zip(scatter.T, dof.T, strict=True)
    usual = np.array([np.median(x[there > 0]) if (there > 0).any() else 1.0 for x, there in columns])
    scale = np.maximum(motion.mean(0), 1e-12)[:, None]
    b = np.concatenate([(usual / np.mean(stated, 0))[None] / 2, usual[None] / scale / 2 / max(1, len(scale))])
    seen = (dof > 0).any(0)
    for _ in range(ROUNDS):
        mu = _variance(stated, motion, b)
        down, up = dof / mu, dof * np.minimum(scatter, HEAVY * mu) / mu**2
        slopes = [np.concatenate([(stated * x).sum(0)[None], motion.T @ x]) for x in (up, down)]
        b = np.where(seen, b * np.sqrt(slopes[0] / np.maximum(slopes[1], 1e-300)), b)
    b[0] = np.where(seen, b[0], 1)
    b[1:] = np.where(seen & (b[1:] * scale > 1e-3 * np.mean(stated, 0)[None]), b[1:], 0)
    return b


def _nats(mu: Array, scatter: Array, dof: Array) -> float:
    """Log-likelihood of the scatter, up to a constant."""
    return float(-(dof * (np.log(mu) + np.minimum(scatter / mu, HEAVY))).sum() / 2)
