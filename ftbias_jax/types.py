"""Bundles of plain arrays that several modules share.

Everything here is a NamedTuple of arrays, so JAX treats it as a pytree: it can be mapped, scanned and differentiated.
Nothing here computes, and nothing here imports JAX.
"""

from __future__ import annotations

from typing import Any, NamedTuple

Array = Any  # a numpy or jax array; the functions' docstrings state shapes, units and frames

AXES = ("fx", "fy", "fz", "tx", "ty", "tz")
"""Of a wrench: N, N, N, Nm, Nm, Nm."""


class Log(NamedTuple):
    """One recorded log on one merged timeline; NaN = not measured at that time.

    The wrench has the sign of the report: what the sensor exerts on the tool (at rest, z up, it reads +m g in z).
    """

    t: Array
    """(T,) s, increasing, relative to the first sample."""
    q: Array
    """(T, n) rad (m for prismatic joints), in the order of the setup's joints."""
    dq: Array
    """(T, n) rad/s (m/s)."""
    wrench: Array
    """(T, 6) N and Nm: force, then torque about the sensor origin, sensor frame."""
    temperature: Array
    """(T,) deg C."""
    start: float = 0.0
    """s, the log's own stamp of the first sample: t + start are the stamps as recorded."""


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
