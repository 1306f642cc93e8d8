"""Maximum-likelihood Sigma_D, with sigma_Q and Sigma_W, from the logs of one tool or several.

R = Sigma_W + B Sigma_D B^T is diagonal and constant for a tool, so the logs of one tool determine six variances and no
more (errata 11); they do not separate sensor noise from noise of the motion. B is computed from the tool's parameters,
so every further tool adds six sums with other weights. The fit lists the parameters that stay undetermined
(``Fit.undetermined``) and the sums that are determined (``Fit.determined``).
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.calibration import newton
from ftbias_jax.calibration.newton import FROM_ONE_START, Search
from ftbias_jax.calibration.noise.score import WrenchLogs, smoothed_wrenches
from ftbias_jax.calibration.noise.values import KINDS, LANES, power, starting_values, tied, total_variance, with_noise
from ftbias_jax.calibration.noise.words import DeterminedSums, combination_errors, sentences
from ftbias_jax.calibration.tune import Fit, as_fit, fit_common, stack, with_values
from ftbias_jax.filtering.pipeline import DEFAULT_OPTIONS, Options
from ftbias_jax.model.params import Params
from ftbias_jax.model.wrench.tool_wrench import DataNoise, data_variance
from ftbias_jax.types import Array, Sample

DISTINCT = 3.0
"""A variance smaller than this many of its standard errors is not distinguishable from zero."""
SMALL_REST = 1e-6
"""Relative residual below which a sum of variances counts as a linear combination of those that are determined."""


class Tool(NamedTuple):
    """Logs of one tool."""

    params: Params
    """Parameters with this tool and the prior of its bias; everything else is common to all tools."""
    logs: Sequence[Sample]


def tune_data(
    tools: Sequence[Tool],
    ties: dict[str, str],
    stated: dict[str, Array] | None = None,
    options: Options = DEFAULT_OPTIONS,
    search: Search = FROM_ONE_START,
) -> tuple[list[Params], Fit]:
    """Fit Sigma_D, and any other noise of bias and sensor that is asked for, to the logs of all tools together.

    Args:
        tools: at least one; the tools share their noise, which starts from the values of the first one.
        ties: one of KINDS, and keys of TIES for those of values.WRENCH_NAMES that are to be fitted with it.
        stated: starting values, by name; one that is absent or zero starts at a share of the sensor's variance.
        options: options of the pipeline.
        search: settings of the search for the maximum, by one process.

    Returns:
        the parameters of every tool with the fitted noise, and the fit.
    """
    clean = [tool.params._replace(bias=tool.params.bias._replace(data_variance=None)) for tool in tools]
    longest = max(len(log.dt) for tool in tools for log in tool.logs)
    parts = []
    for params, tool in zip(clean, tools, strict=True):
        logs = newton.for_each(
            partial(smoothed_wrenches, params, options=options), [stack([log], longest) for log in tool.logs]
        )
        parts += [(params, log) for log in logs]
    return fit_data(clean, parts, ties, stated, search)


def fit_data(
    tools: Sequence[Params],
    parts: Sequence[tuple[Params, WrenchLogs]],
    ties: dict[str, str],
    stated: dict[str, Array] | None = None,
    search: Search = FROM_ONE_START,
) -> tuple[list[Params], Fit]:
    """``tune_data`` for joints that are already smoothed or known; a part is one log with a leading axis of 1."""
    kinds, found = list(KINDS), dict(stated or {})
    others = {name: tie for name, tie in ties.items() if name not in LANES}
    wanted = next(i for i, kind in enumerate(KINDS.values()) if kind.items() <= ties.items())
    known = all(np.all(found.get(name, 0.0)) for name in KINDS[kinds[wanted]])
    # Many parameters have local optima: fits of fewer ones give the start, unless starting values are stated.
    for kind in kinds[wanted if known else 0 : wanted + 1]:
        fit = _fit(tools, parts, KINDS[kind] | others, found, search)
        found = dict(fit.values)
        if kind != "entries":
            noise = DataNoise(*(jnp.asarray(found[name]) for name in DataNoise._fields))
            found["entries"] = np.sqrt(data_variance(noise, tools[0].gravity))
    return [with_values(params, fit) for params in tools], fit


def _fit(
    tools: Sequence[Params],
    parts: Sequence[tuple[Params, WrenchLogs]],
    ties: dict[str, str],
    known: dict[str, Array],
    search: Search,
) -> Fit:
    """Fit one of KINDS, starting from known values, or from values that change R noticeably."""
    index, logs = tied(starting_values(tools, ties, known), ties)
    optimum = fit_common(parts, index, logs, search)
    # So scaled, a variance of DISTINCT standard errors has an error of 1; sigma_Q is judged as without Sigma_D.
    scale = np.ones(len(logs))
    for name, lanes in index.items():
        scale[lanes] = 1.0 if name == "density" else DISTINCT * power(name)
    fit = as_fit(index, optimum, scale)
    if not fit.undetermined:
        return fit
    groups = {name: lanes - lanes.min() for name, lanes in index.items() if name in LANES}
    return fit._replace(determined=sentences(tools, groups, _sums(tools, index, optimum, scale)))


def _sums(
    tools: Sequence[Params], index: dict[str, np.ndarray], optimum: newton.Optimum, scale: np.ndarray
) -> DeterminedSums:
    """Sums of variances from the fitted noise, with relative standard errors."""

    def sums(logs: Array) -> tuple[Array, Array]:
        noise = {name: jnp.exp(logs[lanes]) for name, lanes in index.items()}
        totals = jnp.stack([total_variance(with_noise(params, noise)) for params in tools])
        if "entries" in noise:
            return totals, jnp.zeros(0)
        gravity = tools[0].gravity
        return totals, noise["linear_acceleration"] ** 2 + gravity @ gravity * noise["gravity_direction"] ** 2

    logs, information = jnp.asarray(optimum.logs), optimum.information / np.outer(scale, scale)
    values = [np.asarray(x) for x in sums(logs)]
    slopes = [np.asarray(x) for x in jax.jacfwd(sums)(logs)]
    errors = [
        combination_errors(information, slope / (2 * value[..., None]) / scale)
        for value, slope in zip(values, slopes, strict=True)
    ]
    # The data show R, so its diagonal is determined; the variance of a - g is if it is a combination of diagonals.
    totals, force = slopes[0].reshape(-1, len(logs)), slopes[1]
    left_over = force - (force @ np.linalg.pinv(totals, rcond=1e-10)) @ totals
    known = np.abs(left_over).max(-1, initial=0) < SMALL_REST * np.abs(force).max(-1, initial=0)
    return DeterminedSums(values[0], errors[0], values[1], np.where(known, errors[1], np.inf))
