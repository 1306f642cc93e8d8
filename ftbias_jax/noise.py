"""The three joint process models of the report, and the bias model: dt -> transition A and process noise Q.

The dt of a step is the time since the previous sample, and both A and Q use it (errata 7). dt = 0 gives A = I, Q = 0.
"""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp

from ftbias_jax.types import Array


def acceleration_noise(dt: Array, density: Array) -> tuple[Array, Array]:
    """Model 1, non-integrated acceleration noise (Kubus et al. 2007), as printed: A without dt^2/2, constant Q.

    Q does not scale with dt, so results depend on the sampling rate (errata 14); it is kept for comparison.

    Args:
        dt: () s. density: () rad/s^2, standard deviation that the acceleration gains at every step.

    Returns:
        A (3, 3) and Q (3, 3) for the state (position, velocity, acceleration).
    """
    one, zero = jnp.ones_like(dt), jnp.zeros_like(dt)
    transition = _matrix([[one, dt, zero], [zero, one, dt], [zero, zero, one]])
    variance = jnp.where(dt > 0, density**2, 0)  # the first sample is a correction without a prediction
    return transition, _matrix([[zero, zero, zero], [zero, zero, zero], [zero, zero, variance]])


def integrated_acceleration_noise(dt: Array, density: Array) -> tuple[Array, Array]:
    """Model 2, integrated acceleration noise, as printed: the noise enters the velocity, the acceleration gets none.

    The gain of the acceleration therefore decays to nothing (errata 14); it is kept for comparison.

    Args:
        dt: () s. density: () rad/s^1.5, square root of the spectral density.
    """
    zero = jnp.zeros_like(dt)
    variance = density**2
    cross = dt**2 / 2 * variance
    noise = _matrix([[dt**3 / 3 * variance, cross, zero], [cross, dt * variance, zero], [zero, zero, zero]])
    return _constant_acceleration(dt), noise


def integrated_jerk_noise(dt: Array, density: Array) -> tuple[Array, Array]:
    """Model 3, integrated jerk noise: white noise on the jerk, integrated three times (Barfoot 2024). The default.

    Args:
        dt: () s. density: () rad/s^2.5, square root of the spectral density.
    """
    variance = density**2
    pa, va = dt**3 / 6 * variance, dt**2 / 2 * variance
    pv = dt**4 / 8 * variance
    noise = _matrix([[dt**5 / 20 * variance, pv, pa], [pv, dt**3 / 3 * variance, va], [pa, va, dt * variance]])
    return _constant_acceleration(dt), noise


JointModel = Callable[[Array, Array], tuple[Array, Array]]

JOINT_MODELS: dict[str, JointModel] = {
    "acceleration": acceleration_noise,
    "integrated_acceleration": integrated_acceleration_noise,
    "integrated_jerk": integrated_jerk_noise,
}


def bias_drift_noise(dt: Array, density: Array) -> tuple[Array, Array]:
    """Bias whose rate is integrated white noise (report, eq. of Q_i in section 3).

    Args:
        dt: () s. density: (6,) sigma_Q in N/s^1.5 and Nm/s^1.5, one per axis (errata 12).

    Returns:
        A (12, 12) and Q (12, 12) for the state (bias, drift).
    """
    eye = jnp.eye(6, dtype=density.dtype)
    spectrum = jnp.diag(density**2)
    transition = jnp.block([[eye, dt * eye], [jnp.zeros_like(eye), eye]])
    cross = dt**2 / 2 * spectrum
    noise = jnp.block([[dt**3 / 3 * spectrum, cross], [cross, dt * spectrum]])
    return transition, noise


def _constant_acceleration(dt: Array) -> Array:
    one, zero = jnp.ones_like(dt), jnp.zeros_like(dt)
    return _matrix([[one, dt, dt**2 / 2], [zero, one, dt], [zero, zero, one]])


def _matrix(rows: list[list[Array]]) -> Array:
    return jnp.stack([jnp.stack(row) for row in rows])
