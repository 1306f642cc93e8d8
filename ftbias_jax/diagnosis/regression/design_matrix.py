"""Whitened design matrix of a fit, the derivatives of the innovations, and its normal equations.

A linear series has a coefficient for every channel, which changes no other channel. A series therefore stands for six
columns, each of them zero in five channels, and products with them are computed channel by channel.
"""

from typing import NamedTuple, Self

import numpy as np

from ftbias_jax.diagnosis.thresholds import PRIOR_STD

RIDGE = 1e-9
"""Share of the mean information that is added to the diagonal, because some series vanish."""


class Columns(NamedTuple):
    """Design matrix of F coordinates and E series over U bins: K = F + 6 E columns, coordinates first, then series."""

    moving: np.ndarray
    """(F, U, 6) derivatives with respect to the coordinates."""
    series: np.ndarray
    """(E, U, 6) whitened series."""

    @property
    def size(self) -> int:
        """Number of columns K."""
        return len(self.moving) + 6 * len(self.series)

    def at(self, rows: np.ndarray) -> Self:
        """The columns at some bins, selected by a mask or by indices (U,)."""
        return self._replace(moving=self.moving[:, rows], series=self.series[:, rows])


def products(own: Columns, others: np.ndarray) -> np.ndarray:
    """(M, K) products of series (M, U, 6) with all columns, summed over bins and channels."""
    of_moving: np.ndarray = _flat(others) @ _flat(own.moving).T
    if not len(own.series):
        return of_moving
    of_series = channels_first(others) @ channels_first(own.series).transpose(0, 2, 1)
    return np.concatenate([of_moving, of_series.transpose(1, 2, 0).reshape(len(others), -1)], 1)


def _flat(x: np.ndarray) -> np.ndarray:
    """(M, U, 6) -> (M, 6 U), M may be 0."""
    return x.reshape(len(x), x.shape[1] * x.shape[2])


def channels_first(x: np.ndarray) -> np.ndarray:
    """(M, U, 6) -> (6, M, U), contiguous in memory, because otherwise its products take ten times as long."""
    return np.ascontiguousarray(x.transpose(2, 0, 1))


class Information(NamedTuple):
    """Information matrix: products of all columns with one another plus the prior of coordinates, never singular."""

    moving: np.ndarray
    """(F, F) block of the coordinates."""
    mixed: np.ndarray
    """(6, F, E) blocks of coordinates and series, per channel."""
    series: np.ndarray
    """(6, E, E) blocks of the series, per channel; those between channels are zero."""

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Solve information x = right for (K, M) right-hand sides, channel by channel for the series."""
        F, (E, M) = len(self.moving), (self.series.shape[1], right.shape[1])
        of_moving, of_series = right[:F], right[F:].reshape(E, 6, M).transpose(1, 0, 2)
        alone = np.linalg.solve(self.series, np.concatenate([of_series, self.mixed.transpose(0, 2, 1)], 2))
        by_right, by_moving = alone[:, :, :M], alone[:, :, M:]
        left = self.moving - (self.mixed @ by_moving).sum(0)
        moving = np.linalg.solve(left, of_moving - (self.mixed @ by_right).sum(0))
        series = by_right - by_moving @ moving
        return np.concatenate([moving, series.transpose(1, 0, 2).reshape(6 * E, M)])

    def matrix(self) -> np.ndarray:
        """The information as a dense matrix (K, K)."""
        F, E = len(self.moving), self.series.shape[1]
        whole = np.zeros((F + 6 * E, F + 6 * E))
        whole[:F, :F] = self.moving
        for k in range(6):
            whole[:F, F + k :: 6], whole[F + k :: 6, :F] = self.mixed[k], self.mixed[k].T
            whole[F + k :: 6, F + k :: 6] = self.series[k]
        return whole


def information(columns: Columns, prior_std: np.ndarray | None = None) -> Information:
    """Information of all parameters, with the prior of the first coordinates; None = PRIOR_STD for all of them."""
    own, by_channel, F = _flat(columns.moving), channels_first(columns.series), len(columns.moving)
    transposed = by_channel.transpose(0, 2, 1)
    moving, series = own @ own.T, by_channel @ transposed
    trace = np.trace(moving) + np.trace(series, axis1=1, axis2=2).sum()
    ridge = RIDGE * max(float(trace) / max(columns.size, 1), 1e-12)
    std = np.full(F, PRIOR_STD) if prior_std is None else prior_std
    prior = np.pad(std**-2, (0, F - len(std)))
    return Information(
        moving + np.diag(prior + ridge),
        channels_first(columns.moving) @ transposed,
        series + ridge * np.eye(len(columns.series)),
    )


def change(columns: Columns, numbers: np.ndarray) -> np.ndarray:
    """(U, 6) change of the innovations due to a change (K,) of coordinates and coefficients."""
    F = len(columns.moving)
    of_series = np.einsum("ek,euk->uk", numbers[F:].reshape(-1, 6), columns.series)
    return np.tensordot(numbers[:F], columns.moving, 1) + of_series


def step_and_gain(columns: Columns, error: np.ndarray) -> tuple[np.ndarray, float]:
    """Gauss-Newton step (K,) that brings the innovations (U, 6) nearest to zero, and the nats that it gains."""
    pull = products(columns, error[None])[0]
    step: np.ndarray = -information(columns).solve(pull[:, None])[:, 0]
    return step, -float(step @ pull) / 2


def scores(columns: Columns, error: np.ndarray, block: np.ndarray) -> np.ndarray:
    """(blocks, K) scores: derivatives of each block's squared innovations; block (U,): number of each bin's block."""
    pieces = np.split(np.argsort(block, kind="stable"), np.cumsum(np.bincount(block))[:-1])
    return np.stack([products(columns.at(rows), error[None, rows])[0] for rows in pieces])
