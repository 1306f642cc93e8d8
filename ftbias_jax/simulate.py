"""A simulated log: joint motion -> wrench of the tool -> bias process -> noise. Pure and seeded by JAX keys."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp

from ftbias_jax.pipeline import Params
from ftbias_jax.screws import Arm, sensor_motion
from ftbias_jax.types import Array
from ftbias_jax.wrench import data_matrix


class Trajectory(NamedTuple):
    """Joint motion without noise, leading time axis."""

    t: Array
    """(T,) s."""
    q: Array
    """(T, n) rad."""
    dq: Array
    """(T, n) rad/s."""
    ddq: Array
    """(T, n) rad/s^2."""


class Simulation(NamedTuple):
    """A log and what is true about it."""

    t: Array
    """(T,) s."""
    q: Array
    """(T, n) rad, with encoder noise."""
    dq: Array
    """(T, n) rad/s, with noise."""
    wrench: Array
    """(T, 6) N, Nm as the sensor reads it: tool - bias + noise."""
    wrench_tool: Array
    """(T, 6) N, Nm without bias and noise."""
    bias: Array
    """(T, 6) N, Nm, sign of the report."""
    drift: Array
    """(T, 6) N/s, Nm/s."""


def excitation_sines(
    key: Array, t: Array, center: Array, amplitude: Array, harmonics: int = 4, base_frequency: float = 0.05
) -> Trajectory:
    """Sums of sines around a pose, random in phase and weight; every joint moves, velocity and acceleration are exact.

    Args:
        key: JAX key. t: (T,) s. center: (n,) rad. amplitude: (n,) rad, an upper bound of each joint's excursion.
        harmonics: sines per joint. base_frequency: Hz, lowest frequency; the others are its multiples.
    """
    weight_key, phase_key = jax.random.split(key)
    shape = (harmonics, center.shape[0])
    weight = jax.random.dirichlet(weight_key, jnp.ones(harmonics, t.dtype), (center.shape[0],)).T * amplitude[None]
    phase = jax.random.uniform(phase_key, shape, t.dtype, 0, 2 * jnp.pi)
    # Spread over the harmonics unevenly so that no two joints repeat together.
    omega = 2 * jnp.pi * base_frequency * (1 + jnp.arange(harmonics, dtype=t.dtype))[:, None]
    omega = omega * (1 + 0.07 * jnp.arange(center.shape[0], dtype=t.dtype))[None]
    angle = omega[None] * t[:, None, None] + phase[None]
    q = center[None] + (weight[None] * jnp.sin(angle)).sum(1)
    dq = ((weight * omega)[None] * jnp.cos(angle)).sum(1)
    ddq = -((weight * omega**2)[None] * jnp.sin(angle)).sum(1)
    return Trajectory(t, q, dq, ddq)


def tool_wrench(arm: Arm, gravity: Array, theta: Array, q: Array, dq: Array, ddq: Array) -> Array:
    """Wrench W = D theta that the sensor exerts on the tool; (n,) joint states -> (6,) N, Nm, sensor frame."""
    motion = sensor_motion(arm, q, dq, ddq)
    to_sensor = motion.R_base_sensor.T
    return (
        data_matrix(
            to_sensor @ (motion.linear_acceleration - gravity),
            to_sensor @ motion.angular_velocity,
            to_sensor @ motion.angular_acceleration,
        )
        @ theta
    )


def bias_process(key: Array, t: Array, density: Array, initial: Array, initial_drift: Array) -> tuple[Array, Array]:
    """A sample path of the bias model: the drift is integrated white noise, exact at the stamps.

    Args:
        key: JAX key. t: (T,) s. density: (6,) N/s^1.5, Nm/s^1.5. initial: (6,) N, Nm. initial_drift: (6,) N/s, Nm/s.

    Returns:
        bias (T, 6) and drift (T, 6).
    """
    dt, density = jnp.diff(t, prepend=t[:1])[:, None], density[None]
    kick, slip = jax.random.normal(key, (2, t.shape[0], 6), t.dtype)
    # Cholesky factor of [[dt, dt^2/2], [dt^2/2, dt^3/3]], the covariance of a step of (drift, bias).
    drift_step = jnp.sqrt(dt) * density * kick
    bias_step = dt * drift_step / 2 + jnp.sqrt(dt**3 / 12) * density * slip
    drift = initial_drift[None] + jnp.cumsum(drift_step, 0)
    before = jnp.concatenate([initial_drift[None], drift[:-1]])
    bias = initial[None] + jnp.cumsum(dt * before + bias_step, 0)
    return bias, drift


@partial(jax.jit)
def simulate(key: Array, params: Params, trajectory: Trajectory) -> Simulation:
    """A log of the given motion by the filter's own model: no unmodelled effect, noise as stated in params.

    The bias starts at a draw from the prior (mean and P_0 of params.bias). vmap over keys or parameters for many logs.
    """
    t, q, dq, ddq = trajectory
    start_key, bias_key, q_key, dq_key, wrench_key = jax.random.split(key, 5)
    wrench_tool = jax.vmap(partial(tool_wrench, params.arm, params.gravity, params.theta))(q, dq, ddq)
    start = params.bias.prior_mean + params.bias.prior_std * jax.random.normal(start_key, (12,), t.dtype)
    bias, drift = bias_process(bias_key, t, params.bias.density, start[:6], start[6:])

    def noisy(key: Array, x: Array, std: Array) -> Array:
        return x + std[None] * jax.random.normal(key, x.shape, x.dtype)

    return Simulation(
        t,
        noisy(q_key, q, params.joint.position_std),
        noisy(dq_key, dq, params.joint.velocity_std),
        noisy(wrench_key, wrench_tool - bias, jnp.sqrt(params.bias.wrench_variance)),
        wrench_tool,
        bias,
        drift,
    )
