"""Noise of single samples, at rest and in motion, from the scatter within blocks."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ftbias_jax.filtering.adapt.blocks import SPEEDS, Blocks
from ftbias_jax.types import Array

ROUNDS, ROUNDS_TO_COMPARE = 300, 100
"""Of the fit, and of those that only choose between forms."""
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


class Scatter(NamedTuple):
    """What a variance is fitted to: blocks of a log, N of them."""

    value: Array
    """(N, 6) N^2, Nm^2."""
    dof: Array
    """(N, 6); 0 = not to be used."""
    stated: tuple[Array, ...]
    """(N, 6) each: parts of the stated variance, of which the scatter may show any share."""

    def only(self, rows: Array) -> Scatter:
        """The rows marked in (N,) count, the others do not."""
        return self._replace(dof=np.where(rows[:, None], self.dof, 0))


class Coefficients(NamedTuple):
    """Of a variance, none negative."""

    shares: Array
    """(K, 6) of the stated parts."""
    per_speed: Array
    """(n, 6) of the motion."""


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
            found = _maximise(whole.only(fold == side), motion, ROUNDS_TO_COMPARE)
            unseen += _nats(_variance(whole.stated, motion, found), whole.only(fold != side))
        return unseen

    best, gain = _best_speed(blocks.motion, nats)
    moves = gain > LEAST_GAIN
    motion = blocks.motion[:, best] if moves else still
    found = _maximise(whole, motion)
    seen = (dof > 0).any(0)
    level = np.where(seen & taken, _sensor_level(found.shares[0], np.median(calm, axis=0), sensor), 1)
    as_stated = ~seen | (np.abs(found.shares[0] - 1) < LEVEL_WITHIN)
    found = _maximise(parts, motion)
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


def _variance(stated: tuple[Array, ...], motion: Array, coefficients: Coefficients) -> Array:
    # Never zero, as an axis that stands still would have it.
    known = sum(share * part for share, part in zip(coefficients.shares, stated, strict=True))
    found: Array = np.maximum(known + motion @ coefficients.per_speed, LEAST_LEVEL * 1e-3 * sum(stated))
    return found


def _maximise(data: Scatter, motion: Array, rounds: int = ROUNDS) -> Coefficients:
    """Non-negative coefficients that are likeliest, by multiplicative steps that never lose.

    The likelihood of the scatter is that of the Itakura-Saito divergence (Fevotte, Bertin and Durrieu 2009), whose
    multiplicative step with an exponent of 1/2 does not decrease it.

    Args:
        data: scatter of blocks.
        motion: (N, n) (rad/s)^2.
        rounds: steps.
    """
    dof, scatter, stated = data.dof, data.value, data.stated
    columns = zip(scatter.T, dof.T, strict=True)
    usual = np.array([np.median(x[there > 0]) if (there > 0).any() else 1.0 for x, there in columns])
    scale = np.maximum(motion.mean(0), 1e-12)[:, None]
    whole = np.mean(sum(stated), 0)
    shares = np.repeat((usual / whole)[None] / 2, len(stated), axis=0)
    per_speed = usual[None] / scale / 2 / max(1, len(scale))
    seen = (dof > 0).any(0)

    def of_shares(x: Array) -> Array:
        return np.stack([(part * x).sum(0) for part in stated])

    def of_motion(x: Array) -> Array:
        return motion.T @ x

    for _ in range(rounds):
        mu = _variance(stated, motion, Coefficients(shares, per_speed))
        down, up = dof / mu, dof * np.minimum(scatter, HEAVY * mu) / mu**2
        shares, per_speed = (
            np.where(seen, b * np.sqrt(slope(up) / np.maximum(slope(down), 1e-300)), b)
            for b, slope in ((shares, of_shares), (per_speed, of_motion))
        )
    shares = np.where(seen, shares, 1)
    kept = seen & (per_speed * scale > 1e-3 * whole)
    return Coefficients(shares, np.where(kept, per_speed, 0))


def _nats(mu: Array, data: Scatter) -> float:
    """Log-likelihood of the scatter, up to a constant."""
    return float(-(data.dof * (np.log(mu) + np.minimum(data.value / mu, HEAVY))).sum() / 2)
