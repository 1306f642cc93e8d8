"""Kalman filter for the bias of the sensor and its drift, from the wrench that the known tool must cause."""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
from jax import Array

from ftbias_jax.filtering import gaussian
from ftbias_jax.filtering.gaussian import Innovation
from ftbias_jax.filtering.process_models import bias_drift_noise
from ftbias_jax.model.params import BiasNoise
from ftbias_jax.types import Gaussian

if TYPE_CHECKING:
    from jaxtyping import Float

FORGET = 10.0
"""s: time in which the standard deviation of the bias grows e-fold while the gate lets nothing through."""


def init(noise: BiasNoise) -> Gaussian:
    """State before the first sample: mean (12,) and covariance (12, 12)."""
    return Gaussian(noise.prior_mean, jnp.diag(noise.prior_std**2))


def step(
    noise: BiasNoise,
    state: Gaussian,
    dt: Float[Array, ""],
    wrench_tool: Float[Array, " 6"],
    wrench: Float[Array, " 6"],
    covariance: Float[Array, "6 6"],
    gate: float | None = None,
) -> tuple[Gaussian, Innovation]:
    """Predict by dt, then correct by y = D theta - W (report, section 3).

    Args:
        noise: of the filter.
        state: mean (12,), covariance (12, 12).
        dt: () s since the previous sample.
        wrench_tool: (6,) D theta.
        wrench: (6,) W as read, NaN = not measured.
        covariance: (6, 6) R of y.
        gate: a sample with any axis this many standard deviations off its prediction is not used, see ``_gated``.

    Returns:
        the corrected state and the innovation y - b.
    """
    predicted = gaussian.predict(state, *bias_drift_noise(dt, noise.density))
    observation = jnp.eye(6, 12, dtype=state.mean.dtype)
    measurement = wrench_tool - wrench
    if gate is not None:
        predicted, measurement = _gated(predicted, measurement, covariance, dt, gate)
    return gaussian.update(predicted, measurement, observation, covariance)


def _gated(
    predicted: Gaussian, measurement: Array, covariance: Array, dt: Array, gate: float
) -> tuple[Gaussian, Array]:
    """The prediction and the measurement, which is NaN in all axes if one is off: a contact moves all of them.

    What was touched cannot be told from a bias that jumped. So what is known of the bias is forgotten while nothing
    passes, exponentially: single spikes cost nothing, a contact of seconds little, and after a jump of 1 to 50 N the
    gate opens in 20 to 70 s, because the prediction has become uncertain enough.
    """
    variance = jnp.diagonal(predicted.covariance)[:6] + jnp.diagonal(covariance)
    off = jnp.abs(measurement - predicted.mean[:6]) > gate * jnp.sqrt(variance)  # never where nothing was measured
    closed = off.any()
    # Only the bias is forgotten: a jump is no drift.
    grown = jnp.where(closed, jnp.expm1(2 * dt / FORGET), 0) * jnp.diagonal(predicted.covariance)[:6]
    covariance = predicted.covariance + jnp.diag(jnp.concatenate([grown, jnp.zeros_like(grown)]))
    return predicted._replace(covariance=covariance), jnp.where(closed, jnp.nan, measurement)
