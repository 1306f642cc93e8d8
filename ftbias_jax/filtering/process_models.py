"""The three joint process models of the report, and the bias model: dt -> transition A and process noise Q.

The dt of a step is the time since the previous sample, and both A and Q use it (errata 7). dt = 0 gives A = I, Q = 0.

Each model is written once, as nested rows of entries: the textbook filter stacks them into matrices, the fast routes
(scan.py) keep the entries apart.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import jax.numpy as jnp
from jax import Array

if TYPE_CHECKING:
    from jaxtyping import Float


Rows = list[list[Array]]
"""A small matrix as nested lists of entries, arrays of any common shape."""
ProcessModel = Callable[[Array, Array], tuple[Rows, Rows]]
"""(dt, density) -> rows of A and rows of Q."""


def acceleration_noise(dt: Float[Array, " ..."], density: Float[Array, " ..."]) -> tuple[Rows, Rows]:
    """Model 1, non-integrated acceleration noise (Kubus et al. 2007), as printed: A without dt^2/2, constant Q.

    Q does not scale with dt, so results depend on the sampling rate (errata 14); it is kept for comparison.

    Args:
        dt: () s.
        density: () rad/s^2, standard deviation that the acceleration gains at every step.

    Returns:
        A and Q (3 x 3) for the state (position, velocity, acceleration).
    """
    one, zero = jnp.ones_like(dt), jnp.zeros_like(dt)
    variance = jnp.where(dt > 0, density**2, 0)  # the first sample is a correction without a prediction
    noise = [[zero, zero, zero], [zero, zero, zero], [zero, zero, variance]]
    return [[one, dt, zero], [zero, one, dt], [zero, zero, one]], noise


def integrated_acceleration_noise(dt: Float[Array, " ..."], density: Float[Array, " ..."]) -> tuple[Rows, Rows]:
    """Model 2, integrated acceleration noise, as printed: the noise enters the velocity, the acceleration gets none.

    The gain of the acceleration therefore decays to nothing (errata 14); it is kept for comparison.

    Args:
        dt: () s.
        density: () rad/s^1.5, square root of the spectral density.
    """
    zero = jnp.zeros_like(dt)
    (pp, pv), (_, vv) = drift_noise(dt, density)[1]
    return _constant_acceleration(dt), [[pp, pv, zero], [pv, vv, zero], [zero, zero, zero]]


def integrated_jerk_noise(dt: Float[Array, " ..."], density: Float[Array, " ..."]) -> tuple[Rows, Rows]:
    """Model 3, integrated jerk noise: white noise on the jerk, integrated three times (Barfoot 2024). The default.

    Args:
        dt: () s.
        density: () rad/s^2.5, square root of the spectral density.
    """
    variance = density**2
    pp, pv, pa = dt**5 / 20 * variance, dt**4 / 8 * variance, dt**3 / 6 * variance
    vv, va, aa = dt**3 / 3 * variance, dt**2 / 2 * variance, dt * variance
    return _constant_acceleration(dt), [[pp, pv, pa], [pv, vv, va], [pa, va, aa]]


def drift_noise(dt: Float[Array, " ..."], density: Float[Array, " ..."]) -> tuple[Rows, Rows]:
    """One axis of the bias: its rate is integrated white noise (report, eq. of Q_i in section 3).

    Args:
        dt: () s.
        density: () sigma_Q, N/s^1.5 or Nm/s^1.5.

    Returns:
        A and Q (2 x 2) for the state (bias, drift).
    """
    one, zero = jnp.ones_like(dt), jnp.zeros_like(dt)
    variance = density**2
    cross = dt**2 / 2 * variance
    return [[one, dt], [zero, one]], [[dt**3 / 3 * variance, cross], [cross, dt * variance]]


JOINT_MODELS: dict[str, ProcessModel] = {
    "acceleration": acceleration_noise,
    "integrated_acceleration": integrated_acceleration_noise,
    "integrated_jerk": integrated_jerk_noise,
}


def bias_drift_noise(
    dt: Float[Array, ""], density: Float[Array, " 6"]
) -> tuple[Float[Array, "12 12"], Float[Array, "12 12"]]:
    """The bias model of all six axes as the report writes it.

    Args:
        dt: () s.
        density: (6,) sigma_Q in N/s^1.5 and Nm/s^1.5, one per axis (errata 12).

    Returns:
        A (12, 12) and Q (12, 12) for the state (bias, drift).
    """
    transition, noise = drift_noise(jnp.broadcast_to(dt, density.shape), density)

    def block(rows: Rows) -> Array:
        return jnp.block([[jnp.diag(entry) for entry in row] for row in rows])

    return block(transition), block(noise)


def matrix(rows: Rows) -> Float[Array, "k k"]:
    """Stack rows of scalar entries into a matrix (k, k)."""
    return jnp.stack([jnp.stack(row) for row in rows])


def _constant_acceleration(dt: Array) -> Rows:
    one, zero = jnp.ones_like(dt), jnp.zeros_like(dt)
    return [[one, dt, dt**2 / 2], [zero, one, dt], [zero, zero, one]]
