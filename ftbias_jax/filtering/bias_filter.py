"""Kalman filter for the sensor's bias and drift, given the wrench that the known tool must cause."""

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

    With correlated noise mean (18,) and covariance (18, 18) of (bias, drift, noise); the noise starts stationary.
    """
    mean, std = noise.prior_mean, noise.prior_std
    if noise.correlated_std is not None:
        mean, std = jnp.concatenate([mean, jnp.zeros_like(std[:6])]), jnp.concatenate([std, noise.correlated_std])
    return Gaussian(mean, jnp.diag(std**2))


def strength(noise: BiasNoise, vibration: Array | None = None, jump: Array | None = None) -> BiasStrength | Array:
    """Process noise of the bias state; only sigma_Q if no drift reverts, no bias jumps and no noise is correlated.

    Args:
        noise: noise model of the filter.
        vibration: (..., 6) N^2, Nm^2, variance that motion adds at these samples; None = none.
        jump: (..., 6) N^2, Nm^2, from ``jumps``; None = the sensor is never set to zero.
    """
    if noise.correlated_std is None and noise.drift_time is None and jump is None:
        return noise.density
    rate = None if noise.drift_time is None else 1 / noise.drift_time
    if noise.correlated_std is None or noise.correlated_time is None:
        # The reverse pass needs a transition that depends on parameters: XLA aborts the process if it has none.
        return BiasStrength(noise.density, jnp.zeros_like(noise.density) if rate is None else rate, jump=jump)
    return BiasStrength(noise.density, rate, 1 / noise.correlated_time, correlated_variance(noise, vibration), jump)


def driving(
    params: Params, rezeroed: Array | None, velocity: Array | None
) -> tuple[BiasStrength | Array, dict[str, Array] | None]:
    """``strength`` over a log, split into what is the same at all samples and the fields (T, 6) that are not, by name.

    ``rezeroed`` is (T,) as for ``jumps``; the velocity (T, n) rad/s is needed where vibration is correlated.
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
    """Variance (..., 6) N^2, Nm^2 of the jump of the bias at each sample; None = it never jumps.

    Where the sensor is set to zero the bias becomes minus what it would have read: anything from nothing to the tool's
    weight plus the previous bias. The variance covers that whole range, so that the readings alone determine the new
    bias; the drift continues unchanged.

    Args:
        params: of the pipeline.
        rezeroed: (...,) 1 where the sensor was set to zero since the previous sample, else 0.
    """
    if rezeroed is None:
        return None
    bias = params.bias
    weight = jnp.linalg.norm(params.gravity) * jnp.array([params.theta[0], jnp.linalg.norm(params.theta[1:4])])
    most = jnp.abs(bias.prior_mean[:6]) + jnp.repeat(jnp.abs(weight), 3)
    variance: Array = jax.lax.stop_gradient(bias.prior_std[:6] ** 2 + most**2)
    return rezeroed[..., None] * jnp.broadcast_to(variance, (*rezeroed.shape, 6))


def correlated_variance(noise: BiasNoise, vibration: Array | None = None) -> Array:
    """Variance (..., 6) N^2, Nm^2 of the correlated noise, including its share of the vibration."""
    assert noise.correlated_std is not None
    variance: Array = noise.correlated_std**2
    if vibration is None or noise.correlated_vibration is None:
        return variance
    share, at_rest = (jnp.broadcast_to(x, vibration.shape) for x in (noise.correlated_vibration, variance))
    return at_rest + share * vibration


def vibration(noise: BiasNoise, velocity: Array) -> Array | None:
    """Variance (..., 6) N^2, Nm^2 that joint motion at velocity (..., n) rad/s adds to the noise; None = none."""
    moving = noise.in_motion
    return None if moving is None else moving.variance(velocity)


def white_share(noise: BiasNoise, vibration: Array) -> Array:
    """Part of the vibration variance (..., 6), N^2, Nm^2, that is not correlated in time."""
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
        noise: noise model of the filter.
        state: after the previous sample, or from ``init``.
        dt: () s since the previous sample.
        wrench_tool: (6,) D theta.
        wrench: (6,) W as read, NaN = not measured.
        covariance: (6, 6) R of y.
        gate: standard deviations off the prediction beyond which, on any axis, a sample is not used, see ``_gated``.
        vibration: (6,) N^2, Nm^2, variance due to motion, part of which is correlated noise; None = none.
        jump: (6,) N^2, Nm^2, from ``jumps``; None = none.

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
    """Observation matrix (6, k) of a reading, N, Nm: the bias, plus the correlated noise if the state contains it."""
    k = state.mean.shape[0]
    bias = jnp.eye(6, k, dtype=state.mean.dtype)
    return bias if k == 12 else bias + jnp.eye(6, k, 12, dtype=state.mean.dtype)


def _gated(
    predicted: Gaussian, measurement: Array, covariance: Array, dt: Array, gate: float
) -> tuple[Gaussian, Array]:
    """The prediction and the measurement, which becomes NaN on all axes if one is off: contact moves all of them.

    Contact is indistinguishable from a bias that jumped. So the bias is forgotten exponentially while no sample passes:
    single spikes cost nothing, a contact of seconds little, and after a jump of 1 to 50 N the gate opens in 20 to 70 s,
    because the prediction has become uncertain enough.
    """
    C = observation_of(predicted)
    variance = jnp.diagonal(C @ predicted.covariance @ C.T) + jnp.diagonal(covariance)
    off = jnp.abs(measurement - C @ predicted.mean) > gate * jnp.sqrt(variance)  # false where nothing was measured
    closed = off.any()
    # Only the bias is forgotten: a jump of the bias does not change the drift.
    grown = jnp.where(closed, jnp.expm1(2 * dt / FORGET), 0) * jnp.diagonal(predicted.covariance)[:6]
    covariance = predicted.covariance + jnp.diag(jnp.pad(grown, (0, len(predicted.mean) - 6)))
    return predicted._replace(covariance=covariance), jnp.where(closed, jnp.nan, measurement)
