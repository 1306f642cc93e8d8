"""Contact in free motion: from where the reading leaves what bias and noise allow to where it returns.

A filter takes the force of a contact of one second for bias. Contact is therefore searched for first, in blocks: a
level follows the measured bias while nothing touches the tool, and is held during contact. A change that persists is a
jump of the bias and is accepted.

The level begins at the first reading. A log that begins in contact, or is touched during most of it, would be taken the
wrong way round, with the contact as free motion: the level to which the measured bias returns most exactly is tried as
well, and replaces it where the log is clearly in two parts, one calm and one that varies.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from ftbias_jax.filtering.noise.blocks import Blocks, Layout, nan_median
from ftbias_jax.filtering.noise.levels import FOLLOW, calmest_level, mean_std, slow_std, white_std
from ftbias_jax.runtime.compiled_loops import compile_whole, running_sum
from ftbias_jax.types import Array

BEGIN = 8.0
"""Standard deviations of a block's mean beyond which contact begins."""
BEGIN_SLOW = 4.0
"""Standard deviations of the slow variation in free motion, mostly model errors, beyond which contact begins."""
END = 0.5
"""Share of the begin threshold; contact ends when every axis that exceeded the threshold is back within this share."""
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
MUCH, MOST_OF_CALMEST = 0.25, 0.9
"""Shares of a log in contact between which the calmest level may replace the first one."""
CALMER = 1.5
"""Ratio by which the free part of a log must be calmer if the calmest level is to replace the first one."""
HARDLY = 0.2
"""Share of the blocks in contact that may exceed the threshold by less than twice: contact is far from free motion."""
SUDDEN, LONGEST_ONSET = 0.6, 3
"""Share of the usual departure by which contact begins, and number of blocks within which it does; errors that follow
the arm's motion take longer."""
FEWEST = 3
"""Number of contacts after each of which the reading must have returned to the same level."""
EVEN = 0.3, 0.7
"""Shares of a log in contact between which calm and contact may be confused, if neither is calmer than the other."""
AS_CALM, MUCH_CALMER = 2.0, 0.5
"""Spread in contact relative to that of free motion: below the first they may be confused, below the second they
probably are."""
TINY = 1e-12


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
    undecided: Float[Array, " 6"]
    """N, Nm: departure in contact, if the free part may as well be the contact; 0 = there is no doubt."""

    @property
    def near(self) -> Bool[Array, " N"]:
        """Whether something touches the tool in this block or beside it."""
        before, after = jnp.pad(self.inside, (1, 0))[:-1], jnp.pad(self.inside, (0, 1))[1:]
        return before | self.inside | after


def find_contacts(blocks: Blocks, layout: Layout, slow: Float[Array, " 6"]) -> Contacts:
    """Intervals in which the measured bias departs from its level by more than noise does, on a force axis.

    There are none if they would take more than MOST of the log and no part of it is clearly calm. ``slow`` is its slow
    variation, N, Nm (``slow_std``).
    """
    measured = jnp.isfinite(blocks.mean).any(1).argmax()
    rows = jax.lax.dynamic_slice(blocks.mean, (measured, 0), (min(FIRST, len(blocks.mean)), 6))
    first_level = jnp.nan_to_num(nan_median(rows))
    calm, usual = calmest_level(blocks, layout), mean_std(blocks, layout)
    pairs = (first_level, calm.level), (usual, jnp.zeros_like(usual) + calm.noise[None]), (slow, calm.spread)
    # The calmest level is one to which the bias returns again and again, so it does not jump meanwhile.
    settled_after = jnp.asarray([round(SETTLED / layout.seconds), len(blocks.t)])
    levels, sigmas, slow_stds = (jnp.stack(pair) for pair in pairs)
    both = jax.vmap(partial(_contacts_from, blocks, layout))(levels, sigmas, slow_stds, settled_after)
    (found, _), (of_calmest, begin) = (jax.tree.map(lambda x, k=k: x[k], both) for k in (0, 1))
    shares, spreads = jax.vmap(partial(_share, blocks))(both[0]), _spreads(blocks, layout, both[0])
    (free, _), (free_of_calmest, touched_of_calmest) = spreads
    too_many = shares[0] > MOST
    calmer = jnp.where(too_many, touched_of_calmest > AS_CALM * free_of_calmest, free_of_calmest * CALMER < free)
    clear = calmer & _is_clear(blocks, of_calmest, begin, shares[1])
    found, dropped = jax.tree.map(lambda x, y: jnp.where(clear, y, x), found, of_calmest), too_many & ~clear
    free, touched = jnp.where(clear, spreads[1], spreads[0])
    share = jnp.where(clear, shares[1], shares[0])
    doubtful = dropped | _is_doubtful(found, share, touched / jnp.maximum(free, TINY))
    departure = jnp.where(found.inside[:, None], jnp.abs(found.departure), 0).sum(0)
    return found._replace(
        first=jnp.where(dropped, -1, found.first),
        inside=found.inside & ~dropped,
        undecided=jnp.where(doubtful, departure / jnp.maximum(found.inside.sum(), 1), 0.0),
    )


def _contacts_from(
    blocks: Blocks, layout: Layout, level: Array, sigma: Array, slow: Array, settled_after: Array
) -> tuple[Contacts, Array]:
    """Contacts (N blocks) if the bias begins at a level, and the departures (N, 6) beyond which contact begins.

    Args:
        blocks: of the log.
        layout: of the blocks.
        level: (6,) N, Nm.
        sigma: (N, 6) N, Nm, standard deviation of a block's mean about the level.
        slow: (6,) N, Nm, slow variation in free motion.
        settled_after: number of blocks without change after which a departure is taken for a jump of the bias.
    """
    index = jnp.arange(len(blocks.t))
    there = index < blocks.number
    begin = jnp.maximum(BEGIN * sigma, BEGIN_SLOW * slow[None])
    # The block in which a contact begins has a large scatter and passes as noise, but it must not move the level.
    usual = nan_median(jnp.where(there[:, None], sigma, jnp.nan))
    most = BEGIN * usual
    rate, long = min(1.0, layout.seconds / FOLLOW), round(SETTLED / layout.seconds)

    def step(most: Array, carry: Any, block: Any) -> tuple[Any, tuple[Array, Array]]:
        (level, first, left, largest), (k, mean, begin, one_level) = carry, block
        seen, value = jnp.isfinite(mean).any(), jnp.where(jnp.isnan(mean), level, mean)
        departure = value - level
        off = jnp.abs(departure)
        # The slow variation continues during a contact: axes that never left the level need not return to it.
        left = (off > begin) | (left & (first >= 0))
        opens = (first < 0) & (off > begin)[:3].any()
        end, longer = END * begin, (k - first) / long
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

    # Chatter of a tool that grinds scatters as much as the force of contact varies; the bias does neither.
    inputs = (index, blocks.mean, begin, _on_one_level(blocks.mean, jnp.minimum(sigma, usual[None]), long))

    start = (level, jnp.asarray(-1), jnp.zeros(6, bool), jnp.zeros(6, blocks.mean.dtype))
    follow = compile_whole(lambda start, inputs, most: jax.lax.scan(partial(step, most), start, inputs))
    (_, open_since, *_), (departure, first) = follow(start, inputs, most)
    first = jnp.where((index == blocks.number - 1) & (open_since >= 0), open_since, first)
    first = _taken_back(first, departure / white_std(blocks), round(FOLLOW / layout.seconds))
    ends = (first >= 0).astype(int)
    begun = jnp.zeros(len(first) + 1, int).at[jnp.where(first >= 0, first, len(first))].add(1)[:-1]
    return Contacts(first, running_sum(begun - ends) > 0, departure, jnp.zeros_like(level)), begin


def _share(blocks: Blocks, found: Contacts) -> Array:
    """Share of a log in contact."""
    total = jnp.where(found.first >= 0, blocks.t - blocks.t[found.first], 0).sum()
    return total / jnp.maximum(blocks.t[blocks.number - 1] - blocks.t[0], TINY)


def _spreads(blocks: Blocks, layout: Layout, both: Contacts) -> Float[Array, "2 2"]:
    """Slow variation of the force in N, of each of two ways to see contact: in its free motion, and in its contact."""

    def spread(taken: Array) -> Array:
        only = blocks._replace(mean=jnp.where(taken[:, None], blocks.mean, jnp.nan))
        return jnp.sqrt((slow_std(only, layout)[:3] ** 2).sum())

    near = jax.vmap(lambda found: found.near)(both)
    return jax.vmap(jax.vmap(spread))(jnp.stack([~near, both.inside], 1))


def _is_clear(blocks: Blocks, found: Contacts, begin: Array, share: Array) -> Bool[Array, ""]:
    """Whether a log, of which this share is in contact, is clearly in two parts with sudden changes between them."""
    departure = jnp.where(found.inside[:, None], jnp.abs(found.departure), 0)[:, :3]
    number = jnp.maximum(found.inside.sum(), 1)
    hardly = (found.inside & (departure < 2 * begin[:, :3]).all(1)).sum() / number
    size = jnp.sqrt((departure**2).sum() / number)
    begins = found.inside & ~jnp.pad(found.inside, (1, 0))[:-1]
    rise = jnp.sqrt((_change(blocks.mean[:, :3], LONGEST_ONSET) ** 2).sum(1))
    sudden = jnp.where(begins, rise, 0).sum() > SUDDEN * size * begins.sum()
    often = (found.first >= 0).sum() >= FEWEST
    return (share > MUCH) & (share < MOST_OF_CALMEST) & (hardly < HARDLY) & sudden & often


def _change(x: Array, lag: int) -> Array:
    """Change (N, 3) of x from the block before each one to ``lag`` - 1 blocks after it; 0 where that is unknown."""
    changed = jnp.pad(x[lag:] - x[:-lag], ((1, 0), (0, 0)))
    return jnp.nan_to_num(jnp.pad(changed, ((0, len(x) - len(changed)), (0, 0))))


def _is_doubtful(found: Contacts, share: Array, ratio: Array) -> Bool[Array, ""]:
    """Whether the free part of a log may as well be the contact, which has this share of it and ratio of spreads."""
    alike = (share > EVEN[0]) & (share < EVEN[1]) & (ratio < AS_CALM)
    return ((found.first >= 0).sum() >= FEWEST) & (alike | ((share > EVEN[0] / 2) & (ratio < MUCH_CALMER)))


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


def listed(contacts: Contacts, t: np.ndarray, layout: Layout) -> tuple[Contact, ...]:
    """The contacts of a log as a list in the order of time; t (N,) s, middles of its blocks."""
    first, departure = np.asarray(contacts.first), np.asarray(contacts.departure)
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
