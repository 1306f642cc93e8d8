"""Noise parameters of maximum likelihood, from one log or many.

The joints' noise is fitted to the joints' likelihood; then the noise of bias and sensor to the likelihood of the wrench
given all joint measurements, past and future. That is the density of the whole log, p(joints) p(wrench | joints). Given
the past only, the lag of the joint filter stays in the wrench, moves slowly, and is taken for drift: sigma_Q comes out
up to 58 % too large (experiments/tuning). Parameters are logarithms: they need no bounds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.calibration import newton
from ftbias_jax.calibration.batching import cut, equal_parts, stack
from ftbias_jax.calibration.data_noise.values import constrain, with_noise
from ftbias_jax.calibration.newton import Report
from ftbias_jax.filtering import pipeline
from ftbias_jax.filtering.fast import stages
from ftbias_jax.filtering.likelihood import counted, measured_length, nats_in_pieces
from ftbias_jax.filtering.pipeline import DEFAULT_OPTIONS, Options
from ftbias_jax.filtering.process_models import JOINT_MODELS, bias_model
from ftbias_jax.filtering.smoother import smooth_joints
from ftbias_jax.model.params import Params
from ftbias_jax.types import Array, Sample

PIECE = 4096
"""Joint filters forget within a fraction of a second, so their logs are cut into pieces that run side by side."""
PIECES_AT_ONCE = 4
"""Or logs: few, because work on them takes the time of the longest."""
SAMPLES_AT_ONCE = 1 << 18
"""Of whole logs side by side. Both bound the memory."""
RESTART_SPREAD = np.log(10.0)
TIES: dict[str, Callable[[int], np.ndarray]] = {
    "one": lambda size: np.zeros(size, int),
    "pair": lambda size: np.arange(size) * 2 // size,
    "each": lambda size: np.arange(size),
}
"""Which lanes share a value: all, the forces and the torques, or none."""
JOINT_BURN_IN, WRENCH_BURN_IN = 0.2, 1.0
"""s that do not count at the start of every piece, and of every log: the prior shows there."""


class Fit(NamedTuple):
    """A fitted set of noise parameters and their standard errors; arrays over the lanes (joints or axes) by name."""

    values: dict[str, np.ndarray]
    relative_stderr: dict[str, np.ndarray]
    undetermined: list[str]
    """Combinations the data leave open, in words."""
    optimum: newton.Optimum
    determined: tuple[str, ...] = ()
    """Sums that the data do determine where they leave parts of them open, in words."""


@dataclass(frozen=True)
class JointScore:
    """Log-likelihood of joint measurements, by joint; a newton.LaneScore whose parts are (params, pieces of logs)."""

    names: tuple[str, ...]
    """Of JOINT_NAMES, in the order of the argument."""
    model: str
    burn_in: float
    """s at the start of every piece that do not count."""

    def __call__(self, logs: Array, part: tuple[Params, Sample]) -> Array:
        """(K, n) logarithms -> (n,) nats."""
        params, pieces = part
        moved, length = constrain(params, dict(zip(self.names, logs, strict=True))), measured_length(pieces)

        def one(samples: Sample) -> Array:
            inputs = stages.joint_inputs(moved, pipeline.init(params, samples), samples)
            return nats_in_pieces(JOINT_MODELS[self.model], inputs, counted(samples.dt, self.burn_in), length)

        return jax.vmap(one)(pieces).sum(0)


class WrenchLogs(NamedTuple):
    """What is left of logs for the bias filter, once their joints are smoothed; leading axis of logs."""

    samples: Sample
    wrench_tool: Array
    """(L, T, 6) of the smoothed joints."""
    joint_variance: Array
    """(L, T, 6) the joints' share of the variance."""


@dataclass(frozen=True)
class WrenchScore:
    """Log-likelihood of the wrench given joints, by axis; a newton.LaneScore whose parts are (params, WrenchLogs)."""

    names: tuple[str, ...]
    """Of WRENCH_NAMES, in the order of the argument."""
    burn_in: float
    """s at the start of every log that do not count."""

    def __call__(self, logs: Array, part: tuple[Params, WrenchLogs]) -> Array:
        """(K, 6) logarithms -> (6,) nats."""
        params, whole = part
        params = constrain(params, dict(zip(self.names, logs, strict=True)))
        length = measured_length(whole.samples)

        def one(log: WrenchLogs) -> Array:
            variance = log.joint_variance + params.bias.wrench_variance[None]
            start = pipeline.init(params, log.samples)
            inputs = stages.bias_inputs(params, start, log.samples, log.wrench_tool, variance)
            weight = counted(log.samples.dt, self.burn_in)
            return nats_in_pieces(bias_model(inputs.density), inputs, weight, length)

        return jax.vmap(one)(whole).sum(0)


def tune_joints(
    params: Params,
    logs: Sequence[Sample],
    ties: dict[str, str],
    options: Options = DEFAULT_OPTIONS,
    restarts: int = 0,
    report: Report = newton.quiet,
    total: newton.Total = newton.alone,
) -> tuple[Params, Fit]:
    """Fit the noise of the joint filter.

    Args:
        params: what is not fitted, and where to start.
        logs: samples of one robot.
        ties: key of TIES for each of JOINT_NAMES that is to be fitted.
        options: of the pipeline.
        restarts: further starts, each value off by a random factor (10 or 1/10 is usual); Fit.optimum tells how many
            agree.
        report: called with (iteration, nats).
        total: adds up the processes that tune together, see ``newton.maximise``.

    Returns:
        params with the fitted noise, and the fit.
    """
    pieces = [piece for log in logs for piece in cut(log, PIECE)]
    longest = max(len(piece.dt) for piece in pieces)
    parts = [(params, stack(part, longest)) for part in equal_parts(pieces, PIECES_AT_ONCE)]
    start = {name: getattr(params.joint, name) for name in ties}
    fit = _fit(JointScore(tuple(ties), options.joint_model, JOINT_BURN_IN), parts, start, ties, restarts, report, total)
    return with_noise(params, _arrays(fit, params)), fit


def tune_wrench(
    params: Params,
    logs: Sequence[Sample],
    ties: dict[str, str],
    options: Options = DEFAULT_OPTIONS,
    restarts: int = 0,
    report: Report = newton.quiet,
    total: newton.Total = newton.alone,
) -> tuple[Params, Fit]:
    """Fit the noise of bias and sensor, with the joints' noise as it stands, which should be the likeliest.

    Args:
        params: what is not fitted, and where to start.
        logs: samples of one robot.
        ties: key of TIES for each of WRENCH_NAMES that is to be fitted: density is sigma_Q, wrench_std the square root
            of the diagonal of Sigma_W.
        options: of the pipeline.
        restarts: further starts, as for ``tune_joints``.
        report: called with (iteration, nats).
        total: adds up the processes that tune together, see ``newton.maximise``.

    Returns:
        params with the fitted noise, and the fit.
    """
    longest = max(len(log.dt) for log in logs)
    at_once = max(1, min(PIECES_AT_ONCE, SAMPLES_AT_ONCE // longest))
    samples = [stack(part, longest) for part in equal_parts(list(logs), at_once)]
    wrenches = newton.for_each(partial(smoothed_wrenches, params, options=options), samples)
    parts = [(params, WrenchLogs(part, *wrench)) for part, wrench in zip(samples, wrenches, strict=True)]
    return fit_wrench(params, parts, ties, WRENCH_BURN_IN, restarts, report, total)


def fit_wrench(
    params: Params,
    parts: Sequence[tuple[Params, WrenchLogs]],
    ties: dict[str, str],
    burn_in: float = 1.0,
    restarts: int = 0,
    report: Report = newton.quiet,
    total: newton.Total = newton.alone,
) -> tuple[Params, Fit]:
    """``tune_wrench`` for joints that are already smoothed, or known; parts have arrays of the same shapes."""
    everything = {"density": params.bias.density, "wrench_std": jnp.sqrt(params.bias.wrench_variance)}
    start = {name: everything[name] for name in ties}
    fit = _fit(WrenchScore(tuple(ties), burn_in), parts, start, ties, restarts, report, total)
    return with_noise(params, _arrays(fit, params)), fit


@partial(jax.jit, static_argnames="options")
def smoothed_wrenches(params: Params, logs: Sample, options: Options) -> tuple[Array, Array]:
    """Of logs with a leading axis: D theta (L, T, 6) N, Nm, of the smoothed joints, and the joints' share of R."""

    def one(samples: Sample) -> tuple[Array, Array]:
        joints = smooth_joints(params, pipeline.init(params, samples), samples, options)
        wrench_tool, variance = stages.predict_wrenches(params, joints, samples, options)
        return wrench_tool, variance - params.bias.wrench_variance[None]

    return jax.vmap(one)(logs)


def _fit(
    score: newton.LaneScore,
    parts: Sequence[Any],
    start: dict[str, Array],
    ties: dict[str, str],
    restarts: int,
    report: Report,
    total: newton.Total,
) -> Fit:
    """Free values are the geometric means of what they tie together."""
    index: list[np.ndarray] = []
    logs: list[float] = []
    names: list[str] = []
    for name, value in start.items():
        group = TIES[ties[name]](len(value))
        index.append(group + len(names))
        logs += [np.log(np.asarray(value))[group == g].mean() for g in range(group.max() + 1)]
        names += [f"{name}[{g}]" for g in range(group.max() + 1)]
    spread = np.random.default_rng(0).normal(scale=RESTART_SPREAD, size=(restarts, len(logs)))
    starts = np.array(logs) + np.concatenate([np.zeros((1, len(logs))), spread])
    optimum = newton.maximise(score, parts, starts, np.array(index), report, total)
    values = {name: np.exp(optimum.logs[row]) for name, row in zip(start, index, strict=True)}
    stderr = {name: optimum.stderr[row] for name, row in zip(start, index, strict=True)}
    return Fit(values, stderr, newton.undetermined(optimum.information, names), optimum)


def _arrays(fit: Fit, params: Params) -> dict[str, Array]:
    return {name: jnp.asarray(value, params.theta.dtype) for name, value in fit.values.items()}
