"""The joints' process noise that makes a recorded motion most likely."""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
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
POINTS, PARTS = 8, 64
"""Of each grid, and of the interval between two points of the fine one: 1 % of the density."""


@keep_program("model")
def likeliest_density(
    noise: JointNoise,
    dt: Float[Array, " T"],
    q: Float[Array, "T n"],
    dq: Float[Array, "T n"],
    *,
    model: str = "integrated_jerk",
) -> Float[Array, " n"]:
    """Process noise density of every joint that makes its measurements likeliest; noise.process_density is not used.

    How fast a robot's acceleration changes differs by orders of magnitude between motions, and nobody knows the
    number. The likelihood of one joint has a single broad maximum: a coarse grid is searched, then a fine one between
    the neighbours of its best point, and the polynomial through the fine one's points.
    """
    grid, fine = jnp.linspace(-8, 12, POINTS, dtype=q.dtype), jnp.linspace(-1, 1, POINTS, dtype=q.dtype)
    fine = fine[:, None] * (grid[1] - grid[0])
    densities = 2 ** jnp.broadcast_to(grid[:, None], (POINTS, q.shape[1]))
    score = _score_densities(noise, dt, q, dq, densities, model)
    middle = grid[jnp.argmax(score, 0)]
    score = _score_densities(noise, dt, q, dq, 2 ** (middle[None] + fine), model)
    best = jnp.argmax(score, 0)
    between = np.linspace(-1, 1, (POINTS - 1) * PARTS + 1)
    weights = np.vander(between, POINTS) @ np.linalg.inv(np.vander(np.linspace(-1, 1, POINTS)))
    far = jnp.abs(jnp.arange(len(between))[:, None] - PARTS * best[None]) > PARTS
    curve = jnp.matmul(jnp.asarray(weights, q.dtype), score - score.max(0)[None], precision="highest")
    place = jnp.asarray(between, q.dtype)[jnp.argmax(jnp.where(far, -jnp.inf, curve), 0)]
    return 2 ** (middle + place * (grid[1] - grid[0]))


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
