"""Parametric motions: a finite Fourier series per joint, faded in and out so that it starts and ends at rest.

Positions, velocities, accelerations and jerks are linear in the coefficients, and exact at any time.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ftbias_jax.planning.limits import Limits, joint_shares
from ftbias_jax.types import Array

FADE = 1.5
"""s in which the series is faded in, and out again; a quarter of the duration if that is shorter."""
MOST_HARMONICS = 64
SHARPNESS = 40.0
"""Exponent of the norm that replaces the largest share: it exceeds it by about a twentieth and is differentiable."""

ROWS = 8192
"""Number of times at which a motion is evaluated together."""


class Grid(NamedTuple):
    """Times, and all basis functions with their derivatives there."""

    t: Float[Array, " U"]
    """(U,) s."""
    basis: Float[Array, "4 U M"]
    """(4, U, M) the functions and their first three derivatives, 1/s^k."""


def harmonics_for(limits: Limits, duration: float) -> int:
    """Number of harmonics of 1/duration: up to three times the highest frequency at which a joint reaches its limits of
    speed and of acceleration together."""
    corner = float(np.max(np.asarray(limits.acceleration) / np.asarray(limits.velocity))) / (2 * np.pi)
    return int(np.clip(np.ceil(3 * corner * duration), 4, MOST_HARMONICS))


def grid(t: Float[np.ndarray, " U"], duration: float, harmonics: int) -> Grid:
    """The basis at times t (U,) s: a constant, cosines and sines of multiples of 1/duration, times the fade.

    The fade is 35 s^4 - 84 s^5 + 70 s^6 - 20 s^7, whose first three derivatives vanish at both ends: so does the jerk.
    """
    t = np.clip(np.asarray(t, float), 0.0, duration)
    fade = min(FADE, duration / 4)
    s, sign = np.minimum(t, duration - t) / fade, np.where(t < duration / 2, 1.0, -1.0)
    inside, s = s < 1, np.minimum(s, 1.0)
    window = [
        s**4 * (35 - 84 * s + 70 * s**2 - 20 * s**3),
        sign * inside * 140 * s**3 * (1 - s) ** 3 / fade,
        inside * 420 * s**2 * (1 - s) ** 2 * (1 - 2 * s) / fade**2,
        sign * inside * 840 * s * (1 - s) * (1 - 5 * s + 5 * s**2) / fade**3,
    ]
    speed = 2 * np.pi / duration * np.arange(1, harmonics + 1)
    angle = np.outer(t, speed)
    cos, sin, zero = np.cos(angle), np.sin(angle), np.zeros((len(t), 1))
    waves = [
        np.concatenate(parts, 1)
        for parts in (
            (zero + 1, cos, sin),
            (zero, -speed * sin, speed * cos),
            (zero, -(speed**2) * cos, -(speed**2) * sin),
            (zero, speed**3 * sin, -(speed**3) * cos),
        )
    ]
    binomials = ((1,), (1, 1), (1, 2, 1), (1, 3, 3, 1))
    product = [
        sum(b * window[k][:, None] * waves[order - k] for k, b in enumerate(row)) for order, row in enumerate(binomials)
    ]
    return Grid(t, np.stack(product))


def motion(points: Grid, coefficients: Float[Array, "n M"]) -> Float[Array, "4 U n"]:
    """Positions relative to the first pose, and their three derivatives: (4, U, n) rad/s^k."""
    return jnp.einsum("dum,nm->dun", jnp.asarray(points.basis), coefficients)


def within(
    points: Grid, limits: Limits, start: Float[Array, " n"], free: Float[Array, "n M"]
) -> tuple[Float[Array, "n M"], Float[Array, "4 U n"]]:
    """Map any numbers (n, M) to coefficients of a motion within the joints' limits; also return that motion.

    A joint that would exceed a limit is scaled down as a whole; its motion is linear in its coefficients.
    """
    moved = motion(points, free)
    shares = joint_shares(limits, start, moved)
    largest = jnp.maximum(shares.max((0, 1)), 1e-9)
    norm = largest * ((shares / largest[None, None]) ** SHARPNESS).sum((0, 1)) ** (1 / SHARPNESS)
    scale = 1 / jnp.maximum(norm, 1.0)
    return free * scale[:, None], moved * scale[None, None]


class Motion(NamedTuple):
    """A planned motion of n joints, without noise."""

    t: Float[np.ndarray, " T"]
    """(T,) s."""
    q: Float[np.ndarray, "T n"]
    """(T, n) rad (m)."""
    dq: Float[np.ndarray, "T n"]
    ddq: Float[np.ndarray, "T n"]
    jerk: Float[np.ndarray, "T n"]


def motion_at(t: Float[np.ndarray, " T"], duration: float, start: np.ndarray, coefficients: np.ndarray) -> Motion:
    """Evaluate the motion with these coefficients (n, M) at times t (T,) s, in pieces that fit into memory."""
    harmonics = (coefficients.shape[1] - 1) // 2
    pieces = [t[first : first + ROWS] for first in range(0, len(t), ROWS)]
    moved = [np.einsum("dum,nm->dun", grid(piece, duration, harmonics).basis, coefficients) for piece in pieces]
    q, dq, ddq, jerk = np.concatenate(moved, 1)
    return Motion(t, start + q, dq, ddq, jerk)


def random_shapes(key: int, count: int, joints: int, harmonics: int) -> Float[np.ndarray, "count n M"]:
    """Random numbers (count, n, M) to start from: higher frequencies smaller, large enough to reach the limits."""
    rng = np.random.default_rng(key)
    order = np.arange(1, harmonics + 1)
    size = np.concatenate([[0.5], *[np.exp(-order / (0.3 * harmonics)) / np.sqrt(order)] * 2])
    return rng.normal(size=(count, joints, 2 * harmonics + 1)) * size
