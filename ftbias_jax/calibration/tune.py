"""Maximum-likelihood noise parameters, from one log or many.

The joint noise is fitted to the likelihood of the joint measurements, then the noise of bias and sensor to that of the
wrench given all joint measurements, past and future: together, the density p(joints) p(wrench | joints) of the whole
log. Given the past only, the lag of the joint filter would stay in the wrench, vary slowly and be mistaken for drift:
sigma_Q comes out up to 58 % too large (experiments/tuning). Logarithms are fitted, because they need no bounds.
"""

import itertools
import math
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.calibration import newton
from ftbias_jax.calibration.newton import FROM_ONE_START, Search
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
"""Samples of a piece of a log; joint filters forget within a fraction of a second, so pieces can run side by side."""
PIECES_AT_ONCE = 4
"""Number of pieces, or logs, in one batch: few, because a batch takes as long as its longest member."""
SAMPLES_AT_ONCE = 1 << 18
"""Largest number of samples of whole logs in one batch. This and PIECES_AT_ONCE bound the memory."""


class Fit(NamedTuple):
    """Fitted noise parameters and their standard errors; arrays over the lanes (joints or axes) by name."""

    values: dict[str, np.ndarray]
    relative_stderr: dict[str, np.ndarray]
    undetermined: list[str]
    """Combinations of parameters that the data do not determine, in words."""
    optimum: newton.Optimum
    determined: tuple[str, ...] = ()
    """Sums of variances that the data determine although their parts are undetermined, in words."""


def stack(logs: Sequence[Sample], length: int = 0) -> Sample:
    """Stack logs of unequal length into one batch with a leading log axis, padded by samples that change nothing.

    There must be at least one log; ``length`` is the number of samples to pad to if the longest log has fewer.
    """
    length = max(length, *(log.dt.shape[0] for log in logs))

    def fill(value: float, *leaves: Array) -> jax.Array:
        # NumPy, because JAX would compile anew for every shape.
        filled = np.full((len(logs), length, *leaves[0].shape[1:]), value, leaves[0].dtype)
        for row, leaf in zip(filled, leaves, strict=True):
            row[: len(leaf)] = leaf
        return jnp.asarray(filled)

    if any(log.rezeroed is not None for log in logs):
        logs = [log._replace(rezeroed=np.zeros(len(log.dt)) if log.rezeroed is None else log.rezeroed) for log in logs]
    everywhere = {name for name in Sample._fields if all(getattr(log, name) is not None for log in logs)}
    rest = [log._replace(dt=None, **dict.fromkeys(set(Sample._fields[1:]) - everywhere)) for log in logs]
    stacked: Sample = jax.tree.map(partial(fill, np.nan), *rest)
    rezeroed = None if stacked.rezeroed is None else jnp.nan_to_num(stacked.rezeroed)
    return stacked._replace(dt=fill(0.0, *(log.dt for log in logs)), rezeroed=rezeroed)


def cut(log: Sample, length: int) -> list[Sample]:
    """Cut a log's joint measurements into equally long pieces of at most ``length`` samples, each a log of its own."""
    whole = Sample(*(np.asarray(x) for x in log[:4]))  # the joints do not depend on the temperature
    count = -(-len(whole.dt) // length)
    ends = [len(whole.dt) * i // count for i in range(count + 1)]
    pieces = [Sample(*(x[start:end] for x in whole[:4])) for start, end in itertools.pairwise(ends)]
    return [piece._replace(dt=np.concatenate([[0], piece.dt[1:]])) for piece in pieces]


def equal_parts(logs: list[Sample], at_once: int) -> list[list[Sample]]:
    """Group logs into parts of equally many, at most ``at_once``; parts are filled up with logs that measured nothing.

    The logs of a part are of similar length, because work on a part takes as long as its longest log. Parts of all
    lengths alternate, because the first parts should be representative of all of them.
    """
    count = -(-len(logs) // at_once)
    size = -(-len(logs) // count)
    nothing = jax.tree.map(lambda x: np.full_like(x[:1], np.nan), logs[0])._replace(dt=np.zeros(1))
    filled = [nothing] * (count * size - len(logs)) + sorted(logs, key=lambda log: len(log.dt))
    parts = [filled[i : i + size] for i in range(0, len(filled), size)]
    stride = math.isqrt(count)
    return [part for first in reversed(range(stride)) for part in parts[first::stride]]


def tune_joints(
    params: Params,
    logs: Sequence[Sample],
    ties: dict[str, str],
    options: Options = DEFAULT_OPTIONS,
    search: Search = FROM_ONE_START,
) -> tuple[Params, Fit]:
    """Fit the noise of the joint filter.

    Args:
        params: values that are not fitted, and starting values.
        logs: samples of one robot.
        ties: key of TIES for each of JOINT_NAMES that is to be fitted.
        options: options of the pipeline.
        search: settings of the search for the maximum.

    Returns:
        params with the fitted noise, and the fit.
    """
    pieces = [piece for log in logs for piece in cut(log, PIECE)]
    longest = max(len(piece.dt) for piece in pieces)
    parts = [(params, stack(part, longest)) for part in equal_parts(pieces, PIECES_AT_ONCE)]
    start = {name: getattr(params.joint, name) for name in ties}
    index, first = tied(start, ties)
    return _fitted(params, JointScore(rows_of(index), options.joint_model), parts, index, first, search)


def tune_wrench(
    params: Params,
    logs: Sequence[Sample],
    ties: dict[str, str],
    options: Options = DEFAULT_OPTIONS,
    search: Search = FROM_ONE_START,
) -> tuple[Params, Fit]:
    """Fit the noise of bias and sensor, given the joint noise in ``params``, which should be the likeliest.

    Args:
        params: values that are not fitted, and starting values.
        logs: samples of one robot.
        ties: key of TIES for each of WRENCH_NAMES that is to be fitted: density is sigma_Q, wrench_std the square root
            of the diagonal of Sigma_W.
        options: options of the pipeline.
        search: settings of the search for the maximum.

    Returns:
        params with the fitted noise, and the fit.
    """
    longest = max(len(log.dt) for log in logs)
    at_once = max(1, min(PIECES_AT_ONCE, SAMPLES_AT_ONCE // longest))
    samples = [stack(part, longest) for part in equal_parts(list(logs), at_once)]
    parts = newton.for_each(partial(smoothed_wrenches, params, options=options), samples)
    return fit_wrench(params, [(params, part) for part in parts], ties, WRENCH_BURN_IN, search)


def fit_wrench(
    params: Params,
    parts: Sequence[tuple[Params, WrenchLogs]],
    ties: dict[str, str],
    burn_in: float = WRENCH_BURN_IN,
    search: Search = FROM_ONE_START,
) -> tuple[Params, Fit]:
    """``tune_wrench`` for joints that are already smoothed or known; the arrays of all parts have the same shapes."""
    index, logs = tied({name: stated_noise(params)[name] for name in ties}, ties)
    return _fitted(params, WrenchScore(rows_of(index), burn_in), parts, index, logs, search)


def _fitted(
    params: Params,
    score: newton.LaneScore,
    parts: Sequence[Any],
    index: dict[str, np.ndarray],
    logs: np.ndarray,
    search: Search,
) -> tuple[Params, Fit]:
    """Parameters with the likeliest noise, one value per lane or per group of tied lanes; and the fit."""
    lanes = np.array(list(index.values()))
    starts, by = search.starts(logs), search.executor
    fit = as_fit(index, newton.maximise(score, parts, starts, lanes, search.report, search.total, executor=by))
    return with_values(params, fit), fit


def fit_common(
    parts: Sequence[tuple[Params, WrenchLogs]], index: dict[str, np.ndarray], logs: np.ndarray, search: Search
) -> newton.Optimum:
    """Maximise the wrench likelihood over noise parameters that affect all axes, so that one lane holds all of them.

    Args:
        parts: used together from the first iteration, because the logs of one tool alone leave much undetermined.
        index: as returned by ``tied``.
        logs: (P,) logarithms to start from, of values in N, Nm and the like.
        search: settings of the search for the maximum, by one process.
    """
    score = WrenchScore(tuple((name, tuple(map(int, lanes))) for name, lanes in index.items()))
    every, starts = np.arange(len(logs))[:, None], search.starts(logs)
    return newton.maximise(
        score,
        parts,
        starts,
        every,
        search.report,
        leading=len(parts),
        small=newton.TINY_GAIN,
        executor=search.executor,
    )


def stated_noise(params: Params) -> dict[str, Array]:
    """Noise of bias and sensor in the parameters, (6,) for each of WRENCH_NAMES: N/s^1.5 and Nm/s^1.5, N and Nm."""
    return {"density": params.bias.density, "wrench_std": jnp.sqrt(params.bias.wrench_variance)}


def as_fit(index: dict[str, np.ndarray], optimum: newton.Optimum, scale: np.ndarray | None = None) -> Fit:
    """Fit from an optimum: values (n,) in N, Nm, rad and s, relative standard errors, and undetermined combinations.

    Args:
        index: as returned by ``tied``.
        optimum: optimum over the free values of ``index``.
        scale: (P,) a logarithm counts as determined if its standard error is below one over this; None = 1.
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
