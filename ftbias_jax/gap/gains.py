"""What further columns and series would gain on top of a fit, to first order: none of them is fitted for it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ftbias_jax.gap.columns import information, products, step_and_gain
from ftbias_jax.gap.fit import Fit


class Gains(NamedTuple):
    """What further columns would gain on top of a fit, all coefficients solved for again together, to first order."""

    normal: np.ndarray
    """(M, M) products of the columns, after those of the fit are taken out of them."""
    pull: np.ndarray
    """(M,) products with the error."""

    def of(self, chosen: list[int]) -> float:
        """nats that these columns gain together."""
        normal, pull = self.normal[np.ix_(chosen, chosen)], self.pull[chosen]
        ridge = 1e-8 * max(np.trace(normal) / len(normal), 1e-12)
        return float(pull @ np.linalg.solve(normal + ridge * np.eye(len(normal)), pull)) / 2


def gains(accepted: Fit, columns: np.ndarray) -> Gains:
    """Prepare the gains of whitened columns (M, U, 6) on top of a fit."""
    flat = columns.reshape(len(columns), -1)
    shared, taken, pull = _beside(accepted, columns)
    return Gains(flat @ flat.T - shared @ taken, pull)


def gain_of_each(accepted: Fit, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(M,) nats that every whitened column (M, U, 6) would gain by itself, and (M,) its coefficient."""
    shared, taken, pull = _beside(accepted, columns)
    power = np.maximum(np.einsum("muk,muk->m", columns, columns) - (shared.T * taken).sum(0), 1e-12)
    return pull**2 / power / 2, -pull / power


def _beside(accepted: Fit, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What a fit itself does of columns (M, U, 6): products (M, K), coefficients (K, M), and the pull (M,) left."""
    own, error = accepted.columns, accepted.error
    shared = products(own, columns)
    taken = np.linalg.solve(information(own), shared.T)
    return shared, taken, columns.reshape(len(columns), -1) @ error.ravel() - taken.T @ products(own, error[None])[0]


def gain_of_series(accepted: Fit, series: np.ndarray) -> float:
    """nats that linear series (E, U, 6) gain together, with a coefficient for every channel."""
    whole = accepted.columns._replace(series=np.concatenate([accepted.columns.series, series]))
    return step_and_gain(whole, accepted.error)[1]
