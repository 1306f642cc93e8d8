"""One Kalman step on plain arrays: predict and update. Missing measurements are NaN; shapes stay static."""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array
from jax.scipy.linalg import cho_solve
from jaxtyping import Float, Int

from ftbias_jax.types import Gaussian


class Innovation(NamedTuple):
    """Innovation of a measurement and its statistics; several innovations have leading axes: samples, joints."""

    value: Float[Array, "... m"]
    """(m,) measurement minus prediction; NaN where nothing was measured."""
    covariance: Float[Array, "... m m"]
    """(m, m) predicted covariance of the innovation, S = C P C^T + R."""
    nis: Float[Array, " ..."]
    """() normalised innovation squared of the measured entries; chi-square with ``count`` degrees of freedom."""
    log_likelihood: Float[Array, " ..."]
    """() log density of the measured entries given the past; 0 if none was measured."""
    count: Int[Array, " ..."]  # type: ignore[assignment]  # hides tuple.count
    """() number of measured entries."""


def symmetrise(matrix: Float[Array, "... k k"]) -> Float[Array, "... k k"]:
    """(M + M^T) / 2, over the last two axes."""
    return (matrix + jnp.swapaxes(matrix, -1, -2)) / 2


def predict(state: Gaussian, transition: Float[Array, "k k"], process_noise: Float[Array, "k k"]) -> Gaussian:
    """x -> A x, P -> A P A^T + Q; mean (k,), transition and process_noise (k, k)."""
    covariance = transition @ state.covariance @ transition.T + process_noise
    return Gaussian(transition @ state.mean, symmetrise(covariance))


def update(
    state: Gaussian, measurement: Float[Array, " m"], observation: Float[Array, "m k"], noise: Float[Array, "m m"]
) -> tuple[Gaussian, Innovation]:
    """Correct a state by y = C x + n, n ~ N(0, R), in Joseph's form (Bucy and Joseph 1968).

    (I - K C) P, as printed in the report, loses positive definiteness within seconds (errata 4); the Joseph form is a
    sum of squares, and stays symmetric and positive definite in float32. An entry that is NaN in the measurement is
    dropped exactly: its row of C, its gain and its share of the likelihood are zero.

    Args:
        state: mean (k,), covariance (k, k).
        measurement: (m,).
        observation: (m, k) C.
        noise: (m, m) R.

    Returns:
        the corrected state and the innovation.
    """
    measured = jnp.isfinite(measurement)
    predicted = observation @ state.mean
    # A dropped entry becomes an independent unit-variance measurement whose innovation is zero.
    residual = jnp.where(measured, jnp.where(measured, measurement, 0) - predicted, 0)
    C = jnp.where(measured[:, None], observation, 0)
    R = jnp.where(measured[:, None] & measured[None], noise, jnp.eye(measurement.shape[0], dtype=noise.dtype))
    S = symmetrise(C @ state.covariance @ C.T) + R
    cholesky = jnp.linalg.cholesky(S)
    gain = cho_solve((cholesky, True), C @ state.covariance).T
    weighted = cho_solve((cholesky, True), residual)
    keep = jnp.eye(state.mean.shape[0], dtype=state.mean.dtype) - gain @ C
    covariance = symmetrise(keep @ state.covariance @ keep.T) + symmetrise(gain @ R @ gain.T)
    count = measured.sum()
    nis = residual @ weighted
    log_determinant = 2 * jnp.log(jnp.diagonal(cholesky)).sum()
    log_likelihood = -(nis + log_determinant + count * jnp.log(2 * jnp.pi).astype(nis.dtype)) / 2
    full = symmetrise(observation @ state.covariance @ observation.T) + noise
    innovation = Innovation(jnp.where(measured, residual, jnp.nan), full, nis, log_likelihood, count)
    return Gaussian(state.mean + gain @ residual, covariance), innovation
