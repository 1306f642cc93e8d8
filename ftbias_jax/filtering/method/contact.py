"""Contact in free motion: when the reading leaves what bias and noise allow, and when it comes back.

A filter that is touched for a second takes the force for bias. So contact is looked for first, in blocks: a level
follows the measured bias while nothing touches, and is held while something does. A change that stays is a bias that
jumped, and is let through.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ftbias_jax.filtering.method.blocks import Blocks, Layout

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int

FOLLOW = 0.5
"""s: time constant with which the level follows; the errors of a model in motion are slower, contacts are faster."""
BEGIN = 8.0
"""Standard deviations of a block's mean beyond which contact begins."""
BEGIN_SLOW = 4.0
"""Standard deviations of what varies slowly in free motion, mostly errors of the model, beyond which contact begins."""
END = 0.5
"""Share of what contact begins beyond; contact ends when every axis that left is within it."""
CORRELATED = 4.0
"""The variance of a block's mean is this many times that of white noise: vibration is not white."""
CALM = 0.35
"""Share of a log in which nothing touches, for sure."""
SHORTEST_HALF_WIDTH = 0.454
"""Half the width of the shortest interval that holds this share of normal numbers, in standard deviations."""
CALM_MOVES, MOVES_QUANTILE = 0.2, 0.358
"""Share of differences between two times that are both calm, and that quantile of such differences."""
WINDOW = 20.0
"""s: the bias itself hardly moves in so short a time."""
FIRST = 5
"""Blocks at the start whose median is the first level."""
ONSET = 3.0
"""Standard deviations of white noise: contact is taken back to where the reading left them, FOLLOW s at most."""
SETTLED = 5.0
"""s without change: what stays for so long is a bias that jumped."""
MOST = 0.6
"""Share of a log in contact beyond which the level is not to be trusted, and nothing is left out."""


class Contact(NamedTuple):
    """A stretch of a log in which something touches the tool."""

    start: float
    """s, of the log's time."""
    end: float
    force: np.ndarray
    """(6,) N, Nm: the largest departure on each axis; sign of the measured bias, opposite to the reading's."""


class Contacts(NamedTuple):
    """The contacts of a log in N blocks, each told by the block with which it ends."""

    first: Int[Array, " N"]
    """The block with which it begins; -1 where no contact ends."""
    start: Float[Array, " N"]
    """s; inf where no contact ends."""
    end: Float[Array, " N"]
    """s; inf where no contact ends."""
    departure: Float[Array, "N 6"]
    """N, Nm: how far each block is off the level."""


def find_contacts(blocks: Blocks, layout: Layout) -> Contacts:
    """Stretches in which the measured bias departs from its level by more than noise does, on an axis of force.

    Args:
        blocks: of the whole log.
        layout: of the blocks.

    Returns:
        the contacts; none if they would take more than MOST of the log.
    """
    index = jnp.arange(len(blocks.t))
    there = index < blocks.number
    sigma, slow = mean_std(blocks, layout), slow_std(blocks, layout)
    begin = jnp.maximum(BEGIN * sigma, BEGIN_SLOW * slow)
    # A block that a contact begins in has a large scatter: it is let through, but must not move the level.
    most = BEGIN * jnp.nanmedian(jnp.where(there[:, None], sigma, jnp.nan), 0)
    rate = min(1.0, layout.seconds / FOLLOW)
    settled_after = round(SETTLED / layout.seconds)

    def step(carry: Any, block: Any) -> tuple[Any, tuple[Array, Array]]:
        (level, first, left), (k, mean, begin, one_level) = carry, block
        seen, value = jnp.isfinite(mean).any(), jnp.where(jnp.isnan(mean), level, mean)
        departure = value - level
        off = jnp.abs(departure)
        # What varies slowly moves on during a contact: axes that never left need not come back.
        left = (off > begin) | (left & (first >= 0))
        opens = (first < 0) & (off > begin)[:3].any()
        closes = (first >= 0) & jnp.where(left, off < END * begin, True).all()
        settles = (first >= 0) & ~closes & one_level & (k - first >= settled_after)
        after = jnp.where(opens, k, jnp.where(closes | settles, -1, first))
        level_after = jnp.where(settles, value, level)
        followed = level_after + rate * jnp.clip(value - level_after, -most, most)
        level_after = jnp.where(after < 0, followed, level_after)
        carry = jax.tree.map(lambda new, old: jnp.where(seen, new, old), (level_after, after, left), carry)
        return carry, (jnp.where(seen, departure, 0), jnp.where(seen & closes, first, -1))

    start = (_first_level(blocks), jnp.asarray(-1), jnp.zeros(6, bool))
    inputs = (index, blocks.mean, begin, _on_one_level(blocks.mean, sigma, settled_after))
    (_, open_since, _), (departure, first) = jax.lax.scan(step, start, inputs)
    first = jnp.where((index == blocks.number - 1) & (open_since >= 0), open_since, first)
    first = _taken_back(first, departure / white_std(blocks), round(FOLLOW / layout.seconds))
    begins = jnp.where(first >= 0, blocks.t[first], jnp.inf) - layout.seconds / 2
    ends = jnp.where(first >= 0, blocks.t, jnp.inf) - layout.seconds / 2
    total = jnp.where(first >= 0, ends - begins, 0).sum()
    too_much = total > MOST * (blocks.t[blocks.number - 1] - blocks.t[0])
    none = jnp.inf
    return Contacts(
        jnp.where(too_much, -1, first), jnp.where(too_much, none, begins), jnp.where(too_much, none, ends), departure
    )


def _first_level(blocks: Blocks) -> Array:
    """(6,) N, Nm: median of the blocks from the first one on that was measured."""
    k = jnp.isfinite(blocks.mean).any(1).argmax()
    rows = jax.lax.dynamic_slice(blocks.mean, (k, 0), (min(FIRST, len(blocks.mean)), 6))
    return jnp.nan_to_num(jnp.nanmedian(rows, 0))


def _on_one_level(mean: Array, sigma: Array, count: int) -> Array:
    """(N,) whether there is a level that the last ``count`` blocks are all within BEGIN standard deviations of."""
    high = jnp.where(jnp.isfinite(mean), mean + BEGIN * sigma, jnp.inf)
    low = jnp.where(jnp.isfinite(mean), mean - BEGIN * sigma, -jnp.inf)
    window, strides, before = (count, 1), (1, 1), ((count, 0), (0, 0))
    least = jax.lax.reduce_window(high[:-1], jnp.inf, jax.lax.min, window, strides, before)
    largest = jax.lax.reduce_window(low[:-1], -jnp.inf, jax.lax.max, window, strides, before)
    return (largest < least).all(1)[: len(mean)]


def _taken_back(first: Array, off: Array, most: int) -> Array:
    """The first block of each contact, taken back to where the departure first left the noise."""
    index = jnp.arange(len(first))
    beyond = (jnp.abs(off[:, :3]) > ONSET).any(1)
    inside = jax.lax.cummax(jnp.where(beyond, -1, index))  # the last block before, that was within the noise
    before = jnp.maximum(first - 1, 0)
    earliest = jnp.maximum(first - most, 0)
    moved = jnp.where(first > 0, jnp.maximum(inside[before] + 1, earliest), first)
    return jnp.where(first >= 0, jnp.minimum(moved, first), -1)


def mean_std(blocks: Blocks, layout: Layout) -> Float[Array, "N 6"]:
    """N, Nm: how far the mean of a block is off its level by noise and by what else varies between blocks."""
    # How far the level usually moves while it is followed, by the calmer part of the log: contacts are in the other.
    lag = max(1, round(FOLLOW / layout.seconds))
    moves = jnp.abs(blocks.mean[lag:] - blocks.mean[:-lag])
    usual = jnp.nanquantile(moves, CALM_MOVES, axis=0) / MOVES_QUANTILE if len(moves) else 0.0
    return jnp.hypot(white_std(blocks), jnp.nan_to_num(usual))


def white_std(blocks: Blocks) -> Float[Array, "N 6"]:
    """N, Nm: standard deviation of a block's mean by the scatter of its samples."""
    white = jnp.fmax(blocks.scatter, blocks.stated) / jnp.maximum(blocks.count, 1)
    return jnp.sqrt(CORRELATED * jnp.nan_to_num(white, nan=jnp.inf))


def slow_std(blocks: Blocks, layout: Layout) -> Float[Array, " 6"]:
    """N, Nm: how much the measured bias varies over WINDOW seconds, by the shortest interval that holds CALM of it.

    Such an interval ignores the rest, which may be in contact.
    """
    size = max(10, round(WINDOW / layout.seconds))
    number = max(1, -(-(len(blocks.mean) - size // 2) // size))
    missing = max(0, number * size - len(blocks.mean))
    padded = jnp.pad(blocks.mean, ((0, missing), (0, 0)), constant_values=jnp.nan)
    windows = padded[: number * size].reshape(number, size, 6)
    begun = jnp.arange(number) * size < jnp.maximum(1, blocks.number - size // 2)
    widths = jnp.where(begun[:, None], _shortest(windows), jnp.nan)
    return jnp.nan_to_num(jnp.nanmedian(widths, 0)) / SHORTEST_HALF_WIDTH


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


def in_contact(t: Float[Array, " T"], contacts: Contacts, margin: float = 0.0) -> Bool[Array, " T"]:
    """Whether each sample is in a contact, or within the margin s of one; t increases."""
    first = jnp.searchsorted(t, contacts.start - margin)
    last = jnp.searchsorted(t, contacts.end + margin)
    changes = jnp.zeros(len(t) + 1, int).at[first].add(1).at[last].add(-1)
    return jnp.cumsum(changes)[:-1] > 0


def listed(contacts: Contacts) -> tuple[Contact, ...]:
    """The contacts one by one, in the order of time."""
    first, start, end, departure = (np.asarray(x) for x in contacts)
    found = []
    for last in np.flatnonzero(first >= 0):
        largest = departure[first[last] : last + 1]
        peak = largest[np.abs(largest).argmax(0), np.arange(6)]
        found.append(Contact(float(start[last]), float(end[last]), peak))
    return tuple(found)


def touched(t: np.ndarray, contacts: Sequence[Contact], margin: float = 0.0) -> np.ndarray:
    """``in_contact`` for contacts one by one, in NumPy: (T,)."""
    inside = np.zeros(len(t), bool)
    for contact in contacts:
        first, last = np.searchsorted(t, [contact.start - margin, contact.end + margin])
        inside[first:last] = True
    return inside
