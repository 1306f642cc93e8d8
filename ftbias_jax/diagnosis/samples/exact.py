"""Effects that leave exact traces in the recorded numbers: repeated rows, lattices, flat tops, holes in time.

White noise never gives the same float twice, so equal numbers are evidence by themselves, and no model is needed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.samples.types import surprise
from ftbias_jax.diagnosis.thresholds import (
    FLAT_TOP_NATS,
    HOLE,
    LATTICE_TOLERANCE,
    LEAST_SHARE_ON_LATTICE,
    LEAST_TIES,
    LONGEST_GAP,
    MADE_UP,
    MOST_ON_TICK,
    MOST_PERIODS,
    MOST_TIES,
    ON_TICK,
)

FLOAT32 = float(np.finfo(np.float32).eps)


class Lattice(NamedTuple):
    """Equally spaced values of one channel; step 0 = none."""

    step: float
    """N or Nm."""
    stderr: float
    on_lattice: int
    """Samples that are multiples of the step away from one another."""


class FlatTop(NamedTuple):
    """Readings of one channel that stop at one value, on one side."""

    value: float
    """N or Nm, with its sign."""
    ties: int
    """Samples there."""
    nats: float


class Gaps(NamedTuple):
    """Holes in a regular clock."""

    period: float
    """s; 0 = the stamps have no common period."""
    lost: np.ndarray
    """(G,) samples that the clock lacks, gap by gap."""
    pauses: int
    """Holes too long to be lost samples."""


def repeated_rows(wrench: np.ndarray) -> np.ndarray:
    """(N,) rows that equal the row before in every channel of (N, k)."""
    return np.concatenate([[False], (wrench[1:] == wrench[:-1]).all(1)])


def runs(marked: np.ndarray) -> np.ndarray:
    """Lengths of the runs of marked rows (N,)."""
    edge = np.flatnonzero(np.diff(np.concatenate([[0], marked.astype(int), [0]])))
    lengths: np.ndarray = edge[1::2] - edge[::2]
    return lengths


def find_lattice(x: np.ndarray) -> Lattice:
    """The lattice most samples (N,) lie on."""
    values, counts = np.unique(x, return_counts=True)
    levels, counts = values[counts > 1], counts[counts > 1]
    if counts.sum() < LEAST_SHARE_ON_LATTICE * len(x) or len(levels) < 3:
        return Lattice(0.0, 0.0, 0)
    step = float(np.median(np.diff(levels)))
    number = np.round((levels - levels[np.argmax(counts)]) / step)
    weight = np.sqrt(counts)
    fit = np.polyfit(number, levels, 1, w=weight)
    off = levels - np.polyval(fit, number)
    on = np.abs(off) < LATTICE_TOLERANCE * abs(fit[0])
    on_lattice = int(counts[on].sum())
    if on_lattice < LEAST_SHARE_ON_LATTICE * len(x):
        return Lattice(0.0, 0.0, 0)
    resolution = FLOAT32 * float(np.abs(levels).max())
    stderr = (np.std(off[on]) + resolution) / (np.std(number[on]) * np.sqrt(on.sum()))
    return Lattice(float(fit[0]), float(stderr), on_lattice)


def find_flat_top(x: np.ndarray, side: float, noise_std: float, step: float) -> FlatTop | None:
    """Whether the largest (side 1) or smallest (side -1) value of (N,) is a limit.

    Noise scatters the samples of a pose around it, so few share the extreme value, and more lie just inside of it.

    Args:
        x: (N,) N or Nm, readings of one channel.
        side: 1 for the largest value, -1 for the smallest.
        noise_std: N or Nm.
        step: of the lattice the samples lie on, 0 = none; beyond two sigmas noise no longer carries samples from level
            to level, and a pose at rest looks like a limit.
    """
    if step > 2 * noise_std:
        return None
    x = np.asarray(side * x)
    top = float(np.max(x))
    resolution: float = max(step, 2 * FLOAT32 * abs(top))
    width: float = max(float(noise_std) / 2, 2 * resolution)
    count = int((x >= top - resolution / 4).sum())
    inside = int((x >= top - width).sum()) - count
    nats = surprise(count, (inside + 1) * resolution / width)
    if count < LEAST_TIES or count > MOST_TIES * len(x) or nats < FLAT_TOP_NATS:
        return None
    return FlatTop(side * top, count, nats)


def find_gaps(t: np.ndarray) -> Gaps:
    """Samples missing from the clock of the stamps (N,) s.

    A late stamp is followed by a short interval and is no gap, so an interval counts only if neither of the two it
    forms with its neighbours makes up for it.
    """
    dt = np.diff(t)
    short = np.quantile(dt, 0.1)
    period = float(np.median(dt[dt < HOLE * short]))
    ticks = np.round(dt / period)
    if np.mean(np.abs(dt / period - ticks) < ON_TICK) < MOST_ON_TICK or np.median(dt) > MOST_PERIODS * period:
        return Gaps(0.0, np.zeros(0), 0)
    hole = (ticks >= 2) & (dt > HOLE * period)
    pair = np.concatenate([[np.inf], dt[1:] + dt[:-1], [np.inf]])
    hole &= np.minimum(pair[1:], pair[:-1]) > MADE_UP * period
    pause = hole & (dt > LONGEST_GAP)
    return Gaps(period, (ticks - 1)[hole & ~pause], int(pause.sum()))
