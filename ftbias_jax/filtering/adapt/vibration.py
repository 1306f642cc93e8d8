"""Noise of single samples, at rest and in motion, from the scatter within blocks."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ftbias_jax.filtering.adapt.blocks import SPEEDS, Blocks
from ftbias_jax.filtering.adapt.scatter import LEAST_LEVEL, Scatter, log_likelihood, maximise, variance_of
from ftbias_jax.types import Array

ROUNDS, ROUNDS_TO_COMPARE = 300, 100
"""Of the fit, and of those that only choose between forms."""
FOLD_SECONDS = 5.0
"""Stretches that go to the two folds in turn."""
LEAST_GAIN = 10.0
"""nats on the unseen fold, over all axes, below which the log does not show that its noise grows with motion."""
MOST_BLOCKS = 4000
"""Of a longer log as many are taken, evenly: they tell the variance to a percent, and more would take minutes."""
LEVEL_WITHIN = 0.1
"""The stated variance is believed if the log's is within this share of it."""


class Shares(NamedTuple):
    """How much of each part of the stated variance the scatter of a log shows; (6,), 1 = as stated."""

    sensor: Array
    """Of the sensor's own."""
    rest: Array
    """Of all else, mostly of the joints: at rest a log shows less of it than is stated, in motion not."""


class Vibration(NamedTuple):
    """Variance of a sample: at rest, and what the speed of each joint adds."""

    level: Array
    """(6,) variance of the sensor without motion, in what is stated; 1 where the log agrees."""
    per_speed: Array
    """(n, 6) N^2/(rad/s)^2, Nm^2/(rad/s)^2, not negative."""
    speed: float | None
    """rad/s from which it grows with the speed alone (``motion_noise.effective_speed_squared``); None = never."""
    gain: float
    """nats on unseen stretches, of ``per_speed`` over a constant."""
    shares: Shares
    """Of the stated parts but vibration, beside ``per_speed``."""
    taken: bool = True
    """The filter takes ``level`` and ``per_speed``; where the setup states vibration, only innovations are judged by
    ``per_speed``, in its place, because its form may be another than the stated."""

    def variance(self, blocks: Blocks, sensor: Array) -> Array:
        """(N, 6) N^2, Nm^2 of a sample in each block; sensor (6,) is what is stated of the sensor alone."""
        if not self.taken:
            return blocks.stated
        motion = blocks.motion[:, SPEEDS.index(self.speed)] @ self.per_speed
        found: Array = blocks.stated + (self.level - 1) * sensor + motion
        return found


def fit_vibration(blocks: Blocks, free: Array, sensor: Array, taken: bool = True) -> Vibration:
    """Variance of samples by maximum likelihood: the scatter of a block is Gamma distributed about the model.

    Whether motion matters, and from which speed on it does less, is judged on stretches that were not fitted.

    Args:
        blocks: of the log.
        free: (N,) blocks in which nothing touches.
        sensor: (6,) N^2, Nm^2, variance that is stated of the sensor alone, without the joints' share.
        taken: by the filter, too; not where the setup states the noise in motion.
    """
    every = max(1, -(-len(blocks.t) // MOST_BLOCKS))
    blocks = Blocks(size=blocks.size, **{x: getattr(blocks, x)[::every] for x in Blocks._fields if x != "size"})
    free = free[::every]
    dof, value = blocks.count - 2.0, blocks.scatter
    usable = free[:, None] & (dof > 0) & np.isfinite(value) & (blocks.stated > 0)
    dof, value = np.where(usable, dof, 0), np.where(usable, value, 1)
    step = float(np.median(np.diff(blocks.t))) if len(blocks.t) > 1 else 1.0
    fold = (np.arange(len(blocks.t)) // max(1, round(FOLD_SECONDS / step))) % 2
    calm = blocks.stated - blocks.shaking
    parts = Scatter(value, dof, (np.broadcast_to(sensor, calm.shape), np.maximum(calm - sensor, 0)))
    # The form is chosen, and the level read, in what is stated as a whole: its parts are told apart less surely.
    whole = parts._replace(stated=(calm,))
    still = np.zeros((len(blocks.t), 0))

    def nats(motion: Array) -> float:
        """Of both folds, each with the variance of the other."""
        unseen = 0.0
        for side in (0, 1):
            found = maximise(whole.only(fold == side), motion, ROUNDS_TO_COMPARE)
            unseen += log_likelihood(whole.only(fold != side), variance_of(whole.stated, motion, found))
        return unseen

    best, gain = _best_speed(blocks.motion, nats)
    moves = gain > LEAST_GAIN
    motion = blocks.motion[:, best] if moves else still
    found = maximise(whole, motion, ROUNDS)
    seen = (dof > 0).any(0)
    level = np.where(seen & taken, _sensor_level(found.shares[0], np.median(calm, axis=0), sensor), 1)
    as_stated = ~seen | (np.abs(found.shares[0] - 1) < LEVEL_WITHIN)
    found = maximise(parts, motion, ROUNDS)
    per_speed = found.per_speed if moves else np.zeros((blocks.motion.shape[2], 6))
    shares = Shares(*np.where(as_stated, 1, np.maximum(found.shares, LEAST_LEVEL)))
    return Vibration(level, per_speed, SPEEDS[best] if moves else None, gain, shares, taken)


def _best_speed(motion: Array, nats: Callable[[Array], float]) -> tuple[int, float]:
    """Index into SPEEDS and the gain over no motion: every third of them is tried, then the neighbours of the best."""
    tried = {k: nats(motion[:, k]) for k in range(0, len(SPEEDS), 3)}
    best = max(tried, key=lambda k: tried[k])
    tried |= {k: nats(motion[:, k]) for k in range(best - 2, best + 3) if 0 <= k < len(SPEEDS) and k not in tried}
    best = max(tried, key=lambda k: tried[k])
    return best, tried[best] - nats(motion[:, 0, :0])


def _sensor_level(level: Array, stated: Array, sensor: Array) -> Array:
    """The level of the whole variance as one of the sensor's alone.

    The joints' errors last longer than a block, so its scatter may lack their share: what is missing of less than that
    share does not make the sensor better than stated.
    """
    more, less = 1 + (level - 1) * stated / sensor, np.minimum(level * stated / sensor, 1)
    found = np.maximum(np.where(level > 1, more, less), LEAST_LEVEL)
    return np.where(np.abs(found - 1) < LEVEL_WITHIN, 1, found)
