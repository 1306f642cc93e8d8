"""Simulation of a log: joint motion -> wrench of the tool with effects -> bias process -> noise -> samples.

The functions are pure and seeded by JAX keys; ``vmap`` over keys, parameters, trajectories and effects makes many logs
together. On a CPU ``jax.lax.map`` is twice as fast, because one log fits its cache and many do not.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from ftbias_jax.model.effects import compose
from ftbias_jax.model.effects.catalogue import CATALOGUE, catalogue_of, values_of
from ftbias_jax.model.effects.types import Model, Record, Signals, Values
from ftbias_jax.model.kinematics.recorded_pose import speeds_of
from ftbias_jax.model.params import Params
from ftbias_jax.model.trajectories import Trajectory
from ftbias_jax.model.wrench.tool_wrench import measurement_covariance
from ftbias_jax.types import Array


class Simulation(NamedTuple):
    """A simulated log and its ground truth."""

    t: Array
    """(T,) s."""
    q: Array
    """(T, n) rad, with encoder noise."""
    dq: Array
    """(T, n) rad/s, with noise."""
    wrench: Array
    """(T, 6) N, Nm as the sensor reads it: clean - bias process + noise; NaN = lost sample."""
    wrench_tool: Array
    """(T, 6) N, Nm: wrench of the tool that the setup states, without effects, bias or noise."""
    bias: Array
    """(T, 6) N, Nm, sign of the report: the bias process plus the effects of the bias stage."""
    drift: Array
    """(T, 6) N/s, Nm/s: drift of the bias process."""
    wrench_clean: Array
    """(T, 6) N, Nm: reading of the sensor without bias process and noise (``compose.predict``)."""
    temperature: Array
    """(T,) deg C."""


def bias_process(key: Array, t: Array, density: Array, initial: Array, initial_drift: Array) -> tuple[Array, Array]:
    """Sample path of the bias model, exact at the stamps: the drift is integrated white noise.

    Args:
        key: JAX key.
        t: (T,) s.
        density: (6,) N/s^1.5, Nm/s^1.5.
        initial: (6,) N, Nm.
        initial_drift: (6,) N/s, Nm/s.

    Returns:
        bias (T, 6) and drift (T, 6).
    """
    dt = jnp.diff(t, prepend=t[:1])[:, None]
    kick, slip = jax.random.normal(key, (2, t.shape[0], 6), t.dtype)
    drift_step, bias_step = bias_steps(dt, density[None], kick, slip)
    drift = initial_drift[None] + jnp.cumsum(drift_step, 0)
    before = jnp.concatenate([initial_drift[None], drift[:-1]])
    bias = initial[None] + jnp.cumsum(dt * before + bias_step, 0)
    return bias, drift


def bias_steps(dt: Array, density: Array, kick: Array, slip: Array) -> tuple[Array, Array]:
    """Process noise of drift and bias over steps of dt (T, 1) s, from standard normals (T, 6), NumPy or JAX.

    It uses the Cholesky factor of [[dt, dt^2/2], [dt^2/2, dt^3/3]], the covariance of a step of (drift, bias).
    """
    drift_step = dt**0.5 * density * kick
    return drift_step, dt * drift_step / 2 + (dt**3 / 12) ** 0.5 * density * slip


def temperature_course(t: Array) -> Array:
    """Temperature (T,) deg C of a sensor that warms by 6 K and cools again: neither a straight line nor exponential."""
    return 28 - 3 * jnp.cos(2 * jnp.pi * t / jnp.maximum(t[-1], 1e-9))


def _effects_of_noise(params: Params) -> Values:
    """Effects of the catalogue that the filter models as noise, with their values in ``params``."""
    values = {}
    for effect in CATALOGUE.values():
        field = effect.filter_noise
        if field and getattr(params.bias, field) is not None:
            first, *further = (parameter.name for parameter in effect.parameters)
            fields = {first: field} | {name: f"{field}_{name}" for name in further}
            stated = {name: getattr(params.bias, own) for name, own in fields.items()}
            values[effect.name] = {name: value for name, value in stated.items() if value is not None}
    return values


@jax.jit
def simulate(
    key: Array,
    params: Params,
    trajectory: Trajectory,
    effects: Values | None = None,
    temperature: Array | None = None,
    columns: dict[str, Array] | None = None,
) -> Simulation:
    """Simulate a log of the given motion with the filter's own model, the given effects and the noise of params.

    The bias starts at a draw from the prior (mean and P_0 of params.bias). Noise that grows with the motion according
    to params.bias becomes the effect ``vibration``, unless ``effects`` has it with other values. The trajectory is the
    reading of the encoders: with ``encoder_offset`` the true pose of the arm differs.

    Args:
        key: JAX key; the same key gives the same bias and noise with any effects.
        params: parameters as stated in the setup.
        trajectory: joint motion, (T, ...).
        effects: effect -> parameters; None = none.
        temperature: (T,) deg C; None = constant.
        columns: name -> (T,) further quantities that effects may depend on; None = none.
    """
    t, q, dq, ddq = trajectory
    effects = values_of(_effects_of_noise(params) | (effects or {}), catalogue_of(effects or {}))
    temperature = jnp.zeros_like(t) if temperature is None else temperature
    start_key, bias_key, noise_key, record_key = jax.random.split(key, 4)
    model = Model(params.arm, params.gravity, params.theta)
    signals = Signals(t, q, dq, ddq, temperature, model, columns=columns or {})
    wrench_tool = compose.predict(signals, {})
    clean = compose.predict(signals, effects) if effects else wrench_tool
    start = params.bias.prior_mean + params.bias.prior_std * jax.random.normal(start_key, (12,), t.dtype)
    bias, drift = bias_process(bias_key, t, params.bias.density, start[:6], start[6:])
    R = measurement_covariance(params.theta, params.bias.data_variance, params.bias.wrench_variance)
    std = jnp.concatenate([params.joint.position_std, params.joint.velocity_std, jnp.sqrt(jnp.diagonal(R))])
    n = q.shape[1]
    noise_q, noise_dq, noise = jnp.split(
        std[None] * jax.random.normal(noise_key, (t.shape[0], 2 * n + 6), t.dtype), (n, 2 * n), 1
    )
    louder = jnp.diagonal(R)[None] + compose.variance_of_terms(signals, effects, clean)
    noise = noise * jnp.sqrt(louder / jnp.diagonal(R)[None])
    taken = Record(t, clean - bias + noise, noise, speeds_of(params.arm, dq))
    samples = compose.record(record_key, taken, model, effects)
    return Simulation(
        samples.t,
        q + noise_q,
        dq + noise_dq,
        samples.wrench,
        wrench_tool,
        bias + compose.bias(signals, effects),
        drift,
        clean,
        temperature,
    )
