"""Noise that grows with motion, from the scatter within blocks."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ftbias_jax.filtering.adapt.blocks import Blocks
from ftbias_jax.types import Array

ROUNDS = 300
FOLD_SECONDS = 5.0
"""Stretches that go to the two folds in turn."""
LEAST_GAIN = 10.0
"""nats on the unseen fold, over all axes, below which the log does not show that its noise grows with motion."""
HEAVY = 30.0
"""A scatter this many times the usual is no vibration but a spike: it is cut to that."""


class Vibration(NamedTuple):
    """Variance of a sample: at rest, and what the squared speed of each joint adds."""

    rest: Array
    """(6,) N^2, Nm^2 beyond what is stated; 0 where the stated noise is enough."""
    per_speed: Array
    """(n, 6) N^2/(rad/s)^2, Nm^2/(rad/s)^2, not negative."""
    gain: float
    """nats on unseen stretches, of ``per_speed`` over a constant."""


def fit_vibration(blocks: Blocks, free: Array) -> Vibration:
    """Variance of samples by maximum likelihood: the scatter of a block is Gamma distributed about the model.

    Args:
        blocks: of the log.
        free: (N,) blocks in which nothing touches.
    """
    dof, scatter, stated = blocks.count - 2.0, blocks.scatter, blocks.stated
    usable = free[:, None] & (dof > 0) & np.isfinite(scatter)
    dof, scatter = np.where(usable, dof, 0), np.where(usable, scatter, 1)
    step = float(np.median(np.diff(blocks.t))) if len(blocks.t) > 1 else 1.0
    fold = (np.arange(len(blocks.t)) // max(1, round(FOLD_SECONDS / step))) % 2
    constant = np.ones((len(blocks.t), 1))
    moving = np.concatenate([constant, blocks.motion], 1)
    gain = 0.0
    for seen in (0, 1):
        here, there = np.where((fold == seen)[:, None], dof, 0), np.where((fold != seen)[:, None], dof, 0)
        both = [stated + X @ _maximise(X, stated, scatter, here) for X in (moving, constant)]
        gain += float(_nats(both[0], scatter, there) - _nats(both[1], scatter, there))
    if gain < LEAST_GAIN:
        return Vibration(_maximise(constant, stated, scatter, dof)[0], np.zeros((blocks.motion.shape[1], 6)), gain)
    found = _maximise(moving, stated, scatter, dof)
    return Vibration(found[0], found[1:], gain)


def _maximise(X: Array, stated: Array, scatter: Array, dof: Array) -> Array:
    """(k, 6) non-negative coefficients of X (N, k) that are likeliest, by multiplicative steps that never lose.

    The likelihood of scatter about stated + X b is that of the Itakura-Saito divergence (Fevotte, Bertin and Durrieu
    2009), whose multiplicative step with an exponent of 1/2 does not decrease it.
    """
    scale = np.maximum(np.mean(X, 0), 1e-12)[:, None]
    usual = np.median(np.where(dof > 0, scatter, np.nan)[np.isfinite(scatter).all(1)], axis=0)
    b = np.nan_to_num(usual, nan=1.0)[None] / scale / len(X.T)
    for _ in range(ROUNDS):
        mu = stated + X @ b
        cut = np.minimum(scatter, HEAVY * mu)
        up, down = X.T @ (dof * cut / mu**2), X.T @ (dof / mu)
        b = b * np.sqrt(up / np.maximum(down, 1e-300))
    return np.where(b * scale > 1e-3 * np.mean(stated, 0)[None], b, 0)


def _nats(mu: Array, scatter: Array, dof: Array) -> float:
    """Log-likelihood of the scatter, up to a constant."""
    return float(-(dof * (np.log(mu) + np.minimum(scatter / mu, HEAVY))).sum() / 2)
