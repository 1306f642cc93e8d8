"""Kalman filter for position, velocity and acceleration of every joint; the joints are independent and vectorised."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp

from ftbias_jax import gaussian
from ftbias_jax.gaussian import Innovation
from ftbias_jax.noise import JOINT_MODELS, matrix
from ftbias_jax.recursion import Inputs, filter_scan
from ftbias_jax.types import Array, Gaussian


class JointNoise(NamedTuple):
    """Noise of the joint filter."""

    process_density: Array
    """(n,) strength of the process noise, units of the chosen model in noise.py (rad/s^2.5 for integrated jerk)."""
    position_std: Array
    """(n,) eta_q, rad."""
    velocity_std: Array
    """(n,) eta_dq, rad/s."""
    prior_std: Array
    """(3,) rad, rad/s, rad/s^2: square root of P_0; wide enough for a log that starts in motion (errata 15)."""


def init(noise: JointNoise, q: Array) -> Gaussian:
    """State before the first sample: (first measured position, 0, 0) with covariance P_0; q (n,), NaN = unknown."""
    position = jnp.where(jnp.isfinite(q), q, 0)
    mean = jnp.stack([position, jnp.zeros_like(position), jnp.zeros_like(position)], -1)
    return Gaussian(mean, jnp.broadcast_to(jnp.diag(noise.prior_std**2), (*q.shape, 3, 3)))


def step(
    noise: JointNoise, state: Gaussian, dt: Array, q: Array, dq: Array, model: str = "integrated_jerk"
) -> tuple[Gaussian, Innovation]:
    """Predict by dt, then correct by the measured positions and velocities.

    Args:
        noise: of the filter. state: mean (n, 3), covariance (n, 3, 3).
        dt: () s since the previous sample. q, dq: (n,) rad and rad/s, NaN = not measured.
        model: key of noise.JOINT_MODELS.

    Returns:
        the corrected state and the innovation of (q, dq), each entry with a leading joint axis.
    """

    def one_joint(
        state: Gaussian, density: Array, position_std: Array, velocity_std: Array, q: Array, dq: Array
    ) -> tuple[Gaussian, Innovation]:
        transition, process_noise = JOINT_MODELS[model](dt, density)
        predicted = gaussian.predict(state, matrix(transition), matrix(process_noise))
        predicted = _forget(predicted, state, noise.prior_std)
        observation = jnp.eye(2, 3, dtype=state.mean.dtype)
        measurement_noise = jnp.diag(jnp.stack([position_std, velocity_std]) ** 2)
        return gaussian.update(predicted, jnp.stack([q, dq]), observation, measurement_noise)

    return jax.vmap(one_joint)(state, noise.process_density, noise.position_std, noise.velocity_std, q, dq)


@partial(jax.jit, static_argnames="model")
def likeliest_density(noise: JointNoise, dt: Array, q: Array, dq: Array, model: str = "integrated_jerk") -> Array:
    """Process noise density of every joint that makes its measurements likeliest: (n,), noise.process_density unused.

    How fast a robot's acceleration changes differs by orders of magnitude between motions, and nobody knows the
    number. The likelihood of one joint has a single broad maximum: a grid of factor four is searched, then a fine one
    between the neighbours of its best point, refined by a parabola through the best three points.

    Args:
        noise: measurement noise and prior. dt: (T,) s. q, dq: (T, n). model: key of noise.JOINT_MODELS.
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
    start = init(noise, first_measured(q))
    y = jnp.stack([q, dq], 1)
    variance = jnp.broadcast_to((jnp.stack([noise.position_std, noise.velocity_std]) ** 2)[None], y.shape)
    restart = jnp.broadcast_to((noise.prior_std**2)[:, None], start.mean.T.shape)
    joints = (y, variance, start.mean.T, jnp.moveaxis(start.covariance, 0, -1), restart)
    lanes = (jnp.concatenate([x] * len(densities), -1) for x in joints)
    track = filter_scan(JOINT_MODELS[model], Inputs(dt, densities.reshape(-1), *lanes))
    return track.log_likelihood.sum(0).reshape(densities.shape)


@jax.jit
def first_measured(q: Array) -> Array:
    """First finite position of every joint; (T, n) -> (n,), NaN if there is none."""
    first = jnp.argmax(jnp.isfinite(q), 0)
    return jnp.take_along_axis(q, first[None], 0)[0]


def _forget(predicted: Gaussian, previous: Gaussian, prior_std: Array) -> Gaussian:
    """Start again from P_0 when a gap has left less knowledge of position and velocity than P_0 has.

    Integrated noise grows as dt^5: after seconds without data it would exceed any physical motion, and the next update
    would have to cancel twenty digits. The restart assumes the last known position, at rest.
    """
    lost = (jnp.diagonal(predicted.covariance)[:2] > prior_std[:2] ** 2).all()
    at_rest = previous.mean * jnp.array([1, 0, 0], dtype=previous.mean.dtype)
    return Gaussian(
        jnp.where(lost, at_rest, predicted.mean),
        jnp.where(lost, jnp.diag(prior_std**2), predicted.covariance),
    )
