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

from ftbias_jax.calibration import gradient, newton
from ftbias_jax.calibration.batching import stack
from ftbias_jax.calibration.data_noise_words import DeterminedSums, labels, sentences
from ftbias_jax.calibration.newton import Report
from ftbias_jax.calibration.tune import RESTART_SPREAD, TIES, Fit, WrenchLogs, smoothed_wrenches, with_wrench_noise
from ftbias_jax.filtering import pipeline
from ftbias_jax.filtering.fast import stages
from ftbias_jax.filtering.fast.scan import filter_scan
from ftbias_jax.filtering.likelihood import counted
from ftbias_jax.filtering.pipeline import DEFAULT_OPTIONS, Options
from ftbias_jax.filtering.process_models import drift_noise
from ftbias_jax.model.params import Params
from ftbias_jax.model.wrench.data_noise import DataNoise, data_variance
from ftbias_jax.model.wrench.tool_wrench import measurement_covariance
from ftbias_jax.types import Array, Sample

KINDS: dict[str, dict[str, str]] = {
    "one": dict.fromkeys(DataNoise._fields, "one"),
    "three": dict.fromkeys(DataNoise._fields, "each"),
    "entries": {"entries": "each"},
}
"""What can be fitted of Sigma_D, as names and their ties: four numbers, four for each axis, or every entry."""
LANES = dict.fromkeys(DataNoise._fields, 3) | {"entries": 36}
START_SHARE = {"angular_velocity": 0.01}
"""Of the sensor's variance: what an unstated part of Sigma_D starts at, on the axis where it matters most; others than
these START_SHARE_OF_OTHERS. Zero has no logarithm, and far below the sensor's noise the likelihood is flat. A rate must
be off by about 1 rad/s to be noticed: started higher, it would take what belongs to the accelerations."""
START_SHARE_OF_OTHERS = 0.5


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
        params = with_noise(params, {name: jnp.exp(logs[jnp.array(lanes)]) for name, lanes in self.index})
        log: WrenchLogs = jax.tree.map(lambda x: x[0], whole)
        variance = log.joint_variance + _total_variance(params)[None]
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
        ties: one of KINDS, and keys of tune.TIES for those of tune.WRENCH_NAMES that are to be fitted with it.
        stated: where to start, by name; what is absent or zero starts at a share of the sensor's variance.
        options: of the pipeline.
        burn_in: s that do not count at the start of every log.
        restarts: further starts, each value off by a random factor.
        report: told (iteration, nats).

    Returns:
        the parameters of every tool with the fitted noise, and the fit.
    """
    clean = [_without_data_noise(tool.params) for tool in tools]
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
    stderr = {name: optimum.stderr[lanes] for name, lanes in index.items()}
    undetermined = gradient.open_directions(optimum.information, names)
    groups = {name: lanes - lanes.min() for name, lanes in index.items() if name in LANES}
    sums = sentences(tools, groups, _sums(tools, index, optimum)) if undetermined else ()
    return Fit(values, stderr, undetermined, optimum, sums)


def starting_values(tools: Sequence[Params], ties: dict[str, str], known: dict[str, Array]) -> dict[str, np.ndarray]:
    """Where to start, by name: what is known, else the noise of the first tool, else what is noticed."""
    bias = tools[0].bias
    start = {"density": np.asarray(bias.density), "wrench_std": np.sqrt(np.asarray(bias.wrench_variance))} | known
    for name in ties.keys() & LANES.keys():
        value = np.broadcast_to(np.asarray(known.get(name, 0.0), float), (LANES[name],))
        start[name] = np.where(value > 0, value, _noticed(name, tools))
    return {name: np.asarray(start[name]) for name in ties}


def with_noise(params: Params, noise: dict[str, Array]) -> Params:
    """Parameters with values for some of tune.WRENCH_NAMES, and for all of one kind of Sigma_D."""
    params = with_wrench_noise(params, noise)
    if "entries" in noise:
        variance = noise["entries"] ** 2
    elif noise.keys() >= set(DataNoise._fields):
        variance = data_variance(DataNoise(*(noise[name] for name in DataNoise._fields)), params.gravity)
    else:
        variance = params.bias.data_variance
    return params._replace(bias=params.bias._replace(data_variance=variance))


def _without_data_noise(params: Params) -> Params:
    return params._replace(bias=params.bias._replace(data_variance=None))


def _noticed(name: str, tools: Sequence[Params]) -> float:
    """The value that adds a share of the sensor's variance, on the axis of all tools where it matters most."""
    if name == "entries":
        noise = {name: jnp.ones(36)}
    else:
        noise = {field: jnp.full(3, float(field == name)) for field in DataNoise._fields}
    added = [_total_variance(with_noise(params, noise)) / params.bias.wrench_variance - 1 for params in tools]
    most, share = float(np.max(added)), START_SHARE.get(name, START_SHARE_OF_OTHERS)
    return (share / most) ** (1 / (4 if name == "angular_velocity" else 2)) if most > 0 else 1.0


def _index(ties: dict[str, str], start: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Which free value each lane of each parameter has."""
    index: dict[str, np.ndarray] = {}
    count = 0
    for name, value in start.items():
        index[name] = TIES[ties[name]](len(value)) + count
        count = int(index[name].max()) + 1
    return index


def _total_variance(params: Params) -> Array:
    """(6,) diagonal of R."""
    bias = params.bias
    return jnp.diagonal(measurement_covariance(params.theta, bias.data_variance, bias.wrench_variance))


def _sums(tools: Sequence[Params], index: dict[str, np.ndarray], optimum: newton.Optimum) -> DeterminedSums:
    """What the fitted noise adds up to, with relative standard errors."""

    def sums(logs: Array) -> tuple[Array, Array]:
        noise = {name: jnp.exp(logs[lanes]) for name, lanes in index.items()}
        totals = jnp.stack([_total_variance(with_noise(params, noise)) for params in tools])
        if "entries" in noise:
            return totals, jnp.zeros(0)
        gravity = tools[0].gravity
        return totals, noise["linear_acceleration"] ** 2 + gravity @ gravity * noise["gravity_direction"] ** 2

    logs = jnp.asarray(optimum.logs)
    values = [np.asarray(x) for x in sums(logs)]
    slopes = [np.asarray(x) for x in jax.jacfwd(sums)(logs)]
    errors = [
        gradient.combination_errors(optimum.information, slope / (2 * value[..., None]))
        for value, slope in zip(values, slopes, strict=True)
    ]
    return DeterminedSums(values[0], errors[0], values[1], errors[1])
