"""How noisy a sensor is, from the quietest second of a log."""

from __future__ import annotations

import numpy as np

from ftbias_jax.types import Array

QUIET = 1.0
"""s, length of the stretches that are looked at."""
FEWEST = 20
"""Samples that a stretch must have."""
QUIETEST = 0.1
"""Share of the stretches that are quieter than the one that is believed."""


def quietest_noise(t: Array, wrench: Array) -> list[float] | None:
    """(6,) N, Nm: standard deviation of one sample where the log is quietest, rounded to two digits.

    Of every second a cubic is taken off, so that bias, drift and slow motion do not count, but noise that a filter
    in the sensor has made smooth does.

    Args:
        t: (T,) s.
        wrench: (T, 6) N, Nm; NaN = not measured.

    Returns:
        None if there are too few samples, or an axis never changes.
    """
    rows = np.isfinite(wrench).all(1)
    t, wrench = t[rows], wrench[rows]
    if len(t) < FEWEST:
        return None
    stretch = np.floor((t - t[0]) / QUIET).astype(int)
    parts = [stretch == k for k in np.unique(stretch)]
    stds = [_about_cubic(t[part], wrench[part]) for part in parts if part.sum() >= FEWEST]
    quiet = np.quantile(np.array(stds or [_about_cubic(t, wrench)]), QUIETEST, axis=0)
    if not (quiet > 0).all():
        return None
    return [float(f"{std:.2g}") for std in quiet]


def _about_cubic(t: Array, wrench: Array) -> Array:
    """(6,) standard deviation of what a cubic of time leaves."""
    columns = np.vander((t - t[0]) / max(np.ptp(t), 1e-9), 4)
    left = wrench - columns @ np.linalg.lstsq(columns, wrench, rcond=None)[0]
    std: Array = np.sqrt((left**2).sum(0) / (len(t) - 4))
    return std
