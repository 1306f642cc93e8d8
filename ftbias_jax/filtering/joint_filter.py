"""Kalman filter for position, velocity and acceleration of every joint; the joints are independent and vectorised."""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from ftbias_jax.filtering import gaussian
from ftbias_jax.filtering.gaussian import Innovation
from ftbias_jax.filtering.process_models import JOINT_MODELS, matrix
from ftbias_jax.model.params import JointNoise
from ftbias_jax.types import Gaussian


def init(noise: JointNoise, q: Float[Array, " n"]) -> Gaussian:
    """State before the first sample: (first measured position, 0, 0) with covariance P_0; q (n,) rad, NaN = unknown."""
    position = jnp.where(jnp.isfinite(q), q, 0)
    mean = jnp.stack([position, jnp.zeros_like(position), jnp.zeros_like(position)], -1)
    return Gaussian(mean, jnp.broadcast_to(jnp.diag(noise.prior_std**2), (*q.shape, 3, 3)))


def step(
    noise: JointNoise,
    state: Gaussian,
    dt: Float[Array, ""],
    q: Float[Array, " n"],
    dq: Float[Array, " n"],
    model: str = "integrated_jerk",
) -> tuple[Gaussian, Innovation]:
    """Predict by dt, then correct by the measured positions and velocities.

    Args:
        noise: noise model of the joint filter.
        state: mean (n, 3), covariance (n, 3, 3).
        dt: () s since the previous sample.
        q: (n,) rad, NaN = not measured.
        dq: (n,) rad/s, NaN = not measured.
        model: key of process_models.JOINT_MODELS.

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


@jax.jit
def first_measured(q: Float[Array, "T n"]) -> Float[Array, " n"]:
    """First finite position of every joint; (T, n) -> (n,) rad, NaN if there is none."""
    rows = jnp.arange(len(q), dtype=jnp.int32)[:, None]
    first = jnp.where(jnp.isfinite(q), rows, len(q) - 1).min(0)  # takes a third of the time of argmax
    return jnp.take_along_axis(q, first[None], 0)[0]


def _forget(predicted: Gaussian, previous: Gaussian, prior_std: Array) -> Gaussian:
    """Restart from P_0 where a gap has left position and velocity less certain than P_0.

    Integrated noise grows as dt^5: after seconds without data it would exceed any physical motion, and the next update
    would have to cancel twenty digits. The restart assumes the last known position, at rest.
    """
    lost = (jnp.diagonal(predicted.covariance)[:2] > prior_std[:2] ** 2).all()
    at_rest = previous.mean * jnp.array([1, 0, 0], dtype=previous.mean.dtype)
    return Gaussian(
        jnp.where(lost, at_rest, predicted.mean), jnp.where(lost, jnp.diag(prior_std**2), predicted.covariance)
    )
