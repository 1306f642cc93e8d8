"""The noise of one log, where the setup leaves it open: contact, vibration, slow errors, and enlarged error bars."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float

from ftbias_jax.filtering.noise.block_filter import Grid, Means, filter_blocks
from ftbias_jax.filtering.noise.blocks import Blocks, Layout, nan_median
from ftbias_jax.filtering.noise.contact import Contacts, find_contacts
from ftbias_jax.filtering.noise.free_motion import hidden_bias
from ftbias_jax.filtering.noise.levels import slow_std
from ftbias_jax.filtering.noise.scatter import HEAVY
from ftbias_jax.filtering.noise.slow_noise import SlowNoise, fit_slow_noise, join_blocks
from ftbias_jax.filtering.noise.tool_force import error_of_tool_force, with_tool_as_seen
from ftbias_jax.filtering.noise.vibration import Vibration, fit_vibration, taken_level
from ftbias_jax.filtering.noise.wander import fit_wander
from ftbias_jax.model.params import BiasNoise
from ftbias_jax.runtime.compiled_loops import running_sum
from ftbias_jax.types import Array

BATCHES = (0.25, 1.0, 5.0)
"""s: durations over which the means of the innovations must scatter as the filter predicts."""
CHANCE = 3.0
"""Standard deviations attributed to chance, because six axes and three durations are tested."""
FEWEST_BATCHES = 8
CORRELATION = 3.0
"""Standard deviations of the correlation of neighbours that chance does not reach."""
SETTLED = 0.5
"""s at the start that are excluded, because the prior dominates there."""
FIRST, FAR = 5, 4.0
"""Blocks at the start whose median is the initial bias, and prior standard deviations beyond which it is an offset."""
TINY = 1e-30
"""N^2, Nm^2: replaces a stated variance of zero; also representable in float32."""
MAD = 1.4826
"""Ratio of standard deviation to median absolute deviation of normally distributed numbers."""


class Noise(NamedTuple):
    """Noise that a log shows beyond its setup."""

    contacts: Contacts
    vibration: Vibration
    slow: SlowNoise
    """Slow error; as stated, if the setup states it."""
    density: Float[Array, " 6"]
    """N/s^1.5, Nm/s^1.5: density of a bias that wanders more than stated, 0 on axes where it does not."""
    offset: Float[Array, " 6"]
    """N, Nm: bias at the start minus the prior's mean on axes where the prior does not expect it, 0 elsewhere."""
    inflation: Float[Array, " 6"]
    """Factor, 1 or more, on the standard deviations of bias and drift that the innovations still contradict."""
    hidden: Float[Array, " 6"]
    """N, Nm: possible error of the bias because the tool is touched throughout, or may be while it seems free; 0 where
    the log has free motion."""
    tool_error: Float[Array, ""]
    """Relative error of the tool's force as stated, that the reading shows in motion; 0 = none that is significant."""
    block_times: Float[Array, " N"]
    """s, middles of the blocks."""


def fit_noise(stated: BiasNoise, blocks: Blocks, layout: Layout) -> tuple[BiasNoise, Noise]:
    """Noise of the filter for this log: what the setup states, and estimates from the log where that is left open.

    Gradients pass through what is stated; estimates from the log count as constant. The blocks are of the whole log.
    """
    given, (stated, blocks) = stated, jax.lax.stop_gradient((stated, blocks))
    as_seen = with_tool_as_seen(blocks, layout)
    contacts = find_contacts(as_seen, layout, slow_std(as_seen, layout))
    offset = offset_of(blocks, slow_std(blocks, layout), stated)
    free = ~contacts.near & (jnp.arange(len(blocks.t)) < blocks.number)
    sensor = jnp.maximum(stated.wrench_variance, TINY)
    vibration = fit_vibration(blocks, layout, free, sensor, taken=stated.vibration is None)
    # Means of the blocks that are free of contact, minus the bias that the prior expects.
    variance = vibration.variance(blocks, stated.wrench_variance)
    calm = ~(blocks.scatter > HEAVY * variance)  # a spike moves the mean of its block as well
    y = jnp.where(free[:, None] & calm, blocks.mean - expected(blocks.t, stated), jnp.nan)
    variance = jnp.where(jnp.isfinite(y), variance / jnp.maximum(blocks.count, 1), jnp.nan)
    means = join_blocks(Means(jnp.asarray(layout.seconds, y.dtype), blocks.t, y, variance), blocks.number)
    prior_std = prior_with(stated, offset).reshape(2, 6)

    def innovations(slow: SlowNoise, density: Array) -> Array:
        """Innovations (N, 6) of blocks, in their standard deviations."""
        grid = Grid(jnp.ones((1, 6), means.y.dtype), slow.std[None], slow.time[None])
        found = filter_blocks(means, grid, prior_std, jnp.maximum(density, stated.density))
        return found.innovation[:, 0] / jnp.sqrt(found.variance[:, 0])

    if stated.correlated_std is None or stated.correlated_time is None:
        zero = jnp.zeros(6, means.y.dtype)
        white = SlowNoise(zero, zero + 1, zero)
        of_white = innovations(white, zero)
        factor = inflation(means.t, of_white)

        def fitted() -> tuple[SlowNoise, Array, Array]:
            slow = fit_slow_noise(means, stated.density, prior_std)
            wander = fit_wander(means, stated.density, prior_std)
            likelier = jnp.maximum(wander.gain, 0).sum() > jnp.maximum(slow.gain, 0).sum()
            wanders = wander.wanders & likelier
            slow = SlowNoise(*(jnp.where(wanders, x, y) for x, y in zip(white, slow, strict=True)))
            density = jnp.where(wanders, wander.density, 0)
            return slow, density, inflation(means.t, innovations(slow, density))

        settled = is_white(of_white) & (factor == 1).all()
        slow, density, factor = jax.lax.cond(settled, lambda: (white, zero, factor), fitted)
    else:
        slow = SlowNoise(stated.correlated_std, stated.correlated_time, jnp.zeros(6, means.y.dtype))
        density = jnp.zeros(6, means.y.dtype)
        factor = inflation(means.t, innovations(slow, density))
    hidden = contacts.undecided
    if blocks.tool is not None:
        hidden = jnp.maximum(hidden, hidden_bias(blocks, blocks.tool, layout, stated))
    tool_error = error_of_tool_force(blocks, free, layout)
    noise = Noise(contacts, vibration, slow, density, offset, factor, hidden, tool_error, blocks.t)
    return with_noise(given, noise), noise


def is_white(innovation: Float[Array, "N 6"]) -> Bool[Array, ""]:
    """Whether innovations of blocks show no correlation."""
    count = jnp.maximum(jnp.isfinite(innovation).sum(0), 1)
    neighbours = jnp.nansum(innovation[1:] * innovation[:-1], axis=0) / count
    return (neighbours < CORRELATION / jnp.sqrt(count)).all()


def expected(t: Float[Array, " N"], stated: BiasNoise) -> Float[Array, "N 6"]:
    """Bias (N, 6) N, Nm that the prior expects at the times t, in s, if its drift continues.

    The block filters estimate deviations from it, because a sharp prior far from zero is not an error of the model.
    """
    return stated.prior_mean[None, :6] + (t - t[0])[:, None] * stated.prior_mean[None, 6:12]


def offset_of(blocks: Blocks, slow: Float[Array, " 6"], stated: BiasNoise) -> Float[Array, " 6"]:
    """Measured bias of the first blocks minus the prior's mean, (6,) N, Nm; 0 if it is not FAR from it on any axis.

    What moves the bias of one axis that far, such as a restart or another temperature, moves the others as well.

    Raw readings of some sensors have offsets of kilonewtons, which a filter would reject as contact forever. But a
    slightly wrong model is off by as much as it varies later on, and that is not an offset.
    """
    unmeasured = ~jnp.isfinite(blocks.mean).any(1)
    rows = jnp.argsort(unmeasured, stable=True)[:FIRST]
    first = nan_median(blocks.mean[rows])
    mean, std = stated.prior_mean[:6], stated.prior_std[:6]
    usual = jnp.hypot(std, slow)
    offset = jnp.where(jnp.isnan(first), 0.0, first - mean)
    return jnp.where((jnp.abs(offset) > FAR * jnp.maximum(usual, 1e-12)).any(), offset, 0.0)


def prior_with(stated: BiasNoise, offset: Float[Array, " 6"]) -> Float[Array, " 12"]:
    """Square root of P_0, (12,), wide enough for the offset."""
    std = stated.prior_std
    return jnp.concatenate([jnp.maximum(std[:6], jnp.abs(offset)), std[6:]])


def inflation(t: Float[Array, " N"], white: Float[Array, "N 6"]) -> Float[Array, " 6"]:
    """Factor (6,) by which means of innovations scatter more than the filter predicts; 1 where chance explains it.

    ``white`` holds the innovations in their standard deviations at the times t, in s; NaN = not measured.
    """
    seen = jnp.isfinite(white) & (t - t[0] >= SETTLED)[:, None]
    values = jnp.stack([jnp.where(seen, white, 0), seen.astype(white.dtype)], 1)
    batch = jnp.floor((t - t[0] - SETTLED)[:, None] / jnp.asarray(BATCHES, t.dtype)[None])
    # Only batches with samples are numbered, because a log may pause for longer than the rest of it lasts.
    number = running_sum((jnp.diff(batch, axis=0, prepend=batch[:1]) != 0).astype(int))
    of_all = jax.vmap(lambda x, of: jax.ops.segment_sum(x, of, len(t)), (None, 1))(values, number)
    sums, counts = of_all[:, :, 0], of_all[:, :, 1]  # (3, N, 6)
    occupied = counts > 0
    batches = jnp.maximum(occupied.sum(1), 1)
    ratio = jnp.where(occupied, sums**2 / jnp.maximum(counts, 1), 0).sum(1) / batches
    chance = 1 + CHANCE * jnp.sqrt(2 / batches)  # of a mean chi-square variable
    enough = occupied.any(2).sum(1) >= FEWEST_BATCHES
    return jnp.where(enough[:, None] & (ratio > chance), jnp.sqrt(ratio), 1).max(0)


def with_noise(stated: BiasNoise, noise: Noise) -> BiasNoise:
    """Noise of the filter with what the log shows; terms that it does not show are present and zero."""
    bias = stated._replace(
        wrench_variance=stated.wrench_variance * taken_level(noise.vibration),
        density=jnp.maximum(noise.density, stated.density),
        prior_std=prior_with(stated, noise.offset),
        correlated_std=noise.slow.std,
        correlated_time=noise.slow.time,
    )
    if stated.vibration is None:
        bias = bias._replace(vibration=noise.vibration.per_speed, vibration_speed=noise.vibration.speed)
    return bias


def from_median(noise: BiasNoise, found: Noise, blocks: Blocks) -> BiasNoise:
    """Noise of a filter whose bias begins at the median of the log's free blocks, with their scatter as uncertainty."""
    measured = jnp.where(found.contacts.inside[:, None], jnp.nan, blocks.mean)
    median = nan_median(measured)
    scatter, seen = MAD * nan_median(jnp.abs(measured - median[None])), jnp.isfinite(median)
    mean, std = (
        jnp.concatenate([jnp.where(seen, x, before[:6]), before[6:]])
        for x, before in ((median, noise.prior_mean), (scatter, noise.prior_std))
    )
    return noise._replace(prior_mean=mean, prior_std=std)


def drop_zero_terms(noise: BiasNoise) -> BiasNoise:
    """The noise without vibration and slow errors that are zero, as a setup states it; of NumPy or JAX arrays."""
    if noise.correlated_std is not None and not noise.correlated_std.any():
        noise = noise._replace(correlated_std=None, correlated_time=None)
    if noise.vibration is not None and not noise.vibration.any():
        noise = noise._replace(vibration=None, vibration_speed=None)
    if noise.vibration_speed is not None and not jnp.isfinite(noise.vibration_speed):
        noise = noise._replace(vibration_speed=None)
    return noise
