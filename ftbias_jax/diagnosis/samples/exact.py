"""Effects that leave exact traces in the recorded numbers: repeated rows, lattices, flat tops, holes in time.

White noise never gives the same float twice, so equal numbers are evidence by themselves, and no model is needed.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis import thresholds
from ftbias_jax.diagnosis.samples.types import Finding, log_likelihood_ratio, name_channels
from ftbias_jax.model.effects.fitting import FLAT_TOPS, LATTICE, LOST
from ftbias_jax.types import AXES

EQUALS_WINDOW = 100
"""Rows in which the share of equal neighbours is counted."""
FLOAT32 = float(np.finfo(np.float32).eps)


class Lattice(NamedTuple):
    """Equally spaced values of one channel; step 0 = none."""

    step: float
    """N or Nm."""
    stderr: float
    on_lattice: int
    """Number of samples that are multiples of the step away from one another."""


class FlatTop(NamedTuple):
    """Saturation of one channel: readings that stop at one value, on one side."""

    value: float
    """N or Nm, with its sign."""
    ties: int
    """Number of samples at this value."""
    nats: float


class Gaps(NamedTuple):
    """Holes in a regular clock."""

    period: float
    """s; 0 = the stamps have no common period."""
    lost: np.ndarray
    """(G,) number of samples missing from the clock in each gap."""
    pauses: int
    """Number of holes too long to be lost samples."""


def repeated_rows(wrench: np.ndarray) -> np.ndarray:
    """(N,) rows that equal the row before in every channel of (N, k)."""
    return np.concatenate([[False], (wrench[1:] == wrench[:-1]).all(1)])


def repeated_by_chance(wrench: np.ndarray) -> float:
    """Expected number of rows of (N, k) readings on lattices that equal the row before although no sample was lost.

    How often a single channel repeats is counted in the rows that are no repeats, in windows, because a reading that
    hardly changes repeats more often.
    """
    equal = np.asarray(wrench[1:] == wrench[:-1])
    number = -(-len(equal) // EQUALS_WINDOW)
    window = np.arange(len(equal)) // EQUALS_WINDOW
    others = ~equal.all(1)
    counts = np.maximum(np.bincount(window, others, number), 1)
    shares = [np.bincount(window, channel & others, number) / counts for channel in equal.T]
    return float((np.prod(shares, axis=0) * np.bincount(window, minlength=number)).sum())


def runs(marked: np.ndarray) -> np.ndarray:
    """Lengths of the runs of marked rows (N,)."""
    edge = np.flatnonzero(np.diff(marked.astype(int), prepend=0, append=0))
    return edge[1::2] - edge[::2]


def find_dropped(repeated: np.ndarray, gaps: Gaps, by_chance: float = 0.0) -> Finding:
    """Finding of lost samples: rows that repeat the one before, marked in (N,) bool, and rows that the clock lacks.

    ``by_chance`` is the number of repeats that are expected without lost samples.
    """
    samples, copies, missing = len(repeated), int(repeated.sum()), int(gaps.lost.sum())
    total, lost = samples + missing, copies + missing
    rate, share = lost / total, copies / lost if lost else 1.0
    nats = log_likelihood_ratio(lost, thresholds.HEALTHY_RATE * total + by_chance)
    # Samples are lost in runs: the runs are independent, their samples are not. A single gap shows no rate.
    scatter = float(np.sqrt(max((runs(repeated) ** 2).sum() + (gaps.lost**2).sum(), 1)))
    detected = rate >= thresholds.LEAST_LOST and nats > thresholds.SURPRISING
    detected &= lost > thresholds.SURE * scatter
    sentence = f"{copies} of {samples} rows repeat the row before, {missing} are missing from a clock of "
    sentence += f"{1e3 * gaps.period:.3g} ms" if gaps.period else "no steady period"
    sentence += f"; {gaps.pauses} pauses" if gaps.pauses else ""
    error = {"rate": scatter / total, "repeated": (1 + scatter * np.sqrt(share * (1 - share))) / max(lost, 1)}
    return Finding(LOST, detected, {"rate": rate, "repeated": share}, error, nats, sentence)


def find_lattice(x: np.ndarray) -> Lattice:
    """The lattice on which most samples (N,) lie."""
    values, counts = np.unique(x, return_counts=True)
    levels, counts = values[counts > 1], counts[counts > 1]
    if counts.sum() < thresholds.LEAST_SHARE_ON_LATTICE * len(x) or len(levels) < 3:
        return Lattice(0.0, 0.0, 0)
    step = float(np.median(np.diff(levels)))
    number = np.round((levels - levels[np.argmax(counts)]) / step)
    weight = np.sqrt(counts)
    fit = np.polyfit(number, levels, 1, w=weight)
    off = levels - np.polyval(fit, number)
    on = np.abs(off) < thresholds.LATTICE_TOLERANCE * abs(fit[0])
    on_lattice = int(counts[on].sum())
    if on_lattice < thresholds.LEAST_SHARE_ON_LATTICE * len(x):
        return Lattice(0.0, 0.0, 0)
    resolution = FLOAT32 * float(np.abs(levels).max())
    stderr = (np.std(off[on]) + resolution) / (np.std(number[on]) * np.sqrt(on.sum()))
    return Lattice(float(fit[0]), float(stderr), on_lattice)


def find_quantisation(lattices: Sequence[Lattice], step: np.ndarray, error: np.ndarray, noise: np.ndarray) -> Finding:
    """Finding of lattices coarse relative to the stated noise: steps (6,) N, Nm, 0 = none, with standard errors."""
    coarse = step >= thresholds.COARSE * noise
    sentence, nats = "readings lie on no coarse lattice", 0.0
    if coarse.any():
        on_lattice = max(lattice.on_lattice for lattice in lattices)
        nats = log_likelihood_ratio(on_lattice, 0.1 * on_lattice)  # a tenth of them would be as close by chance
        ratio = (step / noise)[coarse].max()
        sentence = f"readings of {name_channels(coarse)} are multiples of a step of up to {ratio:.2g} noise sigmas"
    return Finding(LATTICE, bool(coarse.any()), {"step": step.tolist()}, {"step": error.tolist()}, nats, sentence)


def find_flat_tops(x: np.ndarray, noise_std: float, step: float) -> list[FlatTop]:
    """Saturation limits of one channel, among its largest and its smallest value.

    Noise scatters the samples of a pose: without a limit, few share the extreme value and more lie just inside of it.

    Args:
        x: (N,) N or Nm, readings of one channel.
        noise_std: N or Nm.
        step: of the lattice the samples lie on, 0 = none; beyond two sigmas noise no longer carries samples from level
            to level, and a pose at rest looks like a limit.
    """
    found = []
    for side in (1.0, -1.0) if step <= 2 * noise_std else ():
        outward = side * x
        top = float(np.max(outward))
        resolution: float = max(step, 2 * FLOAT32 * abs(top))
        width: float = max(float(noise_std) / 2, 2 * resolution)
        count = int((outward >= top - resolution / 4).sum())
        inside = int((outward >= top - width).sum()) - count
        nats = log_likelihood_ratio(count, (inside + 1) * resolution / width)
        if thresholds.LEAST_TIES <= count <= thresholds.MOST_TIES * len(x) and nats >= thresholds.FLAT_TOP_NATS:
            found.append(FlatTop(side * top, count, nats))
    return found


def at_top(x: np.ndarray, tops: Sequence[FlatTop]) -> np.ndarray:
    """(N,) bool: samples at a limit, which may have been rounded to the log's precision."""
    at = [np.sign(top.value) * (x - top.value) >= -8 * FLOAT32 * abs(top.value) for top in tops]
    return np.logical_or.reduce(at) if at else np.zeros(len(x), bool)


def find_saturation(tops: Sequence[Sequence[FlatTop]]) -> Finding:
    """Finding of flat tops on either side of six channels; the one with more samples gives the limit of a channel."""
    limits, words, nats = [float("inf")] * 6, [], 0.0
    for channel, found in enumerate(tops):
        if found:
            top = max(found, key=lambda top: top.ties)
            limits[channel], nats = abs(top.value), max(nats, top.nats)
            words += [f"{one.ties} samples of {AXES[channel]} at exactly {one.value:.6g}" for one in found]
    stderr = [1e-6 * limit if np.isfinite(limit) else 0.0 for limit in limits]  # float32
    sentence = "; ".join(words) or "no readings pile up at an extreme value"
    return Finding(FLAT_TOPS, bool(words), {"limits": limits}, {"limits": stderr}, nats, sentence)


def find_gaps(t: np.ndarray) -> Gaps:
    """Samples missing from the clock of the stamps (N,) s.

    A late stamp is no gap: a short interval follows it. An interval therefore counts only if no neighbour makes up for
    it.
    """
    dt = np.diff(t)
    short = np.quantile(dt, 0.1)
    period = float(np.median(dt[dt < thresholds.HOLE * short]))
    ticks = np.round(dt / period)
    if (
        np.mean(np.abs(dt / period - ticks) < thresholds.ON_TICK) < thresholds.MOST_ON_TICK
        or np.median(dt) > thresholds.MOST_PERIODS * period
    ):
        return Gaps(0.0, np.zeros(0), 0)
    hole = (ticks >= 2) & (dt > thresholds.HOLE * period)
    pair = np.concatenate([[np.inf], dt[1:] + dt[:-1], [np.inf]])
    hole &= np.minimum(pair[1:], pair[:-1]) > thresholds.MADE_UP * period
    pause = hole & (dt > thresholds.LONGEST_GAP)
    return Gaps(period, (ticks - 1)[hole & ~pause], int(pause.sum()))
