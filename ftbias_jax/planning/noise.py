"""Noise that the filter would assume for a log of the planned motion."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ftbias_jax.filtering.params_for_log import max_likelihood_params
from ftbias_jax.filtering.pipeline import options_from_setup
from ftbias_jax.filtering.process_models import JOINT_MODELS
from ftbias_jax.model.params import JointNoise
from ftbias_jax.planning.climb import Noise
from ftbias_jax.planning.information import bias_shapes
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array, Sample

SETTLES = 500
"""Number of samples after which the joint filter's uncertainty has converged."""
LOOKED_AT = 4096
"""Maximum number of samples of the motion to which the joints' process noise is fitted."""


def noise_of(
    setup: Setup, q: Float[np.ndarray, "T n"], dq: Float[np.ndarray, "T n"], rate: float, grid_t: Array
) -> Noise:
    """Return the noise of the readings for a given motion of the joints.

    q (T, n) rad and dq (T, n) rad/s are free of noise and have ``rate`` samples a second, as the log will; grid_t (U,)
    s are the evenly spaced bins of the plan.
    """
    options, rng, joints = options_from_setup(setup), np.random.default_rng(0), setup.joints
    q, dq = (
        x[:LOOKED_AT] + std * rng.normal(size=x[:LOOKED_AT].shape)
        for x, std in ((q, joints.position_noise_std), (dq, joints.velocity_noise_std))
    )
    dt, nothing = (jnp.full(shape, value) for shape, value in (((len(q),), 1 / rate), ((len(q), 6), 0.0)))
    params = max_likelihood_params(setup, Sample(dt, jnp.asarray(q), jnp.asarray(dq), nothing), options)
    bias = params.bias
    return Noise(
        bias.wrench_variance,
        jnp.asarray(smoothed_covariance(params.joint, options.joint_model, 1 / rate)),
        bias.in_motion,
        jnp.maximum(1.0, rate * (grid_t[1] - grid_t[0])),
        bias_shapes(grid_t, np.asarray(bias.density), np.asarray(bias.prior_std)),
    )


def smoothed_covariance(noise: JointNoise, model: str, dt: float) -> Float[np.ndarray, "n 3 3"]:
    """(n, 3, 3) covariance of smoothed joint states, far from both ends of a log with steps of dt s.

    The states are position, velocity and acceleration; the model is a key of ``process_models.JOINT_MODELS``.
    """
    densities = np.asarray(noise.process_density, float)
    A, Q = (
        np.moveaxis(np.array([[np.broadcast_to(x, densities.shape) for x in row] for row in rows], float), 2, 0)
        for rows in JOINT_MODELS[model](jnp.asarray(dt), jnp.asarray(densities))
    )
    H = np.eye(3)[:2]
    R = np.stack([np.diag(x) for x in np.stack([noise.position_std, noise.velocity_std], 1) ** 2])
    P, At = np.diag(np.asarray(noise.prior_std, float) ** 2) + np.zeros_like(A), A.transpose(0, 2, 1)
    for _ in range(SETTLES):
        predicted = A @ P @ At + Q
        gain = predicted @ H.T @ np.linalg.inv(H @ predicted @ H.T + R)
        P = predicted - gain @ H @ predicted
    back = P @ At @ np.linalg.inv(predicted)
    smoothed = P
    for _ in range(SETTLES):
        smoothed = P + back @ (smoothed - predicted) @ back.transpose(0, 2, 1)
    return smoothed
