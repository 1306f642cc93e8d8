"""Switching on and off: times at which the residual of a fit changes its level, by exact segmentation."""

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
"""Number of segments of a log between which its level may change: the effort grows with their square."""
PRICE = 4.0
"""Penalty per change and channel in logarithms of the number of segments: four times that of BIC, because drift and
motion change the level, too; ``alternating`` selects what is switched."""
TOGETHER = 16
"""Number of segmentation ends that are computed together."""
SHARES = (0.3, 0.6)
"""Shares of the largest change from which a change counts as switching."""
REACH = 2
"""Segments on either side of a change in which its time is searched."""


class _Seen(NamedTuple):
    """Residual of a fit from the view of something that may be switched, whose strength is constant while it is on."""

    name: str
    """"sensor", "force" or "torque" (of the base), or "payload"."""
    suggests: tuple[str, ...]
    """Other kinds that may have the same times."""
    axes: np.ndarray
    """(U, C, k) contribution to C channels of the reading per unit of each of its k numbers."""
    left: np.ndarray
    """(U, C) residual."""
    weight: np.ndarray
    """(U, C) inverse variance; 0 = not measured."""


def switches(problem: Problem, state: State, fit: Fit, names: Collection[str]) -> Iterator[tuple[str, np.ndarray]]:
    """(name, times (N,) s of switching on and off alternately) that the residual of a fit suggests.

    Restricted to the given names, and to single logs, because switching times differ between logs.
    """
    if len(problem.parts) > 1:
        return
    known = problem.samples > 0
    left = np.where(known, measured(problem) - predicted(problem, fit), 0.0)
    proposed: set[tuple[str, tuple[float, ...]]] = set()
    for seen in _ways(state, left, np.where(known, 1 / problem.variance, 0.0)):
        wanted = [name for name in (seen.name, *seen.suggests) if name in names]
        for times in _suggested(state, seen) if wanted else ():
            for name in wanted:
                # A constant force in the sensor is equivalent to a bias, so the initial state matters only for others.
                for own in [times] if name == "sensor" else [times, _inverted(times)]:
                    if 0 < len(own) <= MOST_TIMES and (name, tuple(own)) not in proposed:
                        proposed.add((name, tuple(own)))
                        yield name, own


def _inverted(times: np.ndarray) -> np.ndarray:
    """Times (N,) s of something that is on while the other is off."""
    return times[1:] if times[0] == 0 else np.concatenate([[0.0], times])


def _ways(state: State, left: np.ndarray, weight: np.ndarray) -> Iterator[_Seen]:
    """All views of the residual of the reading (U, 6), with its inverse variance (U, 6)."""
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
    # A load is touched during its hand-over, so brief forces may exceed its weight.
    brief = int(HANDOVER / state.t[-1] * COARSE) if seen.name == "payload" else 0

    def beside(bias: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Residual after subtracting a bias (C,), along the axes, in bins and in segments; where its level changes."""
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
            # Repeated with the bias that belongs to these times.
            along_then, x_then, cuts_then = beside(_bias_beside(seen, found))
            rows = _switched_at(x_then, weight, cuts_then, share, shortest)
            yield _times_of(state, _refined(along_then, square, edges, rows) if len(rows) else found)


def _switched_at(x: np.ndarray, weight: np.ndarray, cuts: np.ndarray, share: float, shortest: int) -> np.ndarray:
    """(M,) of the rows (K,) where the level of series (N, k) changes, before which it rises and falls alternately."""
    cuts = lasting(x, weight, cuts, shortest) if shortest else cuts
    if not len(cuts):
        return cuts
    levels = [_mean(x, weight, a, b) for a, b in zip([0, *cuts], [*cuts, len(x)], strict=True)]
    jumps = np.diff(levels, axis=0) * np.sqrt(np.median(weight, 0))
    along = jumps @ np.linalg.svd(jumps, full_matrices=False)[2][0]
    return cuts[alternating(along, share * np.abs(along).max())]


def changes(x: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(K,) rows before which the level of series (N, C) changes: piecewise constant, by penalised least squares.

    Exact by dynamic programming with the pruning of PELT (Killick, Fearnhead and Eckley, 2012).
    """
    (n, channels), price = x.shape, PRICE * np.log(max(len(x), 2)) * x.shape[1]
    # Segmentations differ only by the sum of squares that their levels explain.
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
    """(L,) of the rows (K,) before which a level changes; of several that enclose few rows, the most lasting change.

    It is the one that contributes most to the difference of the levels before and after all of them.
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
    """(M,) indices of the changes (K,) that are large and alternate in sign; the largest of several of one sign."""
    kept: list[int] = []
    for k in np.flatnonzero(np.abs(along) >= least):
        if not kept or along[k] * along[kept[-1]] < 0:
            kept.append(int(k))
        elif abs(along[k]) > abs(along[kept[-1]]):
            kept[-1] = int(k)
    return np.array(kept, int)


def _whiteness(x: np.ndarray, weight: np.ndarray) -> float:
    """Ratio of the stated variance to a series' scatter from one row to the next; 1 if the scatter is not larger."""
    variance = 1 / np.maximum(weight, 1e-300)
    scatter = np.median(np.abs(np.diff(x, axis=0)) / np.sqrt(variance[1:] + variance[:-1])) / 0.6745
    return float(1 / max(scatter, 1.0) ** 2)


def _mean(x: np.ndarray, weight: np.ndarray, first: int, end: int) -> np.ndarray:
    own = weight[first:end]
    return (own * x[first:end]).sum(0) / np.maximum(own.sum(0), 1e-300)


def _refined(along: np.ndarray, square: np.ndarray, edges: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """(M,) fractional bins in which the changes happen, by how much of either level is found near them.

    Args:
        along: (U, n) weighted products of the residual with the axes.
        square: (U, n) weights of their levels.
        edges: (N + 1,) first bins of the segments.
        rows: (M,) segments before which the level changes.
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
    """(C,) N, Nm: bias fitted together with a switching at bins (M,), by least squares."""
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
    """(M,) s at which fractional bins begin, because bins' times are the middle of their samples."""
    half = float(np.median(np.diff(state.t))) / 2
    edges = np.append(state.t - half, state.t[-1] + half)
    return np.maximum(np.interp(bins, np.arange(len(edges)), edges), 0.0)
