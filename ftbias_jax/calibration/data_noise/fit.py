"""Sigma_D of maximum likelihood, with sigma_Q and Sigma_W, from logs of one tool or several.

R = Sigma_W + B Sigma_D B^T is diagonal and constant for a tool, so the logs of one tool determine six variances and no
more (errata 11): what of them is noise of the sensor and what noise of the motion, they leave open. B is made of the
tool's parameters, so every further tool gives six sums with other weights. The fit says which numbers stay open
(``Fit.undetermined``) and writes the sums that are determined (``Fit.determined``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.calibration import newton
from ftbias_jax.calibration.batching import stack
from ftbias_jax.calibration.data_noise import gradient
from ftbias_jax.calibration.data_noise.values import (
    KINDS,
    LANES,
    constrain,
    power,
    starting_values,
    total_variance,
    with_noise,
    without_data_noise,
)
from ftbias_jax.calibration.data_noise.words import DeterminedSums, labels, sentences
from ftbias_jax.calibration.newton import Report
from ftbias_jax.calibration.tune import RESTART_SPREAD, TIES, Fit, WrenchLogs, smoothed_wrenches
from ftbias_jax.filtering import pipeline
from ftbias_jax.filtering.fast import stages
from ftbias_jax.filtering.fast.scan import filter_scan
from ftbias_jax.filtering.likelihood import counted
from ftbias_jax.filtering.pipeline import DEFAULT_OPTIONS, Options
from ftbias_jax.filtering.process_models import drift_noise
from ftbias_jax.model.params import Params
from ftbias_jax.model.wrench.data_noise import DataNoise, data_variance
from ftbias_jax.types import Array, Sample

DISTINCT = 3.0
"""A variance of fewer standard errors than this is not distinguishable from zero."""
SMALL_REST = 1e-6
"""Relative: a sum of variances of which less is left over is a combination of what the logs show."""


class Tool(NamedTuple):
    """Logs of one tool."""

    params: Params
    """Tool and prior of the bias; everything else is that of the other tools."""
    logs: Sequence[Sample]


@dataclass(frozen=True)
class DataScore:
    """Log-likelihood of the wrench given the joints; a gradient.Score whose parts are (params, one log)."""

    index: tuple[tuple[str, tuple[int, ...]], ...]
    """For each fitted name which free value each lane has."""
    burn_in: float
    """s at the start of every log that do not count."""

    def __call__(self, logs: Array, part: tuple[Params, WrenchLogs]) -> Array:
        """(P,) logarithms -> () nats."""
        params, whole = part
        params = constrain(params, {name: logs[jnp.array(lanes)] for name, lanes in self.index})
        log: WrenchLogs = jax.tree.map(lambda x: x[0], whole)
        variance = log.joint_variance + total_variance(params)[None]
        start = pipeline.init(params, log.samples)
        inputs = stages.bias_inputs(params, start, log.samples, log.wrench_tool, variance)
        return (counted(log.samples.dt, self.burn_in) @ filter_scan(drift_noise, inputs).log_likelihood).sum()


def tune_data(
    tools: Sequence[Tool],
    ties: dict[str, str],
    stated: dict[str, Array] | None = None,
    options: Options = DEFAULT_OPTIONS,
    burn_in: float = 1.0,
    restarts: int = 0,
    report: Report = newton.quiet,
) -> tuple[list[Params], Fit]:
    """Fit Sigma_D, and what else of the noise of bias and sensor is asked for, to the logs of all tools at once.

    Args:
        tools: at least one; their noise is common, the values of the first one are where to start.
        ties: one of KINDS, and keys of tune.TIES for those of values.WRENCH_NAMES that are to be fitted with it.
        stated: where to start, by name; what is absent or zero starts at a share of the sensor's variance.
        options: of the pipeline.
        burn_in: s that do not count at the start of every log.
        restarts: further starts, each value off by a random factor.
        report: called with (iteration, nats).

    Returns:
        the parameters of every tool with the fitted noise, and the fit.
    """
    clean = [without_data_noise(tool.params) for tool in tools]
    longest = max(len(log.dt) for tool in tools for log in tool.logs)
    parts = []
    for params, tool in zip(clean, tools, strict=True):
        samples = [stack([log], longest) for log in tool.logs]
        wrenches = newton.for_each(partial(smoothed_wrenches, params, options=options), samples)
        parts += [(params, WrenchLogs(log, *wrench)) for log, wrench in zip(samples, wrenches, strict=True)]
    return fit_data(clean, parts, ties, stated, burn_in, restarts, report)


def fit_data(
    tools: Sequence[Params],
    parts: Sequence[tuple[Params, WrenchLogs]],
    ties: dict[str, str],
    stated: dict[str, Array] | None = None,
    burn_in: float = 1.0,
    restarts: int = 0,
    report: Report = newton.quiet,
) -> tuple[list[Params], Fit]:
    """``tune_data`` for joints that are already smoothed, or known; a part is one log with a leading axis of 1."""
    kinds, found = list(KINDS), dict(stated or {})
    others = {name: tie for name, tie in ties.items() if name not in LANES}
    wanted = kinds.index("entries" if "entries" in ties else _kind_of(ties))
    known = all(np.all(found.get(name, 0.0)) for name in KINDS[kinds[wanted]])
    # Many numbers have local optima: fewer numbers lead the way, unless it is said where to start.
    for kind in kinds[wanted if known else 0 : wanted + 1]:
        fit = _fit(tools, parts, KINDS[kind] | others, found, burn_in, restarts, report)
        found = dict(fit.values)
        if kind != "entries":
            noise = DataNoise(*(jnp.asarray(found[name]) for name in DataNoise._fields))
            found["entries"] = np.sqrt(data_variance(noise, tools[0].gravity))
    dtype = tools[0].theta.dtype
    noise_of_all = {name: jnp.asarray(value, dtype) for name, value in fit.values.items()}
    return [with_noise(params, noise_of_all) for params in tools], fit


def _kind_of(ties: dict[str, str]) -> str:
    return "one" if ties[DataNoise._fields[0]] == "one" else "three"


def _fit(
    tools: Sequence[Params],
    parts: Sequence[tuple[Params, WrenchLogs]],
    ties: dict[str, str],
    known: dict[str, Array],
    burn_in: float,
    restarts: int,
    report: Report,
) -> Fit:
    """One of KINDS, from where its numbers are known to be about, or are noticed."""
    start = starting_values(tools, ties, known)
    index = _index(ties, start)
    names = [label for name, lanes in index.items() for label in labels(name, lanes - lanes.min())]
    logs = np.zeros(len(names))
    for name, lanes in index.items():
        for lane in set(lanes):
            logs[lane] = np.log(start[name])[lanes == lane].mean()
    spread = np.random.default_rng(0).normal(scale=RESTART_SPREAD, size=(restarts, len(logs)))
    starts = logs + np.concatenate([np.zeros((1, len(logs))), spread])
    score = DataScore(tuple((name, tuple(map(int, lanes))) for name, lanes in index.items()), burn_in)
    optimum = gradient.maximise(score, parts, starts, report)
    values = {name: np.exp(optimum.logs[lanes]) for name, lanes in index.items()}
    scale, information = _judged(index, optimum)
    stderr = {name: (newton.standard_errors(information) / scale)[lanes] for name, lanes in index.items()}
    undetermined = gradient.open_directions(information, names)
    groups = {name: lanes - lanes.min() for name, lanes in index.items() if name in LANES}
    sums = sentences(tools, groups, _sums(tools, index, optimum)) if undetermined else ()
    return Fit(values, stderr, undetermined, optimum, sums)


def _judged(index: dict[str, np.ndarray], optimum: newton.Optimum) -> tuple[np.ndarray, np.ndarray]:
    """Scales (P,) of the logarithms, and the information (P, P) of the logarithms times their scales.

    So scaled, a variance of DISTINCT standard errors has an error of 1. The drift is judged as in tune.py.
    """
    scale = np.ones(len(optimum.logs))
    for name, lanes in index.items():
        if name != "density":
            scale[lanes] = DISTINCT * power(name)
    return scale, optimum.information / np.outer(scale, scale)


def _index(ties: dict[str, str], start: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Which free value each lane of each parameter has."""
    index: dict[str, np.ndarray] = {}
    count = 0
    for name, value in start.items():
        index[name] = TIES[ties[name]](len(value)) + count
        count = int(index[name].max()) + 1
    return index


def _sums(tools: Sequence[Params], index: dict[str, np.ndarray], optimum: newton.Optimum) -> DeterminedSums:
    """What the fitted noise adds up to, with relative standard errors."""

    def sums(logs: Array) -> tuple[Array, Array]:
        noise = {name: jnp.exp(logs[lanes]) for name, lanes in index.items()}
        totals = jnp.stack([total_variance(with_noise(params, noise)) for params in tools])
        if "entries" in noise:
            return totals, jnp.zeros(0)
        gravity = tools[0].gravity
        return totals, noise["linear_acceleration"] ** 2 + gravity @ gravity * noise["gravity_direction"] ** 2

    logs = jnp.asarray(optimum.logs)
    values = [np.asarray(x) for x in sums(logs)]
    slopes = [np.asarray(x) for x in jax.jacfwd(sums)(logs)]
    scale, information = _judged(index, optimum)
    errors = [
        gradient.combination_errors(information, slope / (2 * value[..., None]) / scale)
        for value, slope in zip(values, slopes, strict=True)
    ]
    # R is seen, so its diagonal is determined; a - g is where it is a combination of diagonals.
    totals, force = slopes[0].reshape(-1, len(logs)), slopes[1]
    left_over = force - (force @ np.linalg.pinv(totals, rcond=1e-10)) @ totals
    known = np.abs(left_over).max(-1, initial=0) < SMALL_REST * np.abs(force).max(-1, initial=0)
    return DeterminedSums(values[0], errors[0], values[1], np.where(known, errors[1], np.inf))
