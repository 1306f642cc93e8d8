"""Bundles of plain arrays that several modules share.

Everything here is a NamedTuple of arrays, so JAX treats it as a pytree: it can be mapped, scanned and differentiated.
Nothing here computes, and nothing here imports JAX.
"""

from __future__ import annotations

from typing import Any, NamedTuple

Array = Any  # a numpy or jax array; the functions' docstrings state shapes, units and frames

AXES = ("fx", "fy", "fz", "tx", "ty", "tz")
"""Of a wrench: N, N, N, Nm, Nm, Nm."""


class Sample(NamedTuple):
    """What one filter step sees; a whole log is the same bundle with a leading time axis. NaN = not measured."""

    dt: Array
    """() s since the previous sample; 0 for the first, which is then a correction without a prediction."""
    q: Array
    """(n,) rad."""
    dq: Array
    """(n,) rad/s."""
    wrench: Array
    """(6,) N, Nm, sensor frame, wrench on the tool."""
    temperature: Array | None = None
    """() deg C, for effects that follow it; without gaps. None = not recorded."""


class Gaussian(NamedTuple):
    """A normal distribution: the state of a Kalman filter."""

    mean: Array
    """(..., k)."""
    covariance: Array
    """(..., k, k), symmetric positive definite."""
