"""Bundles of plain arrays that several modules share.

Everything here is a NamedTuple of arrays, so JAX treats it as a pytree: it can be mapped, scanned and differentiated.
Nothing here computes, and nothing here imports JAX.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from jaxtyping import Float

Array = Any
"""A numpy or a JAX array: bundles hold either. What computes says ``jax.Array``, and annotations state shapes."""

AXES = ("fx", "fy", "fz", "tx", "ty", "tz")
"""Of a wrench: N, N, N, Nm, Nm, Nm."""


class Log(NamedTuple):
    """One recorded log on one merged timeline; NaN = not measured at that time.

    The wrench has the sign of the report: what the sensor exerts on the tool (at rest, z up, it reads +m g in z).
    """

    t: Float[Array, " T"]
    """(T,) s, increasing, relative to the first sample."""
    q: Float[Array, "T n"]
    """(T, n) rad (m for prismatic joints), in the order of the setup's joints."""
    dq: Float[Array, "T n"]
    """(T, n) rad/s (m/s)."""
    wrench: Float[Array, "T 6"]
    """(T, 6) N and Nm: force, then torque about the sensor origin, sensor frame."""
    temperature: Float[Array, " T"]
    """(T,) deg C."""
    start: float = 0.0
    """s, the log's own stamp of the first sample: t + start are the stamps as recorded."""


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


class Gaussian(NamedTuple):
    """A normal distribution: the state of a Kalman filter."""

    mean: Float[Array, "... k"]
    """(..., k)."""
    covariance: Float[Array, "... k k"]
    """(..., k, k), symmetric positive definite."""
