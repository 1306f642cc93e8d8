"""What is switched on and off: the times at which that which a fit leaves changes its level, by exact segmentation."""

from collections.abc import Collection, Iterator
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.evaluate import measured
from ftbias_jax.diagnosis.regression.fit import Fit, predicted
from ftbias_jax.diagnosis.samples.bins import sum_of_bins
from ftbias_jax.diagnosis.thresholds import HANDOVER, MOST_TIMES
from ftbias_jax.model.effects.terms.types import State

COARSE = 1024
"""Stretches of a log between which its level may change: the work grows with their square."""
PRICE = 4.0
"""Times the logarithm of the number of stretches, a change and channel: four times that of BIC, because drift and
motion change the level, too; ``alternating`` tells what is switched."""
TOGETHER = 16
"""Ends of a segmentation that are worked out at once."""
SHARES = (0.3, 0.6)
"""Of the largest change, from which on a change is one of what is switched."""
REACH = 2
"""Stretches on either side of a change in which its time is looked for."""


class _Seen(NamedTuple):
    """What a fit leaves as something that may be switched sees it; its strength does not change while it is on."""

    name: str
    """"sensor", "force" or "torque" (of the base), or "payload"."""
    suggests: tuple[str, ...]
    """What else may have the same times."""
    axes: np.ndarray
    """(U, C, k) what a unit of each of its k numbers adds to C channels of the reading."""
    left: np.ndarray
    """(U, C)."""
    weight: np.ndarray
    """(U, C) one over the variance; 0 = not measured."""


def switches(problem: Problem, state: State, fit: Fit, names: Collection[str]) -> Iterator[tuple[str, np.ndarray]]:
    """(name of what is switched, times (N,) s at which it goes on and off in turn), as what a fit leaves suggests them.

    Of these names alone, and only of single logs: in another one the times are others.
    """
    if len(problem.parts) > 1:
        return
    known = problem.samples > 0
    left = np.where(known, measured(problem) - predicted(problem, fit), 0.0)
    told: set[tuple[str, tuple[float, ...]]] = set()
    for seen in _ways(state, left, np.where(known, 1 / problem.variance, 0.0)):
        wanted = [name for name in (seen.name, *seen.suggests) if name in names]
        for times in _suggested(state, seen) if wanted else ():
            for name in wanted:
                # A constant force of the sensor is like a bias: only for others it matters what is on at first.
                for own in [times] if name == "sensor" else [times, _inverted(times)]:
                    if 0 < len(own) <= MOST_TIMES and (name, tuple(own)) not in told:
                        told.add((name, tuple(own)))
                        yield name, own


def _inverted(times: np.ndarray) -> np.ndarray:
    """Times (N,) s of what is on when the other one is off."""
    return times[1:] if times[0] == 0 else np.concatenate([[0.0], times])


def _ways(state: State, left: np.ndarray, weight: np.ndarray) -> Iterator[_Seen]:
    """All ways to see what is left of the reading (U, 6), with one over its variance (U, 6)."""
    forces, torques = slice(0, 3), slice(3, 6)
    to_sensor = state.rotation.transpose(0, 2, 1)
    pull = to_sensor @ (state.gravity - state.acceleration)[:, :, None]
    yield _Seen("sensor", ("force", "torque", "payload"), np.broadcast_to(np.eye(6), (len(left), 6, 6)), left, weight)
    yield _Seen("force", ("payload",), to_sensor, left[:, forces], weight[:, forces])
    yield _Seen("torque", (), to_sensor, left[:, torques], weight[:, torques])
    yield _Seen("payload", ("force",), pull, left[:, forces], weight[:, forces])


def _suggested(state: State, seen: _Seen) -> Iterator[np.ndarray]:
    """Times (N,) s at which something is switched."""
    stretch = np.unique((state.t / (state.t[-1] + 1e-9) * COARSE).astype(int), return_inverse=True)[1]
    edges = np.searchsorted(stretch, np.arange(stretch[-1] + 2))
    square = np.einsum("tc,tck->tk", seen.weight, seen.axes**2)
    weight = sum_of_bins(stretch, square)
    bias = (seen.weight * seen.left).sum(0) / np.maximum(seen.weight.sum(0), 1e-300)
    # A load is touched while it is handed over: what is brief may be larger than its weight.
    brief = int(HANDOVER / state.t[-1] * COARSE) if seen.name == "payload" else 0

    def beside(bias: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What is left beside a bias (C,), along the axes, in bins and in stretches, and where its level changes."""
        along = np.einsum("tc,tck->tk", seen.weight * (seen.left - bias), seen.axes)
        x = sum_of_bins(stretch, along) / np.maximum(weight, 1e-300)
        return along, x, changes(x, weight * _whiteness(x, weight))

    along, x, cuts = beside(bias)
    tried: set[tuple[int, ...]] = set()
    for share, shortest in product(SHARES, sorted({0, brief})):
        rows = _switched_at(x, weight, cuts, share, shortest)
        if len(rows) and tuple(rows) not in tried:
            tried.add(tuple(rows))
            found = _refined(along, square, edges, rows)
            # Once more, beside the bias that goes with these times.
            along_then, x_then, cuts_then = beside(_bias_beside(seen, found))
            rows = _switched_at(x_then, weight, cuts_then, share, shortest)
            yield _times_of(state, _refined(along_then, square, edges, rows) if len(rows) else found)


def _switched_at(x: np.ndarray, weight: np.ndarray, cuts: np.ndarray, share: float, shortest: int) -> np.ndarray:
    """(M,) rows, of those (K,) where the level of series (N, k) changes, before which it goes up and down in turn."""
    cuts = lasting(x, weight, cuts, shortest) if shortest else cuts
    if not len(cuts):
        return cuts
    levels = [_mean(x, weight, a, b) for a, b in zip([0, *cuts], [*cuts, len(x)], strict=True)]
    jumps = np.diff(levels, axis=0) * np.sqrt(np.median(weight, 0))
    along = jumps @ np.linalg.svd(jumps, full_matrices=False)[2][0]
    return cuts[alternating(along, share * np.abs(along).max())]


def changes(x: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(K,) rows before which the level of series (N, C) changes: piecewise constant, by penalised least squares.

    Exact by dynamic programming, pruned as PELT does it (Killick, Fearnhead and Eckley, 2012).
    """
    (n, channels), price = x.shape, PRICE * np.log(max(len(x), 2)) * x.shape[1]
    # What a level takes of the sum of squares is all in which segmentations differ.
    sums = np.zeros((2, channels, n + 1))
    sums[:, :, 1:] = np.cumsum([weight.T, (weight * x).T], 2)
    best, last = np.full(n + 1, -price), np.zeros(n + 1, int)
    starts = np.array([0])
    for block in range(1, n + 1, TOGETHER):
        ends = np.arange(block, min(block + TOGETHER, n + 1))
        tried, before = np.append(starts, ends), len(starts)
        total, first = sums[:, :, ends, None] - sums[:, :, None, tried]
        cost = -(first**2 / np.maximum(np.abs(total), 1e-300)).sum(0)
        cost[:, :before] += best[starts]
        for k, end in enumerate(ends):
            cost[k, before : before + k] += best[block:end]
            chosen = cost[k, : before + k].argmin()
            best[end], last[end] = cost[k, chosen] + price, tried[chosen]
        starts = tried[np.append(cost[-1, :-1] <= best[end], True)]
    cuts, end = list[int](), n
    while (end := int(last[end])) > 0:
        cuts.append(end)
    return np.array(cuts[::-1], int)


def lasting(x: np.ndarray, weight: np.ndarray, cuts: np.ndarray, shortest: int) -> np.ndarray:
    """(L,) of the rows (K,) before which a level changes: of several that enclose fewer rows the one that lasts most.

    That is where most of the difference comes that there is between the levels before and after them.
    """
    piles = np.split(cuts, np.flatnonzero(np.diff(cuts) >= shortest) + 1) if len(cuts) else []
    ends, kept = [0, *(pile[-1] for pile in piles)], list[int]()
    for pile, start, end in zip(piles, ends, [*(pile[0] for pile in piles[1:]), len(x)], strict=False):
        edges = [start, *pile, end]
        levels = np.array([_mean(x, weight, a, b) for a, b in pairwise(edges)])
        along = np.diff(levels, axis=0) @ (np.median(weight, 0) * (levels[-1] - levels[0]))
        kept.append(int(pile[along.argmax()]))
    return np.array(kept, int)


def alternating(along: np.ndarray, least: float) -> np.ndarray:
    """(M,) which changes of (K,) are large and go up and down in turn; the largest of several in one direction."""
    kept: list[int] = []
    for k in np.flatnonzero(np.abs(along) >= least):
        if not kept or along[k] * along[kept[-1]] < 0:
            kept.append(int(k))
        elif abs(along[k]) > abs(along[kept[-1]]):
            kept[-1] = int(k)
    return np.array(kept, int)


def _whiteness(x: np.ndarray, weight: np.ndarray) -> float:
    """The stated variance per what a series scatters from one row to the next, where that is more."""
    variance = 1 / np.maximum(weight, 1e-300)
    scatter = np.median(np.abs(np.diff(x, axis=0)) / np.sqrt(variance[1:] + variance[:-1])) / 0.6745
    return float(1 / max(scatter, 1.0) ** 2)


def _mean(x: np.ndarray, weight: np.ndarray, first: int, end: int) -> np.ndarray:
    own = weight[first:end]
    return (own * x[first:end]).sum(0) / np.maximum(own.sum(0), 1e-300)


def _refined(along: np.ndarray, square: np.ndarray, edges: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """(M,) bins, with a fraction, in which the changes happen: by how much of either level is near them.

    Args:
        along: (U, n) weighted products of what is left with the axes.
        square: (U, n) weights of their levels.
        edges: (N + 1,) first bins of the stretches.
        rows: (M,) stretches before which the level changes.
    """
    x = along / np.maximum(square, 1e-300)

    def one(earlier: int, row: int, later: int) -> float:
        first, end = (edges[np.clip(row + by, earlier, later)] for by in (-REACH, REACH))
        before = _mean(x, square, edges[earlier], max(first, edges[earlier] + 1))
        jump = _mean(x, square, min(end, edges[later] - 1), edges[later]) - before
        near = slice(first, end)
        size = np.maximum((square[near] * jump**2).sum(1), 1e-300)
        passed = (square[near] * jump * (x[near] - before)).sum(1) / size
        return float(np.clip(end - passed.sum(), first, end))

    around = [0, *rows, len(edges) - 1]
    return np.array([one(*around[k : k + 3]) for k in range(len(rows))])


def _bias_beside(seen: _Seen, at: np.ndarray) -> np.ndarray:
    """(C,) N, Nm: the bias beside what is switched at bins (M,), by least squares."""
    gate: np.ndarray = np.searchsorted(at, np.arange(len(seen.left)), side="right") % 2
    count = seen.left.shape[1]
    columns = np.concatenate(
        [np.broadcast_to(np.eye(count), (len(gate), count, count)), gate[:, None, None] * seen.axes], 2
    )
    root = np.sqrt(seen.weight)
    flat = (root[:, :, None] * columns).reshape(-1, columns.shape[2])
    found: np.ndarray = np.linalg.lstsq(flat, (root * seen.left).ravel(), rcond=1e-9)[0]
    return found[:count]


def _times_of(state: State, bins: np.ndarray) -> np.ndarray:
    """(M,) s at which bins, with fractions, begin: means of samples are in the middle of theirs."""
    half = float(np.median(np.diff(state.t))) / 2
    edges = np.append(state.t - half, state.t[-1] + half)
    return np.maximum(np.interp(bins, np.arange(len(edges)), edges), 0.0)
