"""Contact in free motion: from where the reading leaves what bias and noise allow to where it returns.

A filter takes the force of a contact of one second for bias. Contact is therefore searched for first, in blocks: a
level follows the measured bias while nothing touches the tool, and is held during contact. A change that persists is a
jump of the bias and is accepted.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from ftbias_jax.filtering.noise.blocks import Blocks, Layout, nan_median
from ftbias_jax.runtime.compiled_loops import compile_whole, running_sum
from ftbias_jax.types import Array

FOLLOW = 0.5
"""s: time constant with which the level follows; model errors in motion are slower, contacts are faster."""
BEGIN = 8.0
"""Standard deviations of a block's mean beyond which contact begins."""
BEGIN_SLOW = 4.0
"""Standard deviations of the slow variation in free motion, mostly model errors, beyond which contact begins."""
END = 0.5
"""Share of the begin threshold; contact ends when every axis that exceeded the threshold is back within this share."""
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
FIRST = 5
"""Number of blocks at the start whose median is the first level."""
ONSET = 3.0
"""Standard deviations of white noise: a contact begins where the reading exceeds them, FOLLOW s earlier at most."""
CEASED = 0.25
"""Share of its largest departure below which a long contact ends although the bias has drifted meanwhile."""
SETTLED = 5.0
"""s without change after which a departure is taken for a jump of the bias."""
MOST = 0.6
"""Share of a log in contact above which the level is not trusted and nothing is left out."""


class Contact(NamedTuple):
    """An interval of a log in which something touches the tool."""

    start: float
    """s, in the log's time."""
    end: float
    force: np.ndarray
    """(6,) N, Nm: the largest departure on each axis; sign of the measured bias, opposite to the reading's."""


class Contacts(NamedTuple):
    """The contacts of a log in N blocks."""

    first: Int[Array, " N"]
    """Block in which the contact that ends just before this one begins; -1 where none ends."""
    inside: Bool[Array, " N"]
    """Whether something touches the tool."""
    departure: Float[Array, "N 6"]
    """N, Nm: departure of each block from the level."""

    @property
    def near(self) -> Bool[Array, " N"]:
        """Whether something touches the tool in this block or beside it."""
        before, after = jnp.pad(self.inside, (1, 0))[:-1], jnp.pad(self.inside, (0, 1))[1:]
        return before | self.inside | after


def find_contacts(blocks: Blocks, layout: Layout, slow: Float[Array, " 6"]) -> Contacts:
    """Intervals in which the measured bias departs from its level by more than noise does, on a force axis.

    There are none if they would take more than MOST of the log. ``slow`` is its slow variation, N, Nm (``slow_std``).
    """
    index = jnp.arange(len(blocks.t))
    there = index < blocks.number
    sigma = mean_std(blocks, layout)
    begin = jnp.maximum(BEGIN * sigma, BEGIN_SLOW * slow[None])
    # The block in which a contact begins has a large scatter and passes as noise, but it must not move the level.
    usual = nan_median(jnp.where(there[:, None], sigma, jnp.nan))
    most = BEGIN * usual
    rate = min(1.0, layout.seconds / FOLLOW)
    settled_after = round(SETTLED / layout.seconds)

    def step(most: Array, carry: Any, block: Any) -> tuple[Any, tuple[Array, Array]]:
        (level, first, left, largest), (k, mean, begin, one_level) = carry, block
        seen, value = jnp.isfinite(mean).any(), jnp.where(jnp.isnan(mean), level, mean)
        departure = value - level
        off = jnp.abs(departure)
        # The slow variation continues during a contact: axes that never left the level need not return to it.
        left = (off > begin) | (left & (first >= 0))
        opens = (first < 0) & (off > begin)[:3].any()
        end, longer = END * begin, (k - first) / settled_after
        end = jnp.maximum(end, jnp.minimum(end * longer, CEASED * largest))
        closes = (first >= 0) & jnp.where(left, off < end, True).all()
        settles = (first >= 0) & ~closes & one_level & (k - first >= settled_after)
        after = jnp.where(opens, k, jnp.where(closes | settles, -1, first))
        level_after = jnp.where(settles, value, level)
        followed = level_after + rate * jnp.clip(value - level_after, -most, most)
        level_after = jnp.where(after < 0, followed, level_after)
        largest = jnp.where(opens, off, jnp.maximum(largest, off))
        carry = jax.tree.map(lambda new, old: jnp.where(seen, new, old), (level_after, after, left, largest), carry)
        return carry, (jnp.where(seen, departure, 0), jnp.where(seen & closes, first, -1))

    measured = jnp.isfinite(blocks.mean).any(1).argmax()
    rows = jax.lax.dynamic_slice(blocks.mean, (measured, 0), (min(FIRST, len(blocks.mean)), 6))
    start = (jnp.nan_to_num(nan_median(rows)), jnp.asarray(-1), jnp.zeros(6, bool), jnp.zeros(6, blocks.mean.dtype))
    # Chatter of a tool that grinds scatters as much as the force of contact varies; the bias does neither.
    inputs = (index, blocks.mean, begin, _on_one_level(blocks.mean, jnp.minimum(sigma, usual[None]), settled_after))

    follow = compile_whole(lambda start, inputs, most: jax.lax.scan(partial(step, most), start, inputs))
    (_, open_since, *_), (departure, first) = follow(start, inputs, most)
    first = jnp.where((index == blocks.number - 1) & (open_since >= 0), open_since, first)
    first = _taken_back(first, departure / white_std(blocks), round(FOLLOW / layout.seconds))
    total = jnp.where(first >= 0, blocks.t - blocks.t[first], 0).sum()
    first = jnp.where(total > MOST * (blocks.t[blocks.number - 1] - blocks.t[0]), -1, first)
    ends = (first >= 0).astype(int)
    begun = jnp.zeros(len(first) + 1, int).at[jnp.where(first >= 0, first, len(first))].add(1)[:-1]
    return Contacts(first, running_sum(begun - ends) > 0, departure)


def _on_one_level(mean: Array, sigma: Array, count: int) -> Array:
    """Whether (N,) some level is within BEGIN standard deviations of all of the last ``count`` blocks."""
    high = jnp.where(jnp.isfinite(mean), mean + BEGIN * sigma, jnp.inf)
    low = jnp.where(jnp.isfinite(mean), BEGIN * sigma - mean, jnp.inf)
    return (_least_before(high, count) > -_least_before(low, count)).all(1)


def _least_before(x: Array, count: int) -> Array:
    """Minimum (N, 6) of the ``count`` rows before each row, from windows that double in length; inf = no rows."""

    def later(x: Array, by: int) -> Array:
        return jnp.concatenate([jnp.full((min(by, len(x)), x.shape[1]), jnp.inf, x.dtype), x])[: len(x)]

    found, length = later(x, 1), 1
    while length < count:
        step = min(length, count - length)
        found, length = jnp.minimum(found, later(found, step)), length + step
    return found


def _taken_back(first: Array, off: Array, most: int) -> Array:
    """First block of each contact, moved back to where the departure first exceeded the noise."""
    beyond = (jnp.abs(off[:, :3]) > ONSET).any(1)

    def lasts(so_far: Array, beyond: Array) -> tuple[Array, Array]:
        return (after := jnp.where(beyond, so_far + 1, 0)), after

    run = jax.lax.scan(lasts, jnp.asarray(0), beyond)[1]  # length of the run of blocks beyond the noise up to this one
    moved = first - jnp.minimum(jnp.where(first > 0, run[first - 1], 0), most)
    return jnp.where(first >= 0, jnp.maximum(moved, 0), -1)


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


def listed(contacts: Contacts, t: np.ndarray, layout: Layout) -> tuple[Contact, ...]:
    """The contacts of a log as a list in the order of time; t (N,) s, middles of its blocks."""
    first, _, departure = (np.asarray(x) for x in contacts)
    found, half = [], layout.seconds / 2
    for last in np.flatnonzero(first >= 0):
        largest = departure[first[last] : last + 1]
        peak = largest[np.abs(largest).argmax(0), np.arange(6)]
        found.append(Contact(float(t[first[last]] - half), float(t[last] - half), peak))
    return tuple(found)


def in_contact(t: np.ndarray, contacts: Sequence[Contact], margin: float = 0.0) -> np.ndarray:
    """Whether (T,) each sample is in a contact, or within ``margin`` s of one; t increases."""
    inside = np.zeros(len(t), bool)
    for contact in contacts:
        first, last = np.searchsorted(t, [contact.start - margin, contact.end + margin])
        inside[first:last] = True
    return inside
