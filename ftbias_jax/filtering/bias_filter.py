"""Kalman filter for the bias of the sensor and its drift, from the wrench that the known tool must cause."""

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from ftbias_jax.filtering import gaussian
from ftbias_jax.filtering.gaussian import Innovation
from ftbias_jax.filtering.process_models import FORGET, BiasStrength, bias_noise
from ftbias_jax.model.params import BiasNoise, Params
from ftbias_jax.types import Gaussian


def init(noise: BiasNoise) -> Gaussian:
    """State before the first sample: mean (12,) and covariance (12, 12) of (bias, drift).

    With correlated noise mean (18,) and covariance (18, 18) of (bias, drift, noise), the noise being stationary.
    """
    mean, std = noise.prior_mean, noise.prior_std
    if noise.correlated_std is not None:
        mean, std = jnp.concatenate([mean, jnp.zeros_like(std[:6])]), jnp.concatenate([std, noise.correlated_std])
    return Gaussian(mean, jnp.diag(std**2))


def strength(noise: BiasNoise, vibration: Array | None = None, jump: Array | None = None) -> BiasStrength | Array:
    """What drives bias, drift and correlated noise; sigma_Q alone where the drift never reverts and all noise is white.

    Args:
        noise: of the filter.
        vibration: (..., 6) N^2, Nm^2, variance by motion at these samples; None = nothing.
        jump: (..., 6) N^2, Nm^2, of ``jumps``; None = the sensor is never set to zero.
    """
    if noise.correlated_std is None and noise.drift_time is None and jump is None:
        return noise.density
    rate = None if noise.drift_time is None else 1 / noise.drift_time
    if noise.correlated_std is None or noise.correlated_time is None:
        # The reverse pass takes a transition that has parameters: XLA ends the process if it has none.
        return BiasStrength(noise.density, jnp.zeros_like(noise.density) if rate is None else rate, jump=jump)
    return BiasStrength(noise.density, rate, 1 / noise.correlated_time, correlated_variance(noise, vibration), jump)


def driving(
    params: Params, rezeroed: Array | None, velocity: Array | None
) -> tuple[BiasStrength | Array, dict[str, Array] | None]:
    """``strength`` over a log: what of it is the same at all samples, and its fields (T, 6) that are not, by name.

    The samples (T,) are as for ``jumps``; the velocity (T, n) rad/s is needed where vibration is correlated.
    """
    noise, jump = params.bias, jumps(params, rezeroed)
    constant, drive = strength(noise, jump=jump), {} if jump is None else {"jump": jump}
    if noise.correlated_std is not None and noise.correlated_vibration is not None and noise.vibration is not None:
        assert velocity is not None
        drive["noise_variance"] = correlated_variance(noise, vibration(noise, velocity))
    if not drive:
        return constant, None
    assert isinstance(constant, BiasStrength)
    nothing: dict[str, Any] = dict.fromkeys(drive)
    return constant._replace(**nothing), drive


def jumps(params: Params, rezeroed: Array | None) -> Array | None:
    """(..., 6) N^2, Nm^2 by which the bias may jump at each sample; None = never.

    Where the sensor is set to zero the bias becomes minus what it would have read, anything between nothing and the
    tool's weight and what it was before. The variance is as large as all that, so that the readings alone decide; the
    drift goes on as it was.

    Args:
        params: of the pipeline.
        rezeroed: (...,) 1 where the sensor was set to zero since the sample before, else 0.
    """
    if rezeroed is None:
        return None
    bias = params.bias
    weight = jnp.linalg.norm(params.gravity) * jnp.array([params.theta[0], jnp.linalg.norm(params.theta[1:4])])
    most = jnp.abs(bias.prior_mean[:6]) + jnp.repeat(jnp.abs(weight), 3)
    variance: Array = jax.lax.stop_gradient(bias.prior_std[:6] ** 2 + most**2)
    return rezeroed[..., None] * jnp.broadcast_to(variance, (*rezeroed.shape, 6))


def correlated_variance(noise: BiasNoise, vibration: Array | None = None) -> Array:
    """(..., 6) N^2, Nm^2: variance of the correlated noise, with its share of the vibration."""
    assert noise.correlated_std is not None
    variance: Array = noise.correlated_std**2
    if vibration is None or noise.correlated_vibration is None:
        return variance
    share, at_rest = (jnp.broadcast_to(x, vibration.shape) for x in (noise.correlated_vibration, variance))
    return at_rest + share * vibration


def vibration(noise: BiasNoise, velocity: Array) -> Array | None:
    """(..., 6) N^2, Nm^2: what the motion of the joints, velocity (..., n) rad/s, adds to the noise; None = nothing."""
    moving = noise.in_motion
    return None if moving is None else moving.variance(velocity)


def white_share(noise: BiasNoise, vibration: Array) -> Array:
    """The part of the vibration (..., 6), N^2, Nm^2, that is not correlated in time."""
    if noise.correlated_vibration is None:
        return vibration
    return jnp.broadcast_to(1 - noise.correlated_vibration, vibration.shape) * vibration


def step(
    noise: BiasNoise,
    state: Gaussian,
    dt: Float[Array, ""],
    wrench_tool: Float[Array, " 6"],
    wrench: Float[Array, " 6"],
    covariance: Float[Array, "6 6"],
    gate: float | None = None,
    vibration: Array | None = None,
    jump: Array | None = None,
) -> tuple[Gaussian, Innovation]:
    """Predict by dt, then correct by y = D theta - W (report, section 3), which is the bias plus noise.

    Args:
        noise: of the filter.
        state: as of ``init``.
        dt: () s since the previous sample.
        wrench_tool: (6,) D theta.
        wrench: (6,) W as read, NaN = not measured.
        covariance: (6, 6) R of y.
        gate: a sample with any axis this many standard deviations off its prediction is not used, see ``_gated``.
        vibration: (6,) N^2, Nm^2, variance by motion, of which the correlated noise has a share; None = nothing.
        jump: (6,) N^2, Nm^2, of ``jumps``; None = nothing.

    Returns:
        the corrected state and the innovation y - b.
    """
    predicted = gaussian.predict(state, *bias_noise(dt, strength(noise, vibration, jump)))
    observation = observation_of(predicted)
    measurement = wrench_tool - wrench
    if gate is not None:
        predicted, measurement = _gated(predicted, measurement, covariance, dt, gate)
    return gaussian.update(predicted, measurement, observation, covariance)


def observation_of(state: Gaussian) -> Array:
    """(6, k) what of the state a reading, N, Nm, shows: the bias, plus the correlated noise if the state has it."""
    k = state.mean.shape[0]
    bias = jnp.eye(6, k, dtype=state.mean.dtype)
    return bias if k == 12 else bias + jnp.eye(6, k, 12, dtype=state.mean.dtype)


def _gated(
    predicted: Gaussian, measurement: Array, covariance: Array, dt: Array, gate: float
) -> tuple[Gaussian, Array]:
    """The prediction and the measurement, which is NaN in all axes if one is off: a contact moves all of them.

    A contact is indistinguishable from a bias that jumped. So what is known of the bias is forgotten while nothing
    passes, exponentially: single spikes cost nothing, a contact of seconds little, and after a jump of 1 to 50 N the
    gate opens in 20 to 70 s, because the prediction has become uncertain enough.
    """
    C = observation_of(predicted)
    variance = jnp.diagonal(C @ predicted.covariance @ C.T) + jnp.diagonal(covariance)
    off = jnp.abs(measurement - C @ predicted.mean) > gate * jnp.sqrt(variance)  # never where nothing was measured
    closed = off.any()
    # Only the bias is forgotten: a jump is no drift.
    grown = jnp.where(closed, jnp.expm1(2 * dt / FORGET), 0) * jnp.diagonal(predicted.covariance)[:6]
    covariance = predicted.covariance + jnp.diag(jnp.pad(grown, (0, len(predicted.mean) - 6)))
    return predicted._replace(covariance=covariance), jnp.where(closed, jnp.nan, measurement)
