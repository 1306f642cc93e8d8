"""The joints' process noise that makes a recorded motion most likely."""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
from jax import Array

from ftbias_jax.filtering.fast.scan import Inputs
from ftbias_jax.filtering.joint_filter import first_measured, init
from ftbias_jax.filtering.likelihood import measured_length, nats_in_pieces
from ftbias_jax.filtering.process_models import JOINT_MODELS
from ftbias_jax.model.params import JointNoise
from ftbias_jax.runtime.kept_programs import keep_program
from ftbias_jax.types import Sample

if TYPE_CHECKING:
    from jaxtyping import Float

MOST_SAMPLES = 1 << 14
"""At the start of a log that the noise is fitted to."""


@keep_program("model")
def likeliest_density(
    noise: JointNoise,
    dt: Float[Array, " T"],
    q: Float[Array, "T n"],
    dq: Float[Array, "T n"],
    *,
    model: str = "integrated_jerk",
) -> Float[Array, " n"]:
    """Process noise density of every joint that makes its measurements likeliest: (n,), noise.process_density unused.

    How fast a robot's acceleration changes differs by orders of magnitude between motions, and nobody knows the
    number. The likelihood of one joint has a single broad maximum: a grid of factor four is searched, then a fine one
    between the neighbours of its best point, refined by a parabola through the best three points.

    Args:
        noise: measurement noise and prior.
        dt: (T,) s.
        q: (T, n) rad, NaN = not measured.
        dq: (T, n) rad/s, NaN = not measured.
        model: key of process_models.JOINT_MODELS.
    """
    grid = jnp.linspace(-8, 12, 11, dtype=q.dtype)
    exponents = jnp.broadcast_to(grid[:, None], (11, q.shape[1]))
    best = jnp.argmax(_score_densities(noise, dt, q, dq, 2**exponents, model), 0)
    exponents = grid[best][None] + jnp.linspace(-2, 2, 11, dtype=q.dtype)[:, None]
    score = _score_densities(noise, dt, q, dq, 2**exponents, model)
    best = jnp.clip(jnp.argmax(score, 0), 1, 9)[None]
    low, middle, high = (jnp.take_along_axis(score, best + i, 0)[0] for i in (-1, 0, 1))
    curvature = low - 2 * middle + high
    shift = jnp.where(curvature < 0, (low - high) / (2 * jnp.where(curvature < 0, curvature, -1)), 0)
    spacing = exponents[1] - exponents[0]
    return 2 ** (jnp.take_along_axis(exponents, best, 0)[0] + spacing * jnp.clip(shift, -1, 1))


def _score_densities(noise: JointNoise, dt: Array, q: Array, dq: Array, densities: Array, model: str) -> Array:
    """Log-likelihood (G, n) of each joint's measurements for each density of its grid (G, n), all in one recursion."""
    start, y = init(noise, first_measured(q)), jnp.stack([q, dq], 1)
    variance = jnp.broadcast_to((jnp.stack([noise.position_std, noise.velocity_std]) ** 2)[None], y.shape)
    restart = jnp.broadcast_to((noise.prior_std**2)[:, None], start.mean.T.shape)
    joints = (y, variance, start.mean.T, jnp.moveaxis(start.covariance, 0, -1), restart)
    lanes = (jnp.concatenate([x] * len(densities), -1) for x in joints)
    inputs, nothing = Inputs(dt, densities.reshape(-1), *lanes), jnp.full((len(dt), 0), jnp.nan)
    length = measured_length(Sample(dt, q, dq, nothing))
    nats = nats_in_pieces(JOINT_MODELS[model], inputs, jnp.ones_like(dt), length)
    return nats.reshape(densities.shape)
