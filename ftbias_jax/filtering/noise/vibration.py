"""Noise of single samples, at rest and in motion, from the scatter within blocks."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ftbias_jax.filtering.bias_filter import vibration, white_share
from ftbias_jax.filtering.noise.blocks import Blocks, Layout, nan_median
from ftbias_jax.filtering.noise.scatter import LEAST_LEVEL, Scatter, log_likelihood, maximise, variance_of
from ftbias_jax.model.motion_noise import MotionNoise, effective_speed_squared
from ftbias_jax.model.params import BiasNoise
from ftbias_jax.types import Array

SPEEDS = (np.inf, *(0.5 * 2.0**-k for k in range(7)))
"""rad/s, trial speeds above which vibration grows with the speed instead of its square; inf = never."""
ROUNDS, ROUNDS_TO_COMPARE = 10, 5
"""Scoring steps of the fit, and of the fits that only choose between forms."""
FOLD_SECONDS = 5.0
"""s: length of the segments that go to the two cross-validation folds in turn."""
LEAST_GAIN = 10.0
"""nats on the held-out fold, over all axes, below which the log does not show that its noise grows with motion."""
MOST_BLOCKS = 2000
"""Number of blocks taken, evenly, from a longer log: they give the variance to a percent; more would take minutes."""
LEVEL_WITHIN = 0.1
"""Relative deviation of the log's variance from the stated one up to which the stated one is used."""


class Shares(NamedTuple):
    """Ratio of the log's scatter to each part of the stated variance; (6,), 1 = as stated."""

    sensor: Float[Array, " 6"]
    """Share of the sensor's own variance."""
    rest: Float[Array, " 6"]
    """Share of all other variance, mostly of the joints; at rest a log shows less than is stated, in motion not."""


class Vibration(NamedTuple):
    """Variance of a sample at rest, and the variance that the speed of each joint adds."""

    level: Float[Array, " 6"]
    """Variance of the sensor at rest, relative to the stated one; 1 where the log agrees."""
    per_speed: Float[Array, "n 6"]
    """N^2/(rad/s)^2, Nm^2/(rad/s)^2, not negative."""
    speed: Float[Array, ""] | None
    """rad/s from which it grows with the speed alone (``motion_noise.effective_speed_squared``); inf, None = never."""
    gain: Float[Array, ""]
    """nats on held-out segments, gain of ``per_speed`` over a constant."""
    shares: Shares
    """Shares of the stated parts except vibration, together with ``per_speed``."""
    taken: Array
    """() whether the filter uses ``level`` and ``per_speed``. Where the setup states vibration, only the judgement of
    innovations uses ``per_speed`` instead, because its form may differ from the stated one."""

    def variance(self, blocks: Blocks, sensor: Float[Array, " 6"]) -> Float[Array, "N 6"]:
        """Variance (N, 6) N^2, Nm^2 of a sample in each block; ``sensor`` is the stated one of the sensor alone."""
        motion = effective_speed_squared(jnp.sqrt(blocks.motion), self.speed) @ self.per_speed
        more = jnp.asarray((self.level - 1) * sensor)[None] + motion
        return blocks.stated + jnp.where(self.taken, more, 0)


def fit_vibration(
    blocks: Blocks, layout: Layout, free: Float[Array, " N"], sensor: Float[Array, " 6"], taken: bool = True
) -> Vibration:
    """Fit the variance of samples by maximum likelihood: the scatter of a block is Gamma distributed about the model.

    Whether motion matters, and above which speed it matters less, is decided on held-out segments. Only blocks without
    contact (``free``) count. ``sensor`` is the stated variance of the sensor alone, N^2, Nm^2; the filter uses the
    result (``taken``) unless the setup states the noise in motion.
    """
    blocks, free, every = _thinned(blocks, free)
    dof, value = blocks.count - 2.0, blocks.scatter
    usable = free[:, None] & (dof > 0) & jnp.isfinite(value) & (blocks.stated > 0)
    dof, value = jnp.where(usable, dof, 0), jnp.where(usable, value, 1)
    calm = jnp.where(usable, blocks.stated - blocks.shaking, sensor[None])
    middle = nan_median(jnp.where(usable[:, None], jnp.stack([value, calm], 1), jnp.nan))
    usual, stated = jnp.nan_to_num(middle[0], nan=1.0), jnp.nan_to_num(middle[1])
    speed = jnp.sqrt(blocks.motion)  # the speed hardly changes in a block
    speeds = jnp.stack([effective_speed_squared(speed, most) for most in SPEEDS])
    fold = (jnp.arange(len(blocks.t)) // jnp.maximum(1, jnp.round(FOLD_SECONDS / layout.seconds / every))) % 2
    sides = jnp.stack([fold == 0, fold == 1])[:, :, None]
    # Form and level are estimated relative to the whole stated variance, because its parts are separated less reliably.
    choices = jnp.concatenate([jnp.zeros_like(speeds[:1]), speeds])
    fitted = maximise(Scatter(value, dof[None] * sides, (calm,), choices, usual), ROUNDS_TO_COMPARE)
    unseen = Scatter(value, dof[None] * sides[::-1], (calm,), choices, usual)
    nats = log_likelihood(unseen, variance_of(unseen, fitted)).sum(1)
    best = nats[1:].argmax()
    gain = nats[1 + best] - nats[0]
    moves = gain > LEAST_GAIN
    motion = jnp.where(moves, speeds[best], 0)[None]
    # The whole and its parts are fitted with two columns each; for the whole the second one is zero.
    sensors = jnp.broadcast_to(sensor[None], calm.shape)
    columns = jnp.stack([jnp.stack([calm, sensors]), jnp.stack([jnp.zeros_like(calm), jnp.maximum(calm - sensors, 0)])])

    both = jax.lax.map(lambda x: maximise(Scatter(value, dof[None], x, motion, usual), ROUNDS), tuple(columns))
    shares, (_, parts) = both.shares[:, 0, 0], both.per_speed[:, 0, 0]
    seen, used = (dof > 0).any(0), dof > 0
    share = shares[0, :, 0]
    level = jnp.where(seen & taken, _sensor_level(share, stated, sensor), 1)
    as_stated = ~seen | (jnp.abs(share - 1) < LEVEL_WITHIN)
    usual = jnp.where(used, calm, 0).sum(0) / jnp.maximum(used.sum(0), 1)
    per_speed = parts.T
    noticed = per_speed * motion[0].mean(0)[:, None] > 1e-3 * usual[None]
    shown = [jnp.where(as_stated, 1, jnp.maximum(shares[1, :, k], LEAST_LEVEL)) for k in (0, 1)]
    speed = jnp.where(moves, jnp.asarray(SPEEDS, calm.dtype)[best], jnp.inf)
    return Vibration(
        level, jnp.where(seen[None] & noticed & moves, per_speed, 0), speed, gain, Shares(*shown), jnp.asarray(taken)
    )


def _thinned(blocks: Blocks, free: Array) -> tuple[Blocks, Array, Array]:
    """At most MOST_BLOCKS blocks, whether they are free of contact, and the step between blocks that are taken."""
    every = jnp.maximum(1, -(-blocks.number // MOST_BLOCKS))
    if len(blocks.t) <= MOST_BLOCKS:
        return blocks, free, every
    rows = jnp.arange(MOST_BLOCKS) * every
    there, rows = rows < blocks.number, jnp.minimum(rows, len(blocks.t) - 1)
    columns = jax.tree.map(lambda x: x[rows], blocks._replace(number=blocks.t))
    return columns._replace(number=there.sum()), free[rows] & there, every


def _sensor_level(level: Array, stated: Array, sensor: Array) -> Array:
    """Level of the sensor's own variance from the level of the whole variance.

    The joints' errors last longer than a block, so its scatter may lack their share: a deficit smaller than that share
    does not make the sensor better than stated.
    """
    more, less = 1 + (level - 1) * stated / sensor, jnp.minimum(level * stated / sensor, 1)
    found = jnp.maximum(jnp.where(level > 1, more, less), LEAST_LEVEL)
    return jnp.where(jnp.abs(found - 1) < LEVEL_WITHIN, 1, found)


def taken_level(found: Vibration) -> Float[Array, " 6"]:
    """Sensor variance that the filter uses, relative to the stated one; never less than 1.

    On recorded logs with less noise than stated, a filter that uses the lower level rejects more of the readings and
    reports a smaller error of the bias than it has.
    """
    return jnp.where(found.taken, jnp.maximum(found.level, 1), 1)


def taken_variance(
    stated: BiasNoise, found: Vibration, variance: Float[Array, "T 6"], velocity: Float[Array, "T n"]
) -> Float[Array, "T 6"]:
    """Diagonal of R that the filter uses, N^2, Nm^2, without correlated noise; never less than is stated.

    ``found`` is the vibration found in the log with the stated noise, of which ``variance`` is the diagonal of R.
    """
    more = ((taken_level(found) - 1) * stated.wrench_variance)[None] + _growth(stated, found, velocity)
    return variance + jnp.where(found.taken, more, 0)


def shown_variance(
    stated: BiasNoise, found: Vibration, variance: Float[Array, "T 6"], velocity: Float[Array, "T n"]
) -> Float[Array, "T 6"]:
    """Diagonal of R, N^2, Nm^2, as the log's scatter shows it, which may be less; arguments as for ``taken_variance``.

    The bias and its error bars use the stated noise, at least. The noise of the next reading is taken from the log: at
    rest, for example, the joints add less noise than in the motion that determines theirs.
    """
    sensor, shares = stated.wrench_variance[None], found.shares
    shaking = stated_shaking(stated, velocity)
    # An effect of the setup may make the sensor quieter than stated; the remainder is then zero, not negative.
    rest = jnp.maximum(variance - sensor - (0 if shaking is None else shaking), 0)
    return shares.sensor[None] * sensor + shares.rest[None] * rest + _growth(stated, found, velocity)


def stated_shaking(stated: BiasNoise, velocity: Float[Array, "T n"]) -> Float[Array, "T 6"] | None:
    """White vibration, N^2, Nm^2, that the setup states, at the velocities in rad/s; None = none."""
    motion = vibration(stated, velocity)
    return None if motion is None else white_share(stated, motion)


def _growth(stated: BiasNoise, found: Vibration, velocity: Array) -> Array:
    """White vibration (T, 6) N^2, Nm^2 that the log shows."""
    return white_share(stated, MotionNoise(found.per_speed, found.speed).variance(velocity))
