"""Log-likelihood of a log in innovations form, and whitening by the bias filter for regression on innovations.

The likelihood is differentiable with respect to every parameter; its gradient costs one additional pass (scan.py).
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from ftbias_jax.errors import UsageError
from ftbias_jax.filtering import bias_filter, pipeline
from ftbias_jax.filtering.fast import stages
from ftbias_jax.filtering.fast.log_likelihoods import log_likelihoods
from ftbias_jax.filtering.fast.scan import Inputs, filter_sums, innovations
from ftbias_jax.filtering.pipeline import DEFAULT_OPTIONS, Info, Options, State
from ftbias_jax.filtering.process_models import JOINT_MODELS, BiasStrength, ProcessModel, bias_model
from ftbias_jax.filtering.smoother import smooth_joint_tracks
from ftbias_jax.model.params import Params
from ftbias_jax.model.wrench.tool_wrench import unbias
from ftbias_jax.runtime.compiled_loops import on_cpu, over_pieces
from ftbias_jax.types import Gaussian, Sample

JAX_SAYS = ("can't apply forward-mode", "Linearization failed")
"""Start of JAX's message for a forward derivative of a custom reverse pass; that for a second one is empty."""


class LogLikelihood(NamedTuple):
    """Log density of the measurements, in nats."""

    joint: Float[Array, ""]
    """() log density of joint positions and velocities."""
    wrench: Float[Array, ""]
    """() log density of the wrench given the joints."""

    @property
    def total(self) -> Float[Array, ""]:
        """() sum of both."""
        return self.joint + self.wrench


def log_likelihood(
    params: Params,
    samples: Sample,
    options: Options = DEFAULT_OPTIONS,
    burn_in: float | Array = 0.0,
    *,
    by_steps: bool = False,
) -> Float[Array, ""]:
    """Log-likelihood of a log (errata 13), () nats, of joints and wrench together, to be differentiated or mapped.

    It has the precision of its arrays, because it is part of the caller's own program.

    Args:
        params: from ``params_for_log``; differentiable with respect to every leaf, rotations in the directions in which
            they remain rotations.
        samples: from ``samples_from_log``, leaves with a leading time axis; padding does not count.
        options: of the pipeline, from ``options_from_setup`` where a setup states any.
        burn_in: s at the start of the log that are excluded, because the first innovations mostly measure P_0.
        by_steps: use ``pipeline.scan_steps``, which is many times slower but also supports forward-mode and second
            derivatives (``jax.jvp``, ``jax.hessian``); without known effects.

    Raises:
        UsageError: a forward-mode or second derivative without ``by_steps``. If a ``jax.jit`` in between hides its
            origin, the error is JAX's own.
    """
    if by_steps:
        _, nats = pipeline.scan_steps(params, pipeline.init(params, samples), samples, options, _increments)
        return jnp.sum(counted(samples.dt, burn_in) * sum(nats))
    try:
        return log_likelihood_parts(params, samples, options, burn_in).total
    except (TypeError, ValueError, AssertionError) as error:
        if not str(error).startswith(JAX_SAYS) and error.args:
            raise
        message = "has a hand-written reverse pass, which goes neither forwards (jvp, jacfwd) nor twice (hessian)"
        raise UsageError(message, field="log_likelihood", remedy="use jax.grad, or by_steps=True") from error


def log_likelihood_parts(
    params: Params, samples: Sample, options: Options = DEFAULT_OPTIONS, burn_in: float | Array = 0.0
) -> LogLikelihood:
    """Log-likelihood, () nats each, split into joints and wrench; arguments as for ``log_likelihood``."""
    weight, start = counted(samples.dt, burn_in), pipeline.init(params, samples)
    if on_cpu() and len(weight):
        return LogLikelihood(*log_likelihoods(params, start, samples, weight, options))
    _, (joint, wrench) = pipeline.run(params, start, samples, options, _increments)
    return LogLikelihood((weight * joint).sum(), (weight * wrench).sum())


def joint_log_likelihood(
    params: Params, samples: Sample, options: Options = DEFAULT_OPTIONS, burn_in: float | Array = 0.0
) -> Float[Array, ""]:
    """Log-likelihood of the joint measurements alone, () nats; arguments as for ``log_likelihood``."""
    inputs = stages.joint_inputs(params.joint, pipeline.init(params, samples).joint, samples)
    return filter_sums(JOINT_MODELS[options.joint_model], False, inputs, counted(samples.dt, burn_in)).nats.sum()


@partial(jax.jit, static_argnames="options")
def wrench_given_joints(
    params: Params, samples: Sample, options: Options = DEFAULT_OPTIONS, burn_in: float | Array = 0.0
) -> Float[Array, ""]:
    """Log-likelihood, () nats, of the wrench given all joint measurements, past and future (smoothed joints).

    Together with ``joint_log_likelihood`` it is the density of the whole log, p(joints) p(wrench | joints), whereas
    ``log_likelihood`` conditions the wrench on the joints' past, as a filter must. Arguments as for ``log_likelihood``.
    """
    start = pipeline.init(params, samples)
    joints = smooth_joint_tracks(params, start, samples, options)
    wrench_tool, variance = stages.predict_wrenches(params, joints, samples, options)
    inputs = stages.bias_inputs(params, start, samples, wrench_tool, variance, joints.mean[:, 1])
    return filter_sums(bias_model(inputs.density), False, inputs, counted(samples.dt, burn_in)).nats.sum()


def nats_in_pieces(
    model: ProcessModel, inputs: Inputs, weight: Float[Array, " T"], length: Array
) -> Float[Array, " B"]:
    """Log-likelihoods (B,), nats, of ``filter_sums``; padding after ``length`` samples takes no time."""

    def add(state: tuple[Array, Array, Array], piece: Any) -> tuple[tuple[Array, Array, Array], None]:
        nats, mean, covariance = state
        dt, y, variance, drive, weight = piece
        here = Inputs(dt, inputs.density, y, variance, mean, covariance, inputs.restart_variance, drive)
        found = filter_sums(model, False, here, weight)
        return (nats + found.nats, found.mean, found.covariance), None

    log = (inputs.dt, inputs.y, inputs.variance, inputs.drive, weight)
    start = (jnp.zeros_like(inputs.mean[0]), inputs.mean, inputs.covariance)
    return over_pieces(add, start, log, length)[0][0]


def measured_length(samples: Sample, xp: Any = jnp) -> Any:
    """Number () of samples up to the last that is not padding (dt = 0 s and all NaN), for the longest of (..., T)."""
    there = xp.asarray(samples.dt) != 0
    for x in (samples.q, samples.dq, samples.wrench):
        there = there if x is None else there | xp.isfinite(x).any(-1)
    return xp.max(xp.where(there, xp.arange(1, there.shape[-1] + 1), 0))


def counted(dt: Float[Array, " T"], burn_in: float | Array) -> Float[Array, " T"]:
    """Weights (T,): 1 for samples after the burn-in, in s, 0 before; dt (T,) s."""
    return (jnp.cumsum(dt) >= burn_in).astype(dt.dtype)


def _increments(state: State, info: Info) -> tuple[Array, Array]:
    return info.joint.log_likelihood.sum(), info.wrench.log_likelihood


class WrenchProblem(NamedTuple):
    """The bias filter of one log with all earlier stages computed: what a fit of the wrench model needs."""

    dt: Float[Array, " T"]
    """(T,) s."""
    wrench: Float[Array, "T 6"]
    """(T, 6) N, Nm: reading plus the bias expected a priori, so that the rest starts at zero; NaN = not measured."""
    variance: Float[Array, "T 6"]
    """(T, 6) N^2, Nm^2: diagonal of R."""
    density: Float[Array, " 6"]
    """(6,) sigma_Q."""
    prior_std: Float[Array, " 12"]
    """(12,) square root of P_0, bias then drift."""
    jump: Float[Array, "T 6"] | None = None
    """(T, 6) N^2, Nm^2: variance of a jump of the bias at each sample (``bias_filter.jumps``); None = never."""


def bias_recursion(problem: WrenchProblem, y: Float[Array, "T 6"]) -> Inputs:
    """Inputs of the bias filter for measurements y (T, 6) N, Nm of the bias, started at its prior with mean zero."""
    y = jnp.where(jnp.isfinite(problem.wrench), y, jnp.nan)
    std = problem.prior_std.reshape(2, 6)
    zero = jnp.zeros_like(std[0])
    covariance = jnp.stack([jnp.stack([std[0] ** 2, zero]), jnp.stack([zero, std[1] ** 2])])
    never = jnp.full_like(std, jnp.inf)
    variance = problem.variance[:, None]
    common = (y[:, None], variance, jnp.zeros_like(std), covariance, never)
    if problem.jump is None:
        return Inputs(problem.dt, problem.density, *common)
    density = BiasStrength(problem.density, jnp.zeros_like(problem.density))
    return Inputs(problem.dt, density, *common, {"jump": problem.jump})


@jax.jit
def whiten(problem: WrenchProblem, columns: Float[Array, "C T 6"]) -> Float[Array, "C T 6"]:
    """Innovations of the bias filter, in units of their standard deviation, for each of many series.

    The filter is linear, so the innovations of D theta - W are those of the columns of D times theta minus those of W:
    least squares on whitened columns maximises the exact likelihood with bias and drift as nuisance parameters.

    Args:
        problem: the bias filter.
        columns: (C, T, 6) N, Nm, sensor frame.

    Returns:
        whitened series (C, T, 6), 0 where the wrench was not measured.
    """

    def white(y: Array) -> Array:
        inputs = bias_recursion(problem, y)
        innovation, variance = innovations(bias_model(inputs.density), inputs)
        return innovation[:, 0] / jnp.sqrt(variance[:, 0])

    # The map is linear, so its value equals its derivative, and the gains, which all series share, are computed once.
    return jax.vmap(lambda column: jax.jvp(white, (jnp.zeros_like(column),), (column,))[1])(columns)


@partial(jax.jit, static_argnames="options")
def wrench_problem(
    params: Params, samples: Sample, joints: Gaussian, options: Options = DEFAULT_OPTIONS
) -> tuple[WrenchProblem, Float[Array, "T 6"]]:
    """Compute everything that precedes the bias filter, so that it stays fixed.

    Args:
        params: robot, tool and noise as stated or fitted.
        samples: the log, leaves (T, ...).
        joints: states (T, n, 3) with covariance (T, n, 3, 3), filtered (``stages.joint_states``) or smoothed
            (``smoother.smooth_joints``).
        options: as for ``pipeline.run``.

    Returns:
        the bias filter's inputs, and the wrench of the tool D theta (T, 6) N, Nm for these parameters.
    """
    wrench_tool, variance = stages.predict_wrenches(params, joints, samples, options)
    bias = params.bias
    wrench = without_bias(samples.wrench, bias.prior_mean, jnp.cumsum(samples.dt))
    jump = bias_filter.jumps(params, samples.rezeroed)
    return WrenchProblem(samples.dt, wrench, variance, bias.density, bias.prior_std, jump), wrench_tool


def without_bias(
    wrench: Float[Array, "T 6"], expected: Float[Array, " 12"], t: Float[Array, " T"]
) -> Float[Array, "T 6"]:
    """Readings (T, 6) at times t (T,) s, corrected by the expected bias and drift, (12,) at t = 0."""
    return jax.vmap(unbias, (0, None, 0))(wrench, expected, t)
