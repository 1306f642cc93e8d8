"""Whitened derivatives of the innovations by everything that a fit may change, and the normal equations they make.

A linear series has a coefficient for every channel, and a channel's coefficient changes no other channel. So a series
stands for six columns, each of them zero in five channels, and products with them are worked out channel by channel.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

PRIOR_STD = 30.0
"""Of a coordinate, in typical departures: keeps what the motion does not excite at zero."""
RIDGE = 1e-9
"""Share of the mean information that is added, for series that vanish."""


class Columns(NamedTuple):
    """F coordinates and E series over U bins: K = F + 6 E numbers, the coordinates first, then series by series."""

    moving: np.ndarray
    """(F, U, 6) derivatives by the coordinates."""
    series: np.ndarray
    """(E, U, 6)."""

    @property
    def size(self) -> int:
        """K."""
        return len(self.moving) + 6 * len(self.series)

    def at(self, rows: np.ndarray) -> Columns:
        """Those of some bins, chosen by a mask or by indices (U,)."""
        return Columns(self.moving[:, rows], self.series[:, rows])


def products(columns: Columns, others: np.ndarray) -> np.ndarray:
    """(M, U, 6) -> (M, K) sums over bins and channels."""
    of_moving = _flat(others) @ _flat(columns.moving).T
    of_series = channels_first(others) @ channels_first(columns.series).transpose(0, 2, 1)
    return np.concatenate([of_moving, of_series.transpose(1, 2, 0).reshape(len(others), 6 * len(columns.series))], 1)


def _flat(x: np.ndarray) -> np.ndarray:
    """(M, U, 6) -> (M, 6 U), M may be 0."""
    return x.reshape(len(x), x.shape[1] * x.shape[2])


def channels_first(x: np.ndarray) -> np.ndarray:
    """(M, U, 6) -> (6, M, U) in order in memory, or else its products take ten times as long."""
    return np.ascontiguousarray(x.transpose(2, 0, 1))


def normal_matrix(columns: Columns) -> np.ndarray:
    """(K, K) products of all columns."""
    F, series = len(columns.moving), channels_first(columns.series)
    matrix = np.zeros((columns.size, columns.size))
    matrix[:F] = products(columns, columns.moving)
    matrix[F:, :F] = matrix[:F, F:].T
    for k in range(6):
        matrix[F + k :: 6, F + k :: 6] = series[k] @ series[k].T
    return matrix


def information(columns: Columns, coordinates: int | None = None) -> np.ndarray:
    """(K, K) normal matrix with the prior of the coordinates, never singular.

    Args:
        columns: at the fit. coordinates: how many of the moving columns have the prior; all if not given.
    """
    matrix = normal_matrix(columns)
    matrix += RIDGE * np.eye(len(matrix)) * max(float(np.trace(matrix)) / max(len(matrix), 1), 1e-12)
    prior = np.arange(len(columns.moving) if coordinates is None else coordinates)
    matrix[prior, prior] += PRIOR_STD**-2
    return matrix


def change(columns: Columns, numbers: np.ndarray) -> np.ndarray:
    """(K,) numbers -> (U, 6) what they add to the innovations."""
    F = len(columns.moving)
    of_series = np.einsum("ek,euk->uk", numbers[F:].reshape(-1, 6), columns.series)
    total: np.ndarray = np.tensordot(numbers[:F], columns.moving, 1) + of_series
    return total


def best_step(columns: Columns, error: np.ndarray) -> np.ndarray:
    """(K,) change of all numbers that brings the innovations (U, 6) nearest to zero."""
    return step_and_gain(columns, error)[0]


def step_and_gain(columns: Columns, error: np.ndarray) -> tuple[np.ndarray, float]:
    """The best step, and the nats that it gains."""
    (pull,) = products(columns, error[None])
    step: np.ndarray = -np.linalg.solve(information(columns), pull)
    return step, -float(step @ pull) / 2


def scores(columns: Columns, error: np.ndarray, block: np.ndarray) -> np.ndarray:
    """(blocks, K) derivatives of each block's squared innovations; block (U,) = its number."""
    pieces = np.split(np.argsort(block, kind="stable"), np.cumsum(np.bincount(block))[:-1])
    return np.stack([products(columns.at(rows), error[None, rows])[0] for rows in pieces])
