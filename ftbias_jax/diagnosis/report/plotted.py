"""What the plots of a diagnosis show, as plain bundles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Curve(NamedTuple):
    """What was left of the reading against a term's drive, and what the term adds."""

    drive: np.ndarray
    """(B,) the quantity, at coarse means."""
    drive_name: str
    """With its unit."""
    left: np.ndarray
    """(B,) N or Nm, without the term."""
    fitted: np.ndarray
    """(B,) N or Nm, of the term."""
    left_name: str
    """With its unit."""


class Series(NamedTuple):
    """What the plots show, on a common coarse time axis."""

    t: np.ndarray
    """(B,) s."""
    before: np.ndarray
    """(B, 6) N, Nm, corrected wrench minus model without the causes."""
    after: np.ndarray
    """(B, 6) the same with the causes in the model."""
    noise: np.ndarray
    """(B, 6) N, Nm, standard deviation of these means by noise alone."""
    regressor: np.ndarray
    """(B,) the quantity the first cause acts through, such as its own predicted change of the wrench."""
    regressor_name: str
    refitted: np.ndarray | None = None
    """(B, 6) N, Nm, corrected wrench minus model without the causes, with the bias that the model with them leaves; the
    bias filter follows a part of a slow gap, which ``before`` then lacks. None = not known."""

    @property
    def whole(self) -> np.ndarray:
        """(B, 6) N, Nm, what the causes must explain: with the bias refitted where that is known."""
        return self.before if self.refitted is None else self.refitted
