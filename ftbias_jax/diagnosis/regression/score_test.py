"""Score test: what further columns and series would gain on top of a fit, to first order and without fitting them."""

from typing import NamedTuple, Self

import numpy as np

from ftbias_jax.diagnosis.regression.design_matrix import Information, information, products
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.diagnosis.thresholds import PENALTY_PER_PARAMETER

SINGLE = 1e-5
"""Share of a column's power that is uncertain in single precision: a smaller remainder is rounding error."""


class Gains(NamedTuple):
    """Gain of further columns on top of a fit, with all coefficients solved for jointly, to first order."""

    normal: np.ndarray
    """(M, M) products of the columns after those of the fit are projected out."""
    pull: np.ndarray
    """(M,) products of these columns with the error."""
    taken: np.ndarray
    """(K, M) coefficients of each column's projection on the fit's own columns."""

    def of(self, chosen: list[int]) -> float:
        """nats that these columns gain together."""
        return float(-self.pull[chosen] @ self.coefficients(chosen)) / 2

    def coefficients(self, chosen: list[int]) -> np.ndarray:
        """(len(chosen),) coefficients of these columns, solved for together."""
        normal, pull = self.normal[np.ix_(chosen, chosen)], self.pull[chosen]
        ridge = 1e-8 * max(np.trace(normal) / max(len(normal), 1), 1e-12)
        return -np.linalg.solve(normal + ridge * np.eye(len(normal)), pull)

    def pursue(self, rows: list[int], most: int, least: float) -> tuple[float, list[int]]:
        """Matching pursuit: the at most ``most`` columns of ``rows`` that gain most together, and their gain in nats.

        Each must add at least a share ``least`` of the gain.
        """
        normal, pull = self.normal[np.ix_(rows, rows)].astype(float), self.pull[rows].astype(float)
        ridge = 1e-8 * max(np.trace(normal) / max(len(rows), 1), 1e-12)
        chosen, gained, power = list[int](), 0.0, normal.diagonal().copy()
        while len(chosen) < min(most, len(rows)):
            left = normal.diagonal()
            spent = np.isin(rows, chosen) | (left < SINGLE * power)
            gains = np.where(spent, -1, pull**2 / (np.maximum(left, 0) + ridge))
            best = int(gains.argmax())
            gain = float(gains[best]) / 2
            if gain < max(2 * PENALTY_PER_PARAMETER, least * (gained + gain)):
                break
            chosen, gained = [*chosen, rows[best]], gained + gain
            # The chosen column is projected out of the others and of the error.
            taken = normal[best] / (normal[best, best] + ridge)
            pull, normal = pull - taken * pull[best], normal - np.outer(taken, normal[best])
        return gained, chosen


class PreparedFit(NamedTuple):
    """A fit to which further columns are added, with what their gains need of it."""

    fit: Fit
    information: Information
    """Information of the fit's own parameters."""
    pull: np.ndarray
    """(K,) products of the fit's columns with the error."""
    step: np.ndarray
    """(K,) Gauss-Newton step of the fit's own parameters, nearly zero where the fit has converged."""

    def at(self, error: np.ndarray) -> Self:
        """The same fit with other innovations (U, 6)."""
        pull = products(self.fit.columns, error[None])[0]
        step = -self.information.solve(pull[:, None])[:, 0]
        return self._replace(fit=self.fit._replace(error=error), pull=pull, step=step)


def prepare_fit(fit: Fit) -> PreparedFit:
    """Prepare a fit for further columns."""
    return PreparedFit(fit, information(fit.columns), *np.zeros((2, 0))).at(fit.error)


def gains(prepared_fit: PreparedFit, columns: np.ndarray) -> Gains:
    """Prepare the gains of whitened columns (M, U, 6) on top of a fit."""
    flat = columns.reshape(len(columns), -1)
    shared, taken, pull = _beside(prepared_fit, columns)
    return Gains(flat @ flat.T - shared @ taken, pull, taken)


def gain_of_each(prepared_fit: PreparedFit, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(M,) nats that each whitened column (M, U, 6) would gain separately, and (M,) its coefficient."""
    shared, taken, pull = _beside(prepared_fit, columns)
    power = np.maximum(np.einsum("muk,muk->m", columns, columns) - (shared.T * taken).sum(0), 1e-12)
    return pull**2 / power / 2, -pull / power


def _beside(prepared_fit: PreparedFit, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Projection of columns (M, U, 6) on a fit: products (M, K), coefficients (K, M), and the remaining pull (M,)."""
    shared = products(prepared_fit.fit.columns, columns)
    taken = prepared_fit.information.solve(shared.T)
    pull = columns.reshape(len(columns), -1) @ prepared_fit.fit.error.ravel() - taken.T @ prepared_fit.pull
    return shared, taken, pull
