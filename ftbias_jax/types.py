"""Bundles of plain arrays that several modules share.

Everything here is a NamedTuple of arrays, so JAX treats it as a pytree: it can be mapped, scanned and differentiated.
Nothing here computes, and nothing here imports JAX.
"""

from typing import Any, NamedTuple

from jaxtyping import Float

Array = Any
"""A numpy or a JAX array: bundles hold either. Code that computes states ``jax.Array``; annotations give the shapes."""

AXES = ("fx", "fy", "fz", "tx", "ty", "tz")
"""Axes of a wrench: three forces, then three torques."""
AXIS_UNITS = ("N", "N", "N", "Nm", "Nm", "Nm")
"""Unit of each axis of a wrench."""


class Sample(NamedTuple):
    """Measurements for one filter step; a whole log is the same bundle with a leading time axis. NaN = not measured."""

    dt: Float[Array, " ..."]
    """s since the previous sample; 0 for the first, which is then a correction without a prediction."""
    q: Float[Array, "... n"]
    """(n,) rad: joint positions, or the entries of a recorded pose."""
    dq: Float[Array, "... n"]
    """(n,) rad/s: rates of ``q``."""
    wrench: Float[Array, "... 6"]
    """(6,) N, Nm: measured wrench on the tool, sensor frame."""
    temperature: Float[Array, " ..."] | None = None
    """deg C, for effects that depend on it; without gaps. None = not recorded."""
    columns: Any = None
    """Further quantities that effects may depend on: name -> array, without gaps. None = none are named."""
    rezeroed: Float[Array, " ..."] | None = None
    """1 where the sensor was tared (set to zero) since the previous sample, else 0. None = it never was."""


class Gaussian(NamedTuple):
    """A normal distribution: the state of a Kalman filter."""

    mean: Float[Array, "... k"]
    """(..., k)."""
    covariance: Float[Array, "... k k"]
    """(..., k, k), symmetric positive definite."""
