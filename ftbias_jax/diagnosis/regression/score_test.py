"""What further columns and series would gain on top of a fit, to first order: none of them is fitted for it."""

from typing import NamedTuple, Self

import numpy as np

from ftbias_jax.diagnosis.regression.design_matrix import Information, information, products
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.diagnosis.thresholds import NATS_PER_DEGREE

SINGLE = 1e-5
"""Share of a column's power that products in single precision are not sure of: what is left of less is rounding."""


class Gains(NamedTuple):
    """What further columns would gain on top of a fit, all coefficients solved for again together, to first order."""

    normal: np.ndarray
    """(M, M) products of the columns, after those of the fit are taken out of them."""
    pull: np.ndarray
    """(M,) products with the error."""
    taken: np.ndarray
    """(K, M) what the fit's own numbers do of each column."""

    def of(self, chosen: list[int]) -> float:
        """nats that these columns gain together."""
        return float(-self.pull[chosen] @ self.coefficients(chosen)) / 2

    def coefficients(self, chosen: list[int]) -> np.ndarray:
        """(len(chosen),) of these columns together."""
        normal, pull = self.normal[np.ix_(chosen, chosen)], self.pull[chosen]
        ridge = 1e-8 * max(np.trace(normal) / max(len(normal), 1), 1e-12)
        return -np.linalg.solve(normal + ridge * np.eye(len(normal)), pull)

    def pursue(self, rows: list[int], most: int, least: float) -> tuple[float, list[int]]:
        """Matching pursuit: the few columns of these that gain most together, at most so many, and how much.

        Each must add at least a share of the gain.
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
            if gain < max(2 * NATS_PER_DEGREE, least * (gained + gain)):
                break
            chosen, gained = [*chosen, rows[best]], gained + gain
            # What the chosen column does of the others and of the error is taken out of them.
            taken = normal[best] / (normal[best, best] + ridge)
            pull, normal = pull - taken * pull[best], normal - np.outer(taken, normal[best])
        return gained, chosen


class PreparedFit(NamedTuple):
    """A fit that further columns come beside, and what their gains need of it."""

    fit: Fit
    information: Information
    """Of its own numbers."""
    pull: np.ndarray
    """(K,) their products with the error."""
    step: np.ndarray
    """(K,) change of its own numbers that brings the error nearest to zero: next to nothing at the fit's end."""

    def at(self, error: np.ndarray) -> Self:
        """The same fit with other innovations (U, 6)."""
        pull = products(self.fit.columns, error[None])[0]
        step = -self.information.solve(pull[:, None])[:, 0]
        return self._replace(fit=self.fit._replace(error=error), pull=pull, step=step)


def stand(fit: Fit) -> PreparedFit:
    """Prepare a fit for columns that come beside it."""
    return PreparedFit(fit, information(fit.columns), *np.zeros((2, 0))).at(fit.error)


def gains(prepared_fit: PreparedFit, columns: np.ndarray) -> Gains:
    """Prepare the gains of whitened columns (M, U, 6) beside a fit."""
    flat = columns.reshape(len(columns), -1)
    shared, taken, pull = _beside(prepared_fit, columns)
    return Gains(flat @ flat.T - shared @ taken, pull, taken)


def gain_of_each(prepared_fit: PreparedFit, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(M,) nats that every whitened column (M, U, 6) would gain by itself, and (M,) its coefficient."""
    shared, taken, pull = _beside(prepared_fit, columns)
    power = np.maximum(np.einsum("muk,muk->m", columns, columns) - (shared.T * taken).sum(0), 1e-12)
    return pull**2 / power / 2, -pull / power


def _beside(prepared_fit: PreparedFit, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What a fit itself does of columns (M, U, 6): products (M, K), coefficients (K, M), and the pull (M,) left."""
    shared = products(prepared_fit.fit.columns, columns)
    taken = prepared_fit.information.solve(shared.T)
    pull = columns.reshape(len(columns), -1) @ prepared_fit.fit.error.ravel() - taken.T @ prepared_fit.pull
    return shared, taken, pull
