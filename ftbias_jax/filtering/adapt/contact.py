"""Contact in free motion: when the reading leaves what bias and noise allow, and when it comes back.

A filter that is touched for a second takes the force for bias. So contact is looked for first, in blocks: a level
follows the measured bias while nothing touches, and is held while something does. A change that stays is a bias that
jumped, and is let through.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ftbias_jax.filtering.adapt.blocks import Blocks, unmeasured_axes
from ftbias_jax.types import Array

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
    force: Array
    """(6,) N, Nm: the largest departure on each axis; sign of the measured bias, opposite to the reading's."""


@unmeasured_axes()
def find_contacts(blocks: Blocks) -> list[Contact]:
    """Stretches in which the measured bias departs from its level by more than noise does, on an axis of force.

    Args:
        blocks: of the whole log.

    Returns:
        contacts in the order of time; none if they would take more than MOST of the log.
    """
    sigma, slow = mean_std(blocks), slow_std(blocks)
    begin = np.maximum(BEGIN * sigma, BEGIN_SLOW * slow)
    # A block that a contact begins in has a large scatter: it is let through, but must not move the level.
    most = BEGIN * np.median(sigma, axis=0)
    found: list[Contact] = []
    level, first = None, -1
    left = np.zeros(6, bool)  # axes; what varies slowly moves on during a contact, and need not come back
    departures = np.zeros_like(blocks.mean)
    step = float(np.median(np.diff(blocks.t))) if len(blocks.t) > 1 else 1.0
    for k, value in enumerate(blocks.mean):
        if np.isnan(value).all():
            continue
        if level is None:
            level = np.nan_to_num(np.nanmedian(blocks.mean[k : k + FIRST], axis=0))
        departures[k] = np.where(np.isnan(value), 0, value - level)
        off = np.abs(departures[k])
        left = (off > begin[k]) | (left & (first >= 0))
        if first < 0 and (off > begin[k])[:3].any():
            first = k
        elif first >= 0 and (off < END * begin[k])[left].all():
            found.append(_contact(blocks, departures, first, k))
            first = -1
        elif first >= 0 and _settled(blocks, sigma, first, k, step):
            level, first = value.copy(), -1
        if first < 0:
            level = level + min(1.0, step / FOLLOW) * np.clip(np.where(np.isnan(value), 0, value - level), -most, most)
    if first >= 0:
        found.append(_contact(blocks, departures, first, len(blocks.t) - 1))
    total = sum(contact.end - contact.start for contact in found)
    return found if total <= MOST * (blocks.t[-1] - blocks.t[0]) else []


def mean_std(blocks: Blocks) -> Array:
    """(N, 6) N, Nm: how far the mean of a block is off its level by noise and by what else varies between blocks."""
    # How far the level usually moves while it is followed, by the calmer part of the log: contacts are in the other.
    lag = max(1, round(FOLLOW / (blocks.t[1] - blocks.t[0]))) if len(blocks.t) > 1 else 1
    moves = np.abs(blocks.mean[lag:] - blocks.mean[:-lag])
    usual = np.nanquantile(moves, CALM_MOVES, axis=0) / MOVES_QUANTILE if len(moves) else 0.0
    return np.hypot(white_std(blocks), np.nan_to_num(usual))


def white_std(blocks: Blocks) -> Array:
    """(N, 6) N, Nm: standard deviation of a block's mean by the scatter of its samples."""
    with np.errstate(invalid="ignore", divide="ignore"):
        white = np.fmax(blocks.scatter, blocks.stated) / np.maximum(blocks.count, 1)
    return np.sqrt(CORRELATED * np.nan_to_num(white, nan=np.inf))


def slow_std(blocks: Blocks) -> Array:
    """(6,) N, Nm: how much the measured bias varies over WINDOW seconds, by the shortest interval that holds 40 %.

    Such an interval ignores the rest, which may be in contact.
    """
    step = blocks.t[1] - blocks.t[0] if len(blocks.t) > 1 else WINDOW
    size = max(10, round(WINDOW / step))
    windows = [blocks.mean[i : i + size] for i in range(0, max(1, len(blocks.mean) - size // 2), size)]
    widths = [[_shortest(column[np.isfinite(column)]) for column in window.T] for window in windows]
    return np.nan_to_num(np.nanmedian(np.array(widths), axis=0)) / SHORTEST_HALF_WIDTH


def _shortest(values: Array) -> float:
    """Half the width of the shortest interval that holds a share CALM of the values."""
    ordered = np.sort(values)
    count = max(2, round(CALM * len(ordered)))
    if len(ordered) < count:
        return np.nan
    return float((ordered[count - 1 :] - ordered[: len(ordered) - count + 1]).min() / 2)


def _settled(blocks: Blocks, sigma: Array, first: int, k: int, step: float) -> bool:
    """Whether the last SETTLED seconds are all on one level."""
    count = round(SETTLED / step)
    if k - first < count:
        return False
    recent = blocks.mean[k - count : k]
    return bool((np.nanmax(np.abs(recent - np.nanmedian(recent, 0)) / sigma[k - count : k], 0) < BEGIN).all())


def _contact(blocks: Blocks, departures: Array, first: int, last: int) -> Contact:
    """The contact between two blocks, begun where the departure first left the noise."""
    off = np.abs(departures) / white_std(blocks)
    earliest = max(0, first - round(FOLLOW / (blocks.t[1] - blocks.t[0])))
    while first > earliest and (off[first - 1, :3] > ONSET).any():
        first -= 1
    half = (blocks.t[1] - blocks.t[0]) / 2 if len(blocks.t) > 1 else 0.0
    largest = departures[first : last + 1]
    peak = largest[np.abs(largest).argmax(0), np.arange(6)]
    return Contact(float(blocks.t[first] - half), float(blocks.t[last] - half), peak)


def in_contact(t: Array, contacts: list[Contact], margin: float = 0.0) -> Array:
    """(T,) whether each sample is in a contact, or within the margin s of one; t increases."""
    touched = np.zeros(len(t), bool)
    for contact in contacts:
        first, last = np.searchsorted(t, [contact.start - margin, contact.end + margin])
        touched[first:last] = True
    return touched
