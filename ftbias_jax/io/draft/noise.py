"""How noisy a sensor is, from the quietest second of a log."""

from __future__ import annotations

import numpy as np

from ftbias_jax.types import Array

QUIET = 1.0
"""s, length of the stretch that is looked for."""
FEWEST = 20
"""Samples that a stretch must have."""
TO_STD = 1.4826 / np.sqrt(6.0)
"""Median size of the second differences of white noise -> its standard deviation."""


def quietest_noise(t: Array, wrench: Array) -> list[float] | None:
    """(6,) N, Nm: standard deviation of one sample where the log is quietest, rounded to two digits.

    Second differences are blind to a bias, a drift and a slow motion.

    Args:
        t: (T,) s.
        wrench: (T, 6) N, Nm; NaN = not measured.

    Returns:
        None if there are too few samples, or an axis never changes.
    """
    rows = np.isfinite(wrench).all(1)
    t, wrench = t[rows], wrench[rows]
    moved = np.flatnonzero(np.any(wrench[1:] != wrench[:-1], axis=1)) + 1  # rows that only repeat the one before
    t, wrench = t[moved], wrench[moved]
    if len(t) < FEWEST:
        return None
    second = np.abs(wrench[2:] - 2 * wrench[1:-1] + wrench[:-2])
    stretches = np.floor((t[1:-1] - t[0]) / QUIET).astype(int)
    found = [second[stretches == k] for k in np.unique(stretches)]
    medians = np.array([np.median(part, 0) for part in found if len(part) >= FEWEST] or [np.median(second, 0)])
    quietest = medians[np.argmin((medians / np.median(medians, 0).clip(1e-300)).sum(1))] * TO_STD
    if not (quietest > 0).all():
        return None
    return [float(f"{std:.2g}") for std in quietest]
