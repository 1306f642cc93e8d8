"""Bundles of plain arrays that several modules share.

Everything here is a NamedTuple of arrays, so JAX treats it as a pytree: it can be mapped, scanned and differentiated.
Nothing here computes, and nothing here imports JAX.
"""

from typing import Any, NamedTuple

from jaxtyping import Float

Array = Any
"""A numpy or a JAX array: bundles hold either. What computes says ``jax.Array``, and annotations state shapes."""

AXES = ("fx", "fy", "fz", "tx", "ty", "tz")
"""Of a wrench."""
AXIS_UNITS = ("N", "N", "N", "Nm", "Nm", "Nm")
"""Of each of its axes."""


class Sample(NamedTuple):
    """What one filter step sees; a whole log is the same bundle with a leading time axis. NaN = not measured."""

    dt: Float[Array, " ..."]
    """s since the previous sample; 0 for the first, which is then a correction without a prediction."""
    q: Float[Array, "... n"]
    """(n,) rad."""
    dq: Float[Array, "... n"]
    """(n,) rad/s."""
    wrench: Float[Array, "... 6"]
    """(6,) N, Nm, sensor frame, wrench on the tool."""
    temperature: Float[Array, " ..."] | None = None
    """deg C, for effects that follow it; without gaps. None = not recorded."""
    columns: Any = None
    """Further quantities for effects to see: name -> array, without gaps. None = none are named."""
    rezeroed: Float[Array, " ..."] | None = None
    """1 where the sensor was set to zero since the previous sample, else 0. None = it never was."""


class Gaussian(NamedTuple):
    """A normal distribution: the state of a Kalman filter."""

    mean: Float[Array, "... k"]
    """(..., k)."""
    covariance: Float[Array, "... k k"]
    """(..., k, k), symmetric positive definite."""
