"""Stamps that scatter about a steady clock: of a computer that was busy when the sample arrived."""

from __future__ import annotations

import numpy as np

from ftbias_jax.types import Array

TOLD = 0.1
"""Standard deviation in median intervals from which on jitter is told; a good recorder stays below a hundredth."""
_NORMAL = 1.4826
"""Standard deviation of a normal distribution in median absolute deviations."""


def jitter(t: Array) -> float:
    """Standard deviation in s by which (T,) stamps in s are off a steady clock; 0 if that is no matter.

    The interval between two stamps has the errors of both. By the median, so that gaps count for nothing.
    """
    intervals = np.diff(t)
    if len(intervals) < 10:
        return 0.0
    middle = float(np.median(intervals))
    std = _NORMAL * float(np.median(np.abs(intervals - middle))) / np.sqrt(2)
    return std if std > TOLD * middle else 0.0
