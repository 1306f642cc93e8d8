"""The variances Sigma_D of the data matrix from four physical standard deviations.

Each live entry of D is a sum of independent parts (``tool_wrench.data_matrix``): a - g, an angular acceleration,
products of two rates. The variances of parts add up. For rates the variances are those at rest: omega_i omega_j of two
independent rates of standard deviations sigma_i and sigma_j has sigma_i sigma_j, a square sqrt(2) sigma_i^2.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp

from ftbias_jax.model.wrench.tool_wrench import LIVE_ENTRIES, vec
from ftbias_jax.types import Array


class DataNoise(NamedTuple):
    """Standard deviations of the sensor's motion; each (3,), sensor axes."""

    linear_acceleration: Array
    """m/s^2."""
    angular_acceleration: Array
    """rad/s^2."""
    angular_velocity: Array
    """rad/s."""
    gravity_direction: Array
    """rad."""


def data_variance(noise: DataNoise, gravity: Array) -> Array:
    """Diagonal (36,) of Sigma_D over the live entries of vec(D) (``tool_wrench.LIVE_ENTRIES``); gravity in m/s^2."""
    x, y, z = noise.linear_acceleration**2 + (gravity @ gravity) * noise.gravity_direction**2
    ax, ay, az = noise.angular_acceleration**2
    rate = noise.angular_velocity**2
    xx, yy, zz = 2 * rate**2
    xy, xz, yz = rate[0] * rate[1], rate[0] * rate[2], rate[1] * rate[2]
    zero = jnp.zeros_like(x)
    rows = [
        [x, yy + zz, xy + az, xz + ay, *[zero] * 6],
        [y, xy + az, xx + zz, yz + ax, *[zero] * 6],
        [z, xz + ay, yz + ax, xx + yy, *[zero] * 6],
        [zero, zero, z, y, ax, ay + xz, az + xy, yz, yy + zz, yz],
        [zero, z, zero, x, xz, ax + yz, zz + xx, ay, az + xy, xz],
        [zero, y, x, zero, xy, xx + yy, ax + yz, xy, ay + xz, az],
    ]
    return vec(jnp.stack([jnp.stack(row) for row in rows]))[LIVE_ENTRIES]
