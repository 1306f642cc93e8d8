"""How far the measured bias of blocks usually is from its level, and the level to which it returns most exactly."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Float

from ftbias_jax.filtering.noise.blocks import Blocks, Layout, nan_median
from ftbias_jax.runtime.compiled_loops import running_sum
from ftbias_jax.types import Array

FOLLOW = 0.5
"""s: time constant with which a level follows; model errors in motion are slower, contacts are faster."""
CORRELATED = 4.0
"""Ratio of the variance of a block's mean to that of white noise, because vibration is not white."""
CALM = 0.35
"""Share of a log that is assumed to be free of contact."""
SHORTEST_HALF_WIDTH = 0.454
"""Half the width, in standard deviations, of the shortest interval that holds a share CALM of a normal distribution."""
CALM_MOVES, MOVES_QUANTILE = 0.2, 0.358
"""Share of differences between two times that are both calm, and that quantile of such differences for unit noise."""
WINDOW = 20.0
"""s, window of ``slow_std``; the bias itself hardly moves in so short a time."""
LEAST_CALM = 0.1
"""Share of a log that must lie close together for ``calmest_level`` to take it for free."""
SEARCHED = 60.0
"""s at the start of a log in which ``calmest_level`` searches; the bias may drift away later."""
EXAMINED, TRIED = 300, 48
"""Numbers of evenly spaced blocks that are compared, and that are tried as the level; at most twice as many."""
EARLIEST = 5
"""Number of blocks, the first ones of those that lie close together, whose mean is the level."""
NEAREST = 2.0
"""Ratio of the spread of a level to that of the nearest LEAST_CALM of a log, which have been selected for nearness."""


class Calm(NamedTuple):
    """The level to which a measured bias returns most exactly, (6,) N, Nm each."""

    level: Float[Array, " 6"]
    """Mean of the first blocks about it."""
    spread: Float[Array, " 6"]
    """Standard deviation of the blocks about it; 0 if the log has none."""
    noise: Float[Array, " 6"]
    """White standard deviation of the mean of these blocks: tools that slide or grind scatter more than free ones."""


def calmest_level(blocks: Blocks, layout: Layout) -> Calm:
    """The level about which a share LEAST_CALM of the measured bias lies closest.

    The bias returns to one level whenever nothing touches the tool; forces of contact vary, and no two are the same.
    """
    room = min(len(blocks.t), round(SEARCHED / layout.seconds))
    every = slice(0, room, max(1, room // EXAMINED))
    index, mean, white = jnp.arange(len(blocks.t))[every], blocks.mean[every], white_std(blocks)[every]
    seen = (index < blocks.number) & jnp.isfinite(mean).any(1)
    usual = jnp.where(seen[:, None], white, 0).sum(0) / jnp.maximum(seen.sum(), 1)
    force = mean[:, :3] / jnp.where(jnp.isfinite(usual) & (usual > 0), usual, 1)[None, :3]
    tried = slice(0, None, max(1, len(index) // TRIED))
    apart = jnp.abs(force[None] - force[tried][:, None])
    distance = jnp.where(jnp.isnan(apart), 0, apart).max(2)  # (tried, blocks)
    distance = jnp.where(seen[None] & seen[tried][:, None], distance, jnp.inf)
    count = jnp.maximum(jnp.round(LEAST_CALM * seen.sum()).astype(int), 1)
    radius = jnp.sort(distance, axis=1)[:, count - 1]
    calmest = radius.argmin()
    near = seen & (distance[calmest] <= radius[calmest])
    # The bias may have drifted between the start of the log and most of these blocks.
    earliest = near & (running_sum(near.astype(int)) <= EARLIEST)
    middle = jnp.nan_to_num(mean[tried][calmest])
    x = mean - middle[None]
    table = jnp.where(jnp.isfinite(x), jnp.stack([jnp.ones_like(x), x, x**2, white]), 0)
    number, first, square, noise = jnp.einsum("sb,kba->ksa", jnp.stack([near, earliest]).astype(x.dtype), table)
    counts = jnp.maximum(number, 1)
    spread = jnp.sqrt(jnp.maximum(square[0] / counts[0] - (first[0] / counts[0]) ** 2, 0))
    level = middle + first[1] / counts[1]
    return Calm(level, NEAREST * spread, jnp.where(number[0] > 0, noise[0] / counts[0], jnp.inf))


def mean_std(blocks: Blocks, layout: Layout) -> Float[Array, "N 6"]:
    """Standard deviation (N, 6) N, Nm of a block's mean about the level, by noise and by variation between blocks."""
    # The usual motion of the level is taken from the calmer part of the log, because contacts are in the other part.
    lag = max(1, round(FOLLOW / layout.seconds))
    moves = jnp.abs(blocks.mean[lag:] - blocks.mean[:-lag])
    usual = jnp.nanquantile(moves, CALM_MOVES, axis=0) / MOVES_QUANTILE if len(moves) else jnp.zeros(6, moves.dtype)
    return jnp.hypot(white_std(blocks), jnp.nan_to_num(usual)[None])


def white_std(blocks: Blocks) -> Float[Array, "N 6"]:
    """Standard deviation (N, 6) N, Nm of a block's mean, from the scatter of its samples."""
    white = jnp.fmax(blocks.scatter, blocks.stated) / jnp.maximum(blocks.count, 1)
    return jnp.sqrt(CORRELATED * jnp.nan_to_num(white, nan=jnp.inf))


def slow_std(blocks: Blocks, layout: Layout) -> Float[Array, " 6"]:
    """Variation (6,) N, Nm of the measured bias over WINDOW seconds, from the shortest interval that holds CALM of it.

    Such an interval ignores the rest, which may be in contact.
    """
    size = max(10, round(WINDOW / layout.seconds))
    number = max(1, -(-(len(blocks.mean) - size // 2) // size))
    missing = max(0, number * size - len(blocks.mean))
    padded = jnp.pad(blocks.mean, ((0, missing), (0, 0)), constant_values=jnp.nan)
    windows = padded[: number * size].reshape(number, size, 6)
    begun = jnp.arange(number) * size < jnp.maximum(1, blocks.number - size // 2)
    widths = jnp.where(begun[:, None], _shortest(windows), jnp.nan)
    return jnp.nan_to_num(nan_median(widths)) / SHORTEST_HALF_WIDTH


def _shortest(windows: Float[Array, "W S 6"]) -> Float[Array, "W 6"]:
    """Half the width of the shortest interval that holds a share CALM of each window's values; NaN = none."""
    ordered = jnp.sort(windows, axis=1)  # NaN come last
    number = jnp.isfinite(windows).sum(1)
    count = jnp.maximum(2, jnp.round(CALM * number)).astype(int)
    index = jnp.arange(windows.shape[1])[None, :, None]
    upto = jnp.minimum(index + count[:, None] - 1, windows.shape[1] - 1)
    widths = jnp.take_along_axis(ordered, upto, 1) - ordered
    inside = index + count[:, None] <= number[:, None]
    shortest = jnp.where(inside, widths, jnp.inf).min(1)
    return jnp.where(jnp.isfinite(shortest), shortest / 2, jnp.nan)
