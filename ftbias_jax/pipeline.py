"""The whole method as one pure step: joint filter, sensor kinematics, bias filter.

``step`` is the single definition; ``run`` is ``lax.scan`` of it, online use is calling it, and every faster route is
tested equal to it. Arrays decide the precision: float32 in, float32 through; float64 needs JAX's x64 mode.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax import bias_filter, joint_filter
from ftbias_jax.bias_filter import BiasNoise
from ftbias_jax.effects.catalogue import values_from_setup
from ftbias_jax.effects.chain import fill_temperature
from ftbias_jax.effects.types import Values
from ftbias_jax.free_body import FreeBody
from ftbias_jax.gaussian import Innovation
from ftbias_jax.joint_filter import JointNoise
from ftbias_jax.screws import Arm, Motion, make_arm
from ftbias_jax.setup_types import Setup
from ftbias_jax.types import Array, Gaussian, Log, Sample
from ftbias_jax.wrench import (
    covariance_of_joints,
    joint_sensitivity,
    measurement_covariance,
    motion_and_wrench,
    tool_parameters,
)


class Params(NamedTuple):
    """Everything the filter believes; a pytree, differentiable in every leaf."""

    arm: Any
    """What carries the sensor: a screws.Arm, or where the sensor's pose is recorded a free_body.FreeBody."""
    gravity: Array
    """(3,) m/s^2, base frame, pointing down."""
    theta: Array
    """(10,) inertial parameters of the tool (wrench.py)."""
    joint: JointNoise
    bias: BiasNoise
    effects: Values | None = None
    """Known effects of the catalogue. They may need the whole log, so ``staged.run`` has them and ``step`` refuses."""


class Options(NamedTuple):
    """Choices that change the program, not its numbers: static under jit."""

    joint_model: str = "integrated_jerk"
    """Key of noise.JOINT_MODELS."""
    joint_uncertainty: str = "diagonal"
    """Whether the joint filter's covariance, pushed through D theta, is added to R at every sample: "none" (the report
    to the letter: error bars are far too small while the arm accelerates), "full", or "diagonal", which keeps each
    axis' variance and leaves out the correlation between axes, so that the axes stay independent filters."""
    gate: float | None = None
    """A wrench with any axis this many standard deviations off its prediction is not used (bias_filter); None = all
    are."""


DEFAULT_OPTIONS = Options()


class State(NamedTuple):
    """State of the pipeline between two samples."""

    joint: Gaussian
    """mean (n, 3) of (q, dq, ddq), covariance (n, 3, 3)."""
    bias: Gaussian
    """mean (12,) of (bias, drift), covariance (12, 12)."""


class Info(NamedTuple):
    """What a step learned; smoothing, tuning and diagnosis read only this."""

    joint: Innovation
    """of (q, dq), with a leading joint axis."""
    wrench: Innovation
    """of y = D theta - W."""
    wrench_tool: Array
    """(6,) D theta, N and Nm, sensor frame."""
    log_likelihood: Array
    """() increment: all joints and the wrench."""


Emit = Callable[[State, Info], Any]


def params_from_setup(setup: Setup, dtype: Any = None) -> Params:
    """Parameters of the filter as the robot's owner states them.

    Args:
        setup: what ``load_setup`` read; a joint process noise it leaves open becomes 1 here (batch.params_for_log
            chooses it from the log). dtype: of all arrays; None = JAX's default (float32, float64 in x64 mode).
    """
    sensor, n = setup.sensor, len(setup.robot.screws)
    tool = (_array(x, dtype) for x in (setup.tool.mass, setup.tool.center_of_mass, setup.tool.inertia))
    params = Params(
        _carrier(setup, dtype),
        setup.robot.gravity,
        jax.jit(tool_parameters)(*tool),
        JointNoise(
            np.ones(n) if setup.joints.process_noise_density is None else setup.joints.process_noise_density,
            setup.joints.position_noise_std,
            setup.joints.velocity_noise_std,
            setup.joints.initial_std,
        ),
        BiasNoise(
            setup.bias.noise_density,
            None,
            sensor.noise_std**2 + _unknown_acceleration(setup),
            np.concatenate([setup.bias.initial, setup.bias.initial_drift]),
            np.concatenate([setup.bias.initial_std, setup.bias.initial_drift_std]),
        ),
    )
    params = params._replace(effects=values_from_setup(setup.effects, setup.path) or None)
    converted: Params = jax.tree.map(partial(_array, dtype=dtype), params)
    return converted


def _carrier(setup: Setup, dtype: Any) -> Arm | FreeBody:
    """What carries the sensor."""
    robot, sensor = setup.robot, setup.sensor
    if setup.pose is not None:
        # An accelerometer's path is that of the sensor itself.
        translation = np.zeros(3) if setup.pose.linear == "specific_force" else sensor.translation
        return FreeBody(translation, sensor.rotation)
    rotation = robot.flange_rotation @ sensor.rotation
    position = robot.flange_translation + robot.flange_rotation @ sensor.translation
    arm: Arm = jax.jit(make_arm)(_array(robot.screws, dtype), _array(position, dtype), _array(rotation, dtype))
    return arm


def _unknown_acceleration(setup: Setup) -> Array:
    """(6,) N^2, Nm^2: variance of the tool's wrench by accelerations that nobody recorded, the same in all axes."""
    if setup.pose is None or setup.pose.linear != "none":
        return np.zeros(6)
    center = setup.tool.center_of_mass
    arm = center @ center - center**2  # squares of the distances of the centre of mass from the axes
    return (setup.tool.mass * setup.pose.acceleration_std) ** 2 * np.concatenate([np.ones(3), arm])


def options_from_setup(setup: Setup) -> Options:
    """The choices that a setup makes."""
    return Options(joint_model=setup.joints.model, gate=setup.bias.gate)


def samples_from_log(log: Log, dtype: Any = None, before: float | None = None) -> Sample:
    """A log as filter input: leaves with a leading time axis. dt is taken in float64 before any rounding to dtype.

    Args:
        log: a whole log, or a part of one. dtype: of the arrays. before: s, stamp of the sample before the part.
    """
    dt = np.diff(np.asarray(log.t, np.float64), prepend=log.t[0] if before is None else before)
    temperature = fill_temperature(log.t, log.temperature) if np.isfinite(log.temperature).any() else None
    columns = (dt, log.q, log.dq, log.wrench, temperature)
    return Sample(*(None if x is None else _array(x, dtype) for x in columns))


@partial(jax.jit, static_argnames="length")
def pad(samples: Sample, length: int) -> Sample:
    """Lengthen a log by samples that change nothing (dt = 0, all NaN), so that logs stack for vmap."""
    missing = length - samples.dt.shape[0]
    if missing < 0:
        raise ValueError(f"cannot pad {samples.dt.shape[0]} samples to {length}")

    def lengthen(x: Array, value: float) -> Array:
        return jnp.concatenate([x, jnp.full((missing, *x.shape[1:]), value, x.dtype)])

    q, dq, wrench = (lengthen(x, jnp.nan) for x in samples[1:4])
    temperature = None if samples.temperature is None else jnp.pad(samples.temperature, (0, missing), mode="edge")
    return Sample(lengthen(samples.dt, 0.0), q, dq, wrench, temperature)


@jax.jit
def init(params: Params, samples: Sample) -> State:
    """State before the first sample of a log; every joint starts at its first measured position."""
    start = joint_filter.first_measured(samples.q)
    return State(joint_filter.init(params.joint, start), bias_filter.init(params.bias))


def step(params: Params, state: State, sample: Sample, options: Options = DEFAULT_OPTIONS) -> tuple[State, Info]:
    """One sample through the pipeline (report, sections 1 to 3).

    Args:
        params, options: beliefs and choices. state: after the previous sample.
        sample: dt (), q and dq (n,), wrench (6,); NaN = not measured, a whole sample, one stream or one axis.

    Returns:
        the state after the sample, and what it said.
    """
    if params.effects is not None:
        raise ValueError("effects act on whole logs, not on single samples: use staged.run")
    joint, joint_innovation = joint_filter.step(
        params.joint, state.joint, sample.dt, sample.q, sample.dq, options.joint_model
    )
    motion, wrench_tool = predict_wrench(params, joint.mean)
    R = measurement_covariance(params.theta, params.bias.data_variance, params.bias.wrench_variance)
    if options.joint_uncertainty != "none":
        G = joint_sensitivity(params.theta, motion.R_base_sensor, motion.jacobian, params.gravity)
        R = R + covariance_of_joints(G, joint.covariance, options.joint_uncertainty)
    bias, wrench_innovation = bias_filter.step(
        params.bias, state.bias, sample.dt, wrench_tool, sample.wrench, R, options.gate
    )
    log_likelihood = joint_innovation.log_likelihood.sum() + wrench_innovation.log_likelihood
    return State(joint, bias), Info(joint_innovation, wrench_innovation, wrench_tool, log_likelihood)


@partial(jax.jit, static_argnames=("options", "emit"))
def run(
    params: Params,
    state: State,
    samples: Sample,
    options: Options = DEFAULT_OPTIONS,
    emit: Emit = lambda state, info: (state, info),
) -> tuple[State, Any]:
    """Filter a whole log: ``lax.scan`` of ``step``.

    Args:
        params, state, options: as for ``step``. samples: leaves with a leading time axis (T, ...).
        emit: what to keep of every sample, (state, info) -> pytree; all of both by default.

    Returns:
        the last state, to carry into the next part of the log, and what ``emit`` kept, with a leading time axis.
    """

    def body(state: State, sample: Sample) -> tuple[State, Any]:
        state, info = step(params, state, sample, options)
        return state, emit(state, info)

    return jax.lax.scan(body, state, samples)


def predict_wrench(params: Params, joint_mean: Array) -> tuple[Motion, Array]:
    """Motion of the sensor and the wrench D theta (6,) of the tool, sensor frame, from joint states (n, 3)."""
    return motion_and_wrench(params.arm, params.gravity, params.theta, *joint_mean.T)


def _array(x: Any, dtype: Any) -> Array:
    return jnp.asarray(x, dtype if dtype is not None else jnp.result_type(float))
