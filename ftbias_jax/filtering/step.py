"""The whole method as one pure step: joint filter, sensor kinematics, bias filter.

``step`` is the single definition; ``pipeline.scan_steps`` is ``lax.scan`` of it, online use calls it, and every faster
route, ``pipeline.run`` first, is tested equal to it. The arrays decide the precision: float32 in, float32 throughout;
float64 needs JAX's x64 mode.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from ftbias_jax.errors import SetupError
from ftbias_jax.filtering import bias_filter, joint_filter
from ftbias_jax.filtering.gaussian import Innovation
from ftbias_jax.model.kinematics.recorded_pose import speeds_of
from ftbias_jax.model.kinematics.screws import Motion
from ftbias_jax.model.params import Params
from ftbias_jax.model.wrench.tool_wrench import (
    covariance_of_joints,
    joint_sensitivity,
    measurement_covariance,
    motion_and_wrench,
)
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Gaussian, Sample


class Options(NamedTuple):
    """Choices that change the program rather than its numbers: static under jit."""

    joint_model: str = "integrated_jerk"
    """Key of process_models.JOINT_MODELS."""
    uncertain_joints: bool = True
    """Whether the joint filter's covariance, propagated through D theta, is added to R at every sample: the variance of
    each axis without the correlation between them, so that the axes stay independent filters. False follows the report
    to the letter: error bars are far too small while the arm accelerates."""
    gate: float | None = None
    """Standard deviations: a wrench with any axis further off its prediction is not used (bias_filter); None = no
    gate."""


DEFAULT_OPTIONS = Options()


class State(NamedTuple):
    """State of the pipeline between two samples."""

    joint: Gaussian
    """Mean (n, 3) of (q, dq, ddq), covariance (n, 3, 3)."""
    bias: Gaussian
    """Mean (12,) of (bias, drift), covariance (12, 12); with correlated noise (18,) of (bias, drift, noise)."""


class Info(NamedTuple):
    """Innovations and likelihood of a step, all that smoothing, tuning and diagnosis read; many have a time axis."""

    joint: Innovation
    """Innovation of (q, dq), with a leading joint axis."""
    wrench: Innovation
    """Innovation of y = D theta - W."""
    wrench_tool: Float[Array, "... 6"]
    """(6,) D theta, N and Nm, sensor frame."""
    log_likelihood: Float[Array, " ..."]
    """() increment of the log-likelihood by all joints and the wrench."""


Emit = Callable[[State, Info], Any]


def options_from_setup(setup: Setup) -> Options:
    """Options that a setup states."""
    return Options(joint_model=setup.joints.model, gate=setup.bias.gate)


@jax.jit
def init(params: Params, samples: Sample) -> State:
    """State before the first sample of a log; every joint starts at its first measured position."""
    start = joint_filter.first_measured(samples.q)
    return State(joint_filter.init(params.joint, start), bias_filter.init(params.bias))


@partial(jax.jit, static_argnames="options", inline=True)
def step(params: Params, state: State, sample: Sample, options: Options = DEFAULT_OPTIONS) -> tuple[State, Info]:
    """One sample through the pipeline (report, sections 1 to 3).

    Args:
        params: robot, tool and noise as stated or fitted.
        state: after the previous sample.
        sample: dt (), q and dq (n,), wrench (6,); NaN = not measured, for a whole sample, one stream or one axis.
        options: choices of the program, static under jit.

    Returns:
        the state after the sample, and its innovations and likelihood.

    Raises:
        SetupError: the setup states effects, which act on whole logs.
    """
    if params.effects is not None:
        remedy = "filter whole logs (pipeline.run, filter_log), or leave them out; ftbias export writes a mended robot"
        raise SetupError("known effects act on whole logs, not on single samples", field="effects", remedy=remedy)
    joint, joint_innovation = joint_filter.step(
        params.joint, state.joint, sample.dt, sample.q, sample.dq, options.joint_model
    )
    motion, wrench_tool = predict_wrench(params, joint.mean)
    R = measurement_covariance(params.theta, params.bias.data_variance, params.bias.wrench_variance)
    if options.uncertain_joints:
        G = joint_sensitivity(params.theta, motion.R_base_sensor, motion.jacobian, params.gravity)
        R = R + covariance_of_joints(G, joint.covariance)
    vibration = bias_filter.vibration(params.bias, speeds_of(params.arm, joint.mean[:, 1]))
    if vibration is not None:
        R = R + jnp.diag(bias_filter.white_share(params.bias, vibration))
    jump = bias_filter.jumps(params, sample.rezeroed)
    bias, wrench_innovation = bias_filter.step(
        params.bias, state.bias, sample.dt, wrench_tool, sample.wrench, R, options.gate, vibration, jump
    )
    log_likelihood = joint_innovation.log_likelihood.sum() + wrench_innovation.log_likelihood
    return State(joint, bias), Info(joint_innovation, wrench_innovation, wrench_tool, log_likelihood)


def predict_wrench(params: Params, joint_mean: Float[Array, "n 3"]) -> tuple[Motion, Float[Array, " 6"]]:
    """Motion of the sensor and the wrench D theta (6,) N, Nm of the tool, sensor frame, from joint states (n, 3)."""
    return motion_and_wrench(params.arm, params.gravity, params.theta, *joint_mean.T)
