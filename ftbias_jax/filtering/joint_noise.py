"""The joints' process noise that makes a recorded motion most likely."""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
from jax import Array

from ftbias_jax.filtering.fast.scan import Inputs
from ftbias_jax.filtering.fast.sums import filter_sums
from ftbias_jax.filtering.joint_filter import first_measured, init
from ftbias_jax.filtering.process_models import JOINT_MODELS
from ftbias_jax.model.params import JointNoise
from ftbias_jax.runtime.kept_programs import keep_program
from ftbias_jax.runtime.pieces import over_pieces

if TYPE_CHECKING:
    from jaxtyping import Float


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


Summed = tuple[Array, Array, Array]
"""nats so far, and mean and covariance of the filters."""


def _score_densities(noise: JointNoise, dt: Array, q: Array, dq: Array, densities: Array, model: str) -> Array:
    """Log-likelihood (G, n) of each joint's measurements for each density of its grid (G, n), all in one recursion."""
    start, T = init(noise, first_measured(q)), len(dt)
    variance = jnp.stack([noise.position_std, noise.velocity_std]) ** 2
    restart = jnp.broadcast_to((noise.prior_std**2)[:, None], start.mean.T.shape)

    def lanes(x: Array) -> Array:
        return jnp.concatenate([x] * len(densities), -1)

    def add_piece(state: Summed, piece: tuple[Array, Array]) -> tuple[Summed, None]:
        dt, y = piece
        spread = jnp.broadcast_to(variance[None], y.shape)
        inputs = Inputs(dt, densities.reshape(-1), lanes(y), lanes(spread), *state[1:], lanes(restart))
        found = filter_sums(JOINT_MODELS[model], False, inputs, jnp.ones_like(dt))
        return (state[0] + found.nats, found.mean, found.covariance), None

    begin = jnp.zeros_like(densities).reshape(-1), *map(lanes, (start.mean.T, jnp.moveaxis(start.covariance, 0, -1)))
    y = jnp.stack([q, dq], 1)
    of_log = (dt != 0) | jnp.isfinite(y).any((1, 2))
    length = jnp.max(jnp.where(of_log, jnp.arange(1, T + 1), 0))
    nats: Array = over_pieces(add_piece, begin, (dt, y), length)[0][0]
    return nats.reshape(densities.shape)
