"""The whole matrix of leaks between channels, once it is named by the few entries that explain most.

Entries look alike on a log that loads few combinations of axes, and a search for few of them takes one for another. So
what is reported of the matrix is its posterior: all entries together, each small a priori.
"""

from __future__ import annotations

import numpy as np

from ftbias_jax.diagnosis.hypothesis import Hypothesis, movable
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.design_matrix import change, information, lay_out, products, scores
from ftbias_jax.diagnosis.regression.evaluate import slopes, whitened
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.diagnosis.thresholds import BLOCK_SECONDS, ENTRY_STD, LIKE_A_ROTATION, PRIOR_STD
from ftbias_jax.filtering.innovation_regression import widened_inverse
from ftbias_jax.model.effects.fitting import Entries
from ftbias_jax.model.effects.types import Effect


def whole_matrix(problem: Problem, found: Fit, few: Hypothesis) -> tuple[np.ndarray, Hypothesis, np.ndarray]:
    """Posterior of all entries, the other numbers of the fit with them.

    Args:
        problem: of the logs.
        found: at its best.
        few: its hypothesis of such a matrix.

    Returns:
        coordinates (P,), the hypothesis with all E entries free that have a scale, and their covariance (E, E).
    """
    entries = movable(problem, problem.catalogue[few.effect])
    further = [i for i in entries if i not in few.free]
    free = (*found.free, *further)
    beside = whitened(problem, slopes(problem, found.z, further))
    columns = found.columns._replace(moving=np.concatenate([found.columns.moving, beside]))
    rows = [free.index(i) for i in entries]
    precision = information(columns).matrix()
    precision[rows, rows] += ENTRY_STD**-2 - PRIOR_STD**-2
    pull = products(lay_out(columns), found.error[None])[0]
    pull[rows] += found.z[entries] / ENTRY_STD**2
    step = -np.linalg.solve(precision, pull)
    z = found.z.copy()
    z[list(free)] += step[: len(free)]
    by_block = scores(columns, found.error + change(columns, step), problem.block(BLOCK_SECONDS))
    spread = widened_inverse(by_block, precision)[np.ix_(rows, rows)]
    return z, few._replace(free=tuple(entries), start=tuple(z[entries].tolist())), spread


def doubt(problem: Problem, found: Fit, h: Hypothesis) -> str:
    """Why leaks between the channels may be a rotation of the sensor's axes: they make up one."""
    z, whole, spread = whole_matrix(problem, found, h)
    of_entry = size_of_entries(problem.catalogue[h.effect])
    leaks = np.zeros((6, 6))
    leaks[of_entry > 0] = z[list(whole.free)]
    rotation, share = nearest_rotation(leaks * of_entry, of_entry, np.linalg.pinv(spread))
    if share < LIKE_A_ROTATION:
        return ""
    degrees = ", ".join(f"{x:.2f}" for x in np.rad2deg(rotation))
    return (
        f"; or the sensor is mounted turned, or an encoder is off: the leaks are those of a turn by ({degrees}) degrees"
    )


def size_of_entries(effect: Effect) -> np.ndarray:
    """(6, 6) typical departure of the entries of an effect's matrix; 0 where they are not fitted."""
    assert isinstance(effect.fit.search, Entries)
    size: np.ndarray = np.broadcast_to(effect.parameter(effect.fit.search.matrix).scale, (6, 6))
    return size


def nearest_rotation(matrix: np.ndarray, size: np.ndarray, precision: np.ndarray) -> tuple[np.ndarray, float]:
    """The small rotation of force and torque alike that leaks are nearest to.

    Args:
        matrix: (6, 6) leaks: what the reading has beside the load.
        size: (6, 6) typical departure of the E entries that count, 0 of the others.
        precision: (E, E) inverse covariance in typical departures: what the log does not determine does not count.

    Returns:
        (3,) rad, from believed to true axes, and the share of what the log says of the leaks that it makes up.
    """
    counts = size > 0
    leaks = matrix[counts] / size[counts]
    turns = np.stack([_turn(axis)[counts] / size[counts] for axis in range(3)], 1)
    rotation = np.linalg.lstsq(turns.T @ precision @ turns, turns.T @ precision @ leaks)[0]
    left = leaks - turns @ rotation
    return rotation, 1 - float(left @ precision @ left) / max(float(leaks @ precision @ leaks), 1e-300)


def _turn(axis: int) -> np.ndarray:
    """(6, 6) change of a wrench's coordinates by a small turn about one axis, per rad: R^T = 1 + r [axis]."""
    skew = np.zeros((3, 3))
    first, second = (axis + 1) % 3, (axis + 2) % 3
    skew[first, second], skew[second, first] = 1.0, -1.0
    return np.kron(np.eye(2), skew)
