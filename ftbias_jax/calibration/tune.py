"""Noise parameters of maximum likelihood, from one log or many.

The joints' noise is fitted to the joints' likelihood; then the noise of bias and sensor to the likelihood of the wrench
given all joint measurements, past and future. That is the density of the whole log, p(joints) p(wrench | joints). Given
the past only, the lag of the joint filter stays in the wrench, moves slowly, and is taken for drift: sigma_Q comes out
up to 58 % too large (experiments/tuning). Parameters are logarithms: they need no bounds.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from ftbias_jax.calibration import newton
from ftbias_jax.calibration.batching import cut, equal_parts, stack
from ftbias_jax.calibration.newton import Report
from ftbias_jax.calibration.noise.score import (
    WRENCH_BURN_IN,
    JointScore,
    WrenchLogs,
    WrenchScore,
    rows_of,
    smoothed_wrenches,
)
from ftbias_jax.calibration.noise.values import VIBRATION, tied, with_noise
from ftbias_jax.calibration.noise.words import labels, open_directions
from ftbias_jax.filtering.pipeline import DEFAULT_OPTIONS, Options
from ftbias_jax.model.params import Params
from ftbias_jax.types import Array, Sample

PIECE = 4096
"""Joint filters forget within a fraction of a second, so their logs are cut into pieces that run side by side."""
PIECES_AT_ONCE = 4
"""Or logs: few, because work on them takes the time of the longest."""
SAMPLES_AT_ONCE = 1 << 18
"""Of whole logs side by side. Both bound the memory."""
RESTART_SPREAD = np.log(10.0)


class Fit(NamedTuple):
    """A fitted set of noise parameters and their standard errors; arrays over the lanes (joints or axes) by name."""

    values: dict[str, np.ndarray]
    relative_stderr: dict[str, np.ndarray]
    undetermined: list[str]
    """Combinations the data leave open, in words."""
    optimum: newton.Optimum
    determined: tuple[str, ...] = ()
    """Sums that the data do determine where they leave parts of them open, in words."""


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
    index, first = tied(start, ties)
    score, lanes = JointScore(rows_of(index), options.joint_model), np.array(list(index.values()))
    fit = as_fit(index, newton.maximise(score, parts, _with_restarts(first, restarts), lanes, report, total))
    return with_values(params, fit), fit


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
    parts = newton.for_each(partial(smoothed_wrenches, params, options=options), samples)
    return fit_wrench(params, [(params, part) for part in parts], ties, WRENCH_BURN_IN, restarts, report, total)


def fit_wrench(
    params: Params,
    parts: Sequence[tuple[Params, WrenchLogs]],
    ties: dict[str, str],
    burn_in: float = WRENCH_BURN_IN,
    restarts: int = 0,
    report: Report = newton.quiet,
    total: newton.Total = newton.alone,
) -> tuple[Params, Fit]:
    """``tune_wrench`` for joints that are already smoothed, or known; parts have arrays of the same shapes."""
    index, logs = tied({name: stated_noise(params)[name] for name in ties}, ties)
    score, lanes = WrenchScore(rows_of(index), burn_in), np.array(list(index.values()))
    fit = as_fit(index, newton.maximise(score, parts, _with_restarts(logs, restarts), lanes, report, total))
    return with_values(params, fit), fit


def fit_common(
    parts: Sequence[tuple[Params, WrenchLogs]],
    index: dict[str, np.ndarray],
    logs: np.ndarray,
    restarts: int,
    report: Report,
) -> newton.Optimum:
    """The likeliest noise of the wrench where its numbers reach all axes: one lane has them all.

    Args:
        parts: all of them lead, because those of one tool alone leave much open.
        index: of ``tied``.
        logs: (P,) where to start.
        restarts: as for ``tune_joints``.
        report: called with (iteration, nats).
    """
    score = WrenchScore(tuple((name, tuple(map(int, lanes))) for name, lanes in index.items()))
    every, starts = np.arange(len(logs))[:, None], _with_restarts(logs, restarts)
    return newton.maximise(score, parts, starts, every, report, leading=len(parts), small=newton.HARDLY_A_GAIN)


def stated_noise(params: Params) -> dict[str, Array]:
    """(6,) each, of WRENCH_NAMES: N/s^1.5 and Nm/s^1.5, N and Nm."""
    return {"density": params.bias.density, "wrench_std": jnp.sqrt(params.bias.wrench_variance)}


def _with_restarts(logs: np.ndarray, restarts: int) -> np.ndarray:
    """(1 + restarts, P) logarithms to start from."""
    spread = np.random.default_rng(0).normal(scale=RESTART_SPREAD, size=(restarts, len(logs)))
    return np.concatenate([logs[None], logs + spread])


def as_fit(index: dict[str, np.ndarray], optimum: newton.Optimum, scale: np.ndarray | None = None) -> Fit:
    """Values (n,) in N, Nm, rad and s, their relative errors, and what is open.

    Args:
        index: of ``tied``.
        optimum: of its free values.
        scale: (P,) the data determine a logarithm whose error is less than one over this; None = 1.
    """
    scale = np.ones(len(optimum.logs)) if scale is None else scale
    information = optimum.information / np.outer(scale, scale)
    names = [word for name, lanes in index.items() for word in labels(name, lanes)]
    values, errors = np.append(np.exp(optimum.logs), 0), np.append(newton.standard_errors(information) / scale, 0)
    shape = {name: (-1, 6) if name == VIBRATION else (-1,) for name in index}
    return Fit(
        {name: values[lanes].reshape(shape[name]) for name, lanes in index.items()},
        {name: errors[lanes].reshape(shape[name]) for name, lanes in index.items()},
        open_directions(information, names),
        optimum,
    )


def with_values(params: Params, fit: Fit) -> Params:
    """Parameters with the noise of a fit."""
    return with_noise(params, {name: jnp.asarray(value, params.theta.dtype) for name, value in fit.values.items()})
