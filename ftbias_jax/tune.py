"""Noise parameters of maximum likelihood, from one log or many.

The joints' noise is fitted to the joints' likelihood; then the noise of bias and sensor to the wrench's likelihood
given those joints. The parameters are logarithms, so they need no bounds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax import newton, pipeline, staged
from ftbias_jax.likelihood import counted
from ftbias_jax.noise import JOINT_MODELS, drift_noise
from ftbias_jax.pipeline import DEFAULT_OPTIONS, Options, Params
from ftbias_jax.recursion import Inputs, filter_scan
from ftbias_jax.types import Array, Sample

Report = Callable[[int, float], None]

PIECE = 8192
"""Joint filters forget within a fraction of a second, so their logs are cut into pieces that run side by side."""

JOINT_NAMES = ("process_density", "position_std", "velocity_std")
WRENCH_NAMES = ("density", "wrench_std")
TIES: dict[str, Callable[[int], np.ndarray]] = {
    "one": lambda size: np.zeros(size, int),
    "pair": lambda size: np.arange(size) * 2 // size,
    "each": lambda size: np.arange(size),
}
"""Which lanes share a value: all, the forces and the torques, or none."""


class Fit(NamedTuple):
    """A fitted set of noise parameters; arrays over the lanes (joints or axes) by name."""

    values: dict[str, np.ndarray]
    relative_stderr: dict[str, np.ndarray]
    """Standard errors relative to the values."""
    undetermined: list[str]
    """Combinations the data leave open, in words."""
    optimum: newton.Optimum


def tune_joints(
    params: Params,
    logs: Sequence[Sample],
    ties: dict[str, str],
    options: Options = DEFAULT_OPTIONS,
    burn_in: float = 0.2,
    report: Report = lambda iteration, value: None,
) -> tuple[Params, Fit]:
    """Fit the noise of the joint filter.

    Args:
        params: what is not fitted, and where to start. logs: samples of one robot.
        ties: key of TIES for each of JOINT_NAMES that is to be fitted. options: of the pipeline.
        burn_in: s that do not count at the start of every piece. report: told (iteration, nats).

    Returns:
        params with the fitted noise, and the fit.
    """
    pieces = stack([piece for log in logs for piece in _cut(log)])
    states = jax.jit(jax.vmap(partial(pipeline.init, params)))(pieces)

    def score(logs_of: Array) -> Array:
        noise = params.joint._replace(**dict(zip(ties, jnp.exp(logs_of), strict=True)))

        def one(state: pipeline.State, samples: Sample) -> Array:
            inputs = staged.joint_inputs(params._replace(joint=noise), state, samples)
            track = filter_scan(JOINT_MODELS[options.joint_model], inputs)
            return counted(samples.dt, burn_in) @ track.log_likelihood

        return jax.vmap(one)(states, pieces).sum(0)

    start = {name: getattr(params.joint, name) for name in ties}
    fit = _fit(score, start, ties, report)
    return params._replace(joint=params.joint._replace(**_arrays(fit, params))), fit


def tune_wrench(
    params: Params,
    logs: Sequence[Sample],
    ties: dict[str, str],
    options: Options = DEFAULT_OPTIONS,
    burn_in: float = 1.0,
    report: Report = lambda iteration, value: None,
) -> tuple[Params, Fit]:
    """Fit the noise of bias and sensor, with the joints' noise as it stands.

    Args:
        ties: key of TIES for each of WRENCH_NAMES that is to be fitted: density is sigma_Q, wrench_std the square root
            of the diagonal of Sigma_W. The others: as for ``tune_joints``.
    """
    stacked = stack(logs)
    inputs, joint_variance = jax.jit(jax.vmap(partial(_bias_problem, params, options=options)))(stacked)

    def score(logs_of: Array) -> Array:
        noise = dict(zip(ties, jnp.exp(logs_of), strict=True))
        density = noise.get("density", params.bias.density)
        variance = noise["wrench_std"] ** 2 if "wrench_std" in noise else params.bias.wrench_variance

        def one(inputs: Inputs, joint_variance: Array) -> Array:
            inputs = inputs._replace(density=density, variance=(joint_variance + variance[None])[:, None])
            return counted(inputs.dt, burn_in) @ filter_scan(drift_noise, inputs).log_likelihood

        return jax.vmap(one)(inputs, joint_variance).sum(0)

    everything = {"density": params.bias.density, "wrench_std": jnp.sqrt(params.bias.wrench_variance)}
    fit = _fit(score, {name: everything[name] for name in ties}, ties, report)
    found = _arrays(fit, params)
    bias = params.bias._replace(density=found.get("density", params.bias.density))
    if "wrench_std" in found:
        bias = bias._replace(wrench_variance=found["wrench_std"] ** 2)
    return params._replace(bias=bias), fit


def stack(logs: Sequence[Sample]) -> Sample:
    """Logs of unequal length as one bundle with a leading log axis, padded by samples that change nothing."""
    length = max(log.dt.shape[0] for log in logs)
    bundle = []
    for name, leaves in zip(Sample._fields, zip(*logs, strict=True), strict=True):
        if leaves[0] is None:
            continue
        # numpy, for every new shape would cost JAX a compilation
        filled = np.full((len(logs), length, *leaves[0].shape[1:]), 0.0 if name == "dt" else np.nan, leaves[0].dtype)
        for row, leaf in zip(filled, leaves, strict=True):
            row[: len(leaf)] = leaf
        bundle.append(jnp.asarray(filled))
    return Sample(*bundle)


def _cut(log: Sample) -> list[Sample]:
    """Pieces of at most PIECE samples, each starting as a log of its own."""
    whole = Sample(*(np.asarray(x) for x in log[:4]))  # joints do not feel the temperature
    starts = range(0, len(whole.dt), PIECE)
    pieces = [Sample(*(x[start : start + PIECE] for x in whole[:4])) for start in starts]
    return [piece._replace(dt=np.concatenate([[0], piece.dt[1:]])) for piece in pieces]


@partial(jax.jit, static_argnames="options")
def _bias_problem(params: Params, samples: Sample, options: Options) -> tuple[Inputs, Array]:
    """The bias filter's inputs for given joints, and the joints' share (T, 6) of the variance."""
    state = pipeline.init(params, samples)
    joint = filter_scan(JOINT_MODELS[options.joint_model], staged.joint_inputs(params, state, samples))
    wrench_tool, variance = staged.predict_wrenches(params, staged.joint_states(joint), samples, options)
    inputs = staged.bias_inputs(params, state, samples, wrench_tool, variance)
    return inputs, variance - params.bias.wrench_variance[None]


def _fit(score: newton.LaneScore, start: dict[str, Array], ties: dict[str, str], report: Report) -> Fit:
    """Free values are the geometric means of what they tie together."""
    index: list[np.ndarray] = []
    logs: list[float] = []
    names: list[str] = []
    for name, value in start.items():
        group = TIES[ties[name]](len(value))
        index.append(group + len(names))
        logs += [np.log(np.asarray(value))[group == g].mean() for g in range(group.max() + 1)]
        names += [f"{name}[{g}]" for g in range(group.max() + 1)]
    optimum = newton.maximise(score, np.array(logs), np.array(index), report)
    values = {name: np.exp(optimum.logs[row]) for name, row in zip(start, index, strict=True)}
    stderr = {name: optimum.stderr[row] for name, row in zip(start, index, strict=True)}
    return Fit(values, stderr, newton.undetermined(optimum.information, names), optimum)


def _arrays(fit: Fit, params: Params) -> dict[str, Array]:
    return {name: jnp.asarray(value, params.theta.dtype) for name, value in fit.values.items()}
