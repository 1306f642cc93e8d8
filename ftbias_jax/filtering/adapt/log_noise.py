"""The noise of one log, where the setup leaves it open: contact, vibration, slow errors, and what is left."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from ftbias_jax.filtering.adapt.block_filter import Grid, filter_blocks
from ftbias_jax.filtering.adapt.blocks import Blocks, unmeasured_axes
from ftbias_jax.filtering.adapt.contact import Contact, find_contacts, in_contact, slow_std
from ftbias_jax.filtering.adapt.sample_noise import sensor_level
from ftbias_jax.filtering.adapt.scatter import HEAVY
from ftbias_jax.filtering.adapt.slow_noise import SlowNoise, coarser, fit_slow_noise
from ftbias_jax.filtering.adapt.vibration import Vibration, fit_vibration
from ftbias_jax.io.clock import LONG_PAUSE
from ftbias_jax.model.params import Params
from ftbias_jax.types import AXES, Array

BATCHES = (0.25, 1.0, 5.0)
"""s: means of the innovations over so long must scatter as the filter says."""
CHANCE = 3.0
"""Standard deviations of chance: six axes and three lengths are looked at."""
FEWEST_BATCHES = 8
CORRELATION = 3.0
"""Standard deviations of the correlation of neighbours that chance does not reach."""
SETTLED = 0.5
"""s at the start that do not count: the prior shows there."""
FIRST, FAR = 5, 4.0
"""Blocks at the start whose median is the bias there, and standard deviations of the prior that are too many."""
LEAST_BLOCKS = 40
"""A shorter log says nothing of its noise."""


class LogNoise(NamedTuple):
    """What a log shows beyond its setup."""

    contacts: tuple[Contact, ...]
    vibration: Vibration | None
    """None = the log is too short to say."""
    slow: SlowNoise | None
    """None = as the setup states."""
    offset: Array
    """(6,) N, Nm: the bias at the start on axes where the prior does not expect it, 0 elsewhere."""
    inflation: Array
    """(6,) factor, 1 or more, of the standard deviations of bias and drift: what the innovations still contradict."""
    begun_again: bool = False
    """Whether the bias begins at the log's median, because from the first readings the gate kept out most of it."""
    kept_out: float = 0.0
    """Share of the free samples that the gate keeps out wherever the bias begins; 0 = it keeps at least half."""


def nothing() -> LogNoise:
    """A log that is as its setup says."""
    return LogNoise((), None, None, np.zeros(6), np.ones(6))


@unmeasured_axes()
def noise_of_log(blocks: Blocks, params: Params) -> LogNoise:
    """Contact, vibration and slow errors of a log; what ``params`` states of them already is kept.

    Args:
        blocks: of the whole log, for these parameters.
        params: of the filter.
    """
    if len(blocks.t) < LEAST_BLOCKS:
        return nothing()
    contacts = tuple(find_contacts(blocks))
    offset = offset_of(blocks, params)
    block = blocks.t[1] - blocks.t[0]
    free = ~in_contact(blocks.t, list(contacts), block)
    sensor, slow = np.maximum(np.asarray(params.bias.wrench_variance, float), np.finfo(float).tiny), None
    vibration = fit_vibration(blocks, free, sensor, taken=params.bias.vibration is None)
    white = vibration.variance(blocks, sensor)
    with np.errstate(invalid="ignore"):
        calm = ~(blocks.scatter > HEAVY * white)  # a spike moves the mean of its block as well
    y = np.where(free[:, None] & calm, blocks.mean - expected(blocks.t, params), np.nan)
    variance = np.where(np.isfinite(y), white / np.maximum(blocks.count, 1), np.nan)
    bias = params.bias
    prior_std, density = prior_with(params, offset), np.asarray(bias.density, float)
    t = np.cumsum(np.minimum(np.diff(blocks.t, prepend=blocks.t[:1]), LONG_PAUSE))
    t, y, variance = coarser(t, y, variance)
    if bias.correlated_std is None or bias.correlated_time is None:
        std, time = np.zeros(6), np.ones(6)
        white_noise = standard_innovations(t, y, variance, (std, time), prior_std, density)
        if not is_white(t, white_noise):
            slow = fit_slow_noise(t, y, variance, density, prior_std)
            std, time = slow.std, slow.time
    else:
        std, time = np.asarray(bias.correlated_std, float), np.asarray(bias.correlated_time, float)
    found = standard_innovations(t, y, variance, (std, time), prior_std, density)
    return LogNoise(contacts, vibration, slow, offset, inflation(t, found))


def standard_innovations(
    t: Array, y: Array, variance: Array, noise: tuple[Array, Array], prior_std: Array, density: Array
) -> Array:
    """(N, 6) innovations of blocks in their standard deviations, for correlated noise (std, time), each (6,)."""
    std, time = noise
    grid = Grid(np.ones((1, 6)), std[None], time[None])
    found = filter_blocks(t, y, variance, grid, prior_std.reshape(2, 6), density)
    white: Array = found.innovation[:, 0] / np.sqrt(found.variance[:, 0])
    return white


def is_white(t: Array, innovation: Array) -> bool:
    """Whether innovations (N, 6) of blocks show neither correlation nor more scatter than white noise has."""
    with np.errstate(invalid="ignore"):
        count = np.isfinite(innovation).sum(0)
        neighbours = np.nansum(innovation[1:] * innovation[:-1], axis=0) / np.maximum(count, 1)
    return bool(
        (neighbours < CORRELATION / np.sqrt(np.maximum(count, 1))).all() and (inflation(t, innovation) == 1).all()
    )


def expected(t: Array, params: Params) -> Array:
    """(N, 6) N, Nm: the bias that the prior expects at the times t (N,) s, if its drift goes on.

    The filters of blocks know deviations from it: a prior that is sharp and far from zero is no error of the model.
    """
    mean = np.asarray(params.bias.prior_mean, float)
    return mean[:6] + (t - t[0])[:, None] * mean[6:12]


def offset_of(blocks: Blocks, params: Params) -> Array:
    """(6,) N, Nm: the measured bias of the first blocks, where it is FAR from what the prior expects; 0 elsewhere.

    Raw readings of some sensors have offsets of kilonewtons. A filter would reject them as contact for ever. But a
    model that is a little wrong is off by as much as it varies later on: that is no offset.
    """
    with np.errstate(invalid="ignore"):
        measured = blocks.mean[np.isfinite(blocks.mean).any(1)]
        first = np.nan_to_num(np.nanmedian(measured[:FIRST], axis=0))
    mean, std = np.asarray(params.bias.prior_mean, float)[:6], np.asarray(params.bias.prior_std, float)[:6]
    usual = np.hypot(std, slow_std(blocks))
    return np.where(np.abs(first - mean) > FAR * np.maximum(usual, 1e-12), first - mean, 0.0)


def prior_with(params: Params, offset: Array) -> Array:
    """(12,) square root of P_0, wide enough for the offset."""
    std = np.array(params.bias.prior_std, float)
    std[:6] = np.maximum(std[:6], np.abs(offset))
    return std


def inflation(t: Array, white: Array) -> Array:
    """(6,) by how much means of innovations scatter more than the filter says; 1 where chance explains it.

    Args:
        t: (N,) s.
        white: (N, 6) innovations in their standard deviations; NaN = not measured.
    """
    factor = np.ones(6)
    for length in BATCHES:
        rows, seen = t - t[:1] >= SETTLED, np.isfinite(white)
        # Only batches that have samples: a log may pause for longer than all of it lasts.
        occupied, batch = np.unique((t[rows] - t[:1] - SETTLED) // length, return_inverse=True)
        if (number := len(occupied)) < FEWEST_BATCHES:
            continue
        sums, counts = np.zeros((number, 6)), np.zeros((number, 6))
        np.add.at(sums, batch, np.where(seen, white, 0)[rows])
        np.add.at(counts, batch, seen[rows].astype(float))
        squares = np.where(counts > 0, sums**2 / np.maximum(counts, 1), np.nan)
        with np.errstate(invalid="ignore"):
            ratio = np.nanmean(squares, 0)
        chance = 1 + CHANCE * np.sqrt(2 / np.maximum((counts > 0).sum(0), 1))  # of a chi-square
        factor = np.fmax(factor, np.where(ratio > chance, np.sqrt(ratio), 1))
    return factor


def with_noise(params: Params, noise: LogNoise) -> Params:
    """Parameters of the filter with what the log shows."""
    bias, dtype = params.bias, params.theta.dtype
    if noise.vibration is not None and noise.vibration.taken:
        bias = bias._replace(wrench_variance=bias.wrench_variance * jnp.asarray(sensor_level(noise.vibration), dtype))
        if noise.vibration.per_speed.any():
            speed = None if noise.vibration.speed is None else jnp.asarray(noise.vibration.speed, dtype)
            bias = bias._replace(vibration=jnp.asarray(noise.vibration.per_speed, dtype), vibration_speed=speed)
    if noise.slow is not None and noise.slow.std.any():
        bias = bias._replace(
            correlated_std=jnp.asarray(noise.slow.std, dtype), correlated_time=jnp.asarray(noise.slow.time, dtype)
        )
    bias = bias._replace(prior_std=jnp.asarray(prior_with(params, noise.offset), dtype))
    return params._replace(bias=bias)


def useless(t: Array, noise: LogNoise) -> Array:
    """(T,) samples in contact, and next to it, which say nothing of the bias."""
    return in_contact(t, list(noise.contacts), MARGIN)


MARGIN = 0.05
"""s beside a contact that are left out with it."""


BEGUN_AGAIN = "from its first readings on, the gate kept out most of the log: the bias begins at its median instead"


def describe(noise: LogNoise) -> list[str]:
    """Lines that tell a reader what the log shows beyond its setup; none if nothing."""
    lines = []
    if noise.offset.any():
        words = " ".join(f"{name} {x:.4g}" for name, x in zip(AXES, noise.offset, strict=True) if x)
        lines.append(f"the bias at the start is far from what the setup expects, by N, Nm: {words}")
    if noise.begun_again:
        lines.append(BEGUN_AGAIN)
    for contact in noise.contacts:
        size = np.linalg.norm(contact.force[:3])
        lines.append(f"contact from {contact.start:.2f} to {contact.end:.2f} s, up to {size:.2g} N: not used")
    if noise.vibration is not None and noise.vibration.taken and noise.vibration.per_speed.any():
        lines.append("the noise grows with the speed of the joints; the filter takes what the scatter of the log shows")
    if noise.vibration is not None and (noise.vibration.level != 1).any():
        levels = zip(AXES, np.sqrt(noise.vibration.level), strict=True)
        words = " ".join(f"{name} {x:.2g}" for name, x in levels if x != 1)
        kept = "; where it is less, the filter keeps the stated one" if (noise.vibration.level < 1).any() else ""
        lines.append(f"scatter of single readings at rest, per stated noise_std: {words}{kept}")
    if noise.slow is not None and noise.slow.std.any():
        words = ", ".join(
            f"{name} {std:.2g} over {time:.2g} s"
            for name, std, time in zip(AXES, noise.slow.std, noise.slow.time, strict=True)
            if std > 0
        )
        lines.append(f"errors that vary slowly (N, Nm and correlation time): {words}")
    if (noise.inflation > 1).any():
        words = " ".join(f"{name} {x:.2g}" for name, x in zip(AXES, noise.inflation, strict=True) if x > 1)
        lines.append(f"standard deviations of the bias are enlarged, by what the innovations still contradict: {words}")
    return lines
