"""The whole crosstalk matrix, once crosstalk is named by the few entries that explain most.

Entries look alike on a log that loads few combinations of axes, and a search for few of them takes one for another. So
what is told of the matrix is its posterior: all entries together, each small a priori.
"""

from __future__ import annotations

import numpy as np

from ftbias_jax.diagnosis.hypothesis import Hypothesis
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression import chain_model
from ftbias_jax.diagnosis.regression.design_matrix import PRIOR_STD, change, information, lay_out, products, scores
from ftbias_jax.diagnosis.regression.evaluate import slopes, whitened
from ftbias_jax.diagnosis.regression.fit import BLOCK_SECONDS, Fit
from ftbias_jax.filtering.innovation_regression import widened_inverse

EFFECT = "crosstalk"
LIKE_A_ROTATION = 0.8
"""Share of what the log says of the matrix that a rotation of the axes makes up, from which on it may be one: of leaks
that are drawn at random it makes up a tenth."""
ENTRY_STD = 3.0
"""Of an entry a priori, in typical departures: 6 % of the load of another axis."""


def whole_matrix(problem: Problem, found: Fit, few: Hypothesis) -> tuple[np.ndarray, Hypothesis, np.ndarray]:
    """Posterior of all entries, the other numbers of the fit with them.

    Args:
        problem: of the logs.
        found: at its best.
        few: its hypothesis of crosstalk.

    Returns:
        coordinates (P,), crosstalk with all its entries free, and the covariance (30, 30) of these.
    """
    entries = chain_model.coordinates(problem.joints, "crosstalk").tolist()
    further = [i for i in entries if i not in few.free]
    free = (*found.free, *further)
    beside = whitened(problem, slopes(problem, found.z, found.link, further))
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
    rotation, share = nearest_rotation(z[list(whole.free)], np.linalg.pinv(spread))
    if share < LIKE_A_ROTATION:
        return ""
    degrees = ", ".join(f"{x:.2f}" for x in np.rad2deg(rotation))
    return (
        f"; or the sensor is mounted turned, or an encoder is off: the leaks are those of a turn by ({degrees}) degrees"
    )


def nearest_rotation(leaks: np.ndarray, precision: np.ndarray) -> tuple[np.ndarray, float]:
    """The small rotation of force and torque alike that leaks are nearest to.

    Args:
        leaks: (30,) typical departures, the entries beside the diagonal row by row.
        precision: (30, 30) inverse covariance: what the log does not determine does not count.

    Returns:
        (3,) rad, from believed to true axes, and the share of what the log says of the leaks that it makes up.
    """
    unit = next(np.asarray(b.unit) for b in chain_model.blocks(1) if b.effect == EFFECT)
    turns = np.stack([_turn(axis)[~np.eye(6, dtype=bool)] / unit for axis in range(3)], 1)
    rotation = np.linalg.lstsq(turns.T @ precision @ turns, turns.T @ precision @ leaks)[0]
    left = leaks - turns @ rotation
    return rotation, 1 - float(left @ precision @ left) / max(float(leaks @ precision @ leaks), 1e-300)


def _turn(axis: int) -> np.ndarray:
    """(6, 6) change of a wrench's coordinates by a small turn about one axis, per rad: R^T = 1 + r [axis]."""
    skew = np.zeros((3, 3))
    first, second = (axis + 1) % 3, (axis + 2) % 3
    skew[first, second], skew[second, first] = 1.0, -1.0
    return np.kron(np.eye(2), skew)
