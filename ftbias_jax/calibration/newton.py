"""Maximum likelihood over logarithms of noise parameters, by damped Newton iterations.

The likelihood of independent filters is a sum over lanes (one joint or axis each), so its Hessian has one small block
per lane, determined by as many gradients as a lane has parameters; tying is a linear map of the logarithms. Parameters
that affect all filters together form a single lane. All gradients of an iteration run side by side in vmapped calls,
which cost little more than one gradient. The data come in equal parts that are processed one after the other, so that a
part bounds the memory; most iterations use the first parts alone.
"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np

from ftbias_jax.runtime.jax_config import same_precision
from ftbias_jax.runtime.many import do_all
from ftbias_jax.types import Array

LaneScore = Callable[[Array, Any], Array]
"""(K, N) logarithms of K parameters of N lanes, and a part of the data -> (N,) nats. Scores that compare equal and have
equal hashes share one compiled program."""

Report = Callable[[int, float], None]
"""Callback with (iteration, nats)."""

MAX_ITERATIONS = 60
RESTART_SPREAD = np.log(10.0)
LONGEST_STEP = 1.5
"""Largest change of a logarithm in one iteration: a factor of 4.5."""
SHORTEN = 0.3
"""Factor that shortens a step without gain, at most SHORTENINGS times."""
SHORTENINGS = 4
SMALL_GAIN = 1e-3
"""nats; converged when the next step promises less: 0.05 standard errors. That step is taken without evaluation."""
SMALL_GAIN_OF_PARTS = 0.1
"""nats; the optimum of a part of the data is some standard errors from that of all data, so it need not be exact."""
TINY_GAIN = 1e-6
"""nats, with products and sums of parameters: a remaining gradient would give undetermined directions a curvature."""
GROWTH = 16
UNDETERMINED = 1.0
"""A combination of logarithms with a larger standard error is not determined by the data."""
THREADS = min(4, os.cpu_count() or 1)
"""Number of parts that are processed at the same time: a recursion over time keeps one core busy."""
DIFFERENCE = 1e-4
"""Step of a logarithm for the Hessian by differences of gradients."""
GRADIENTS_AT_ONCE = 16
"""Number of gradients side by side; bounds the memory where a lane has many parameters."""


class Optimum(NamedTuple):
    """Maximum of the likelihood over P free values."""

    logs: np.ndarray
    """(P,) logarithms of the free values."""
    stderr: np.ndarray
    """(P,) their standard errors, which are relative errors of the values; inf where the data do not determine them."""
    information: np.ndarray
    """(P, P) observed Fisher information of the logarithms."""
    value: float
    """Log-likelihood, nats; at most SMALL_GAIN below its value at ``logs``."""
    iterations: int
    """Number of iterations over all data; those over parts of it are not counted."""
    converged: bool
    starts: int
    agreeing: int
    """Number of starts that led to the same likelihood."""


class _Point(NamedTuple):
    """Likelihood, gradient and Hessian at one point."""

    z: np.ndarray
    value: float
    slope: np.ndarray
    """(P,) gradient."""
    information: np.ndarray
    """(P, P) negative Hessian."""


class _Ascent(NamedTuple):
    """Result of Newton iterations."""

    at: _Point
    beyond: np.ndarray
    """The last point plus a small step that was not evaluated."""
    iterations: int
    converged: bool


Total = Callable[[float, np.ndarray], tuple[float, np.ndarray]]
"""Value and gradients of this process -> their sums over all processes."""


def alone(value: float, slopes: np.ndarray) -> tuple[float, np.ndarray]:
    """Sums over processes where there is only one."""
    return value, slopes


def quiet(iteration: int, value: float) -> None:
    """Ignore progress."""


class Search(NamedTuple):
    """Settings of a search for the maximum likelihood, and whom to share the work with."""

    restarts: int = 0
    """Further starts, each value off by a random factor (10 or 1/10 is usual); ``Fit.optimum`` counts agreeing ones."""
    report: Report = quiet
    """Called with (iteration, nats)."""
    total: Total = alone
    """Sums over the processes that tune together, see ``maximise``."""
    executor: Executor | None = None
    """Executor whose workers process parts of the data; None = threads do."""

    def starts(self, logs: np.ndarray) -> np.ndarray:
        """(1 + restarts, P) logarithms to start from."""
        spread = np.random.default_rng(0).normal(scale=RESTART_SPREAD, size=(self.restarts, len(logs)))
        return np.concatenate([logs[None], logs + spread])


FROM_ONE_START = Search()


def maximise(
    score: LaneScore,
    parts: Sequence[Any],
    starts: np.ndarray,
    index: np.ndarray,
    report: Report = quiet,
    total: Total = alone,
    leading: int = 1,
    small: float = SMALL_GAIN,
    executor: Executor | None = None,
) -> Optimum:
    """Maximise a likelihood by damped Newton iterations; needs double precision.

    Args:
        score: per-lane log-likelihood of a part, differentiable in the logarithms.
        parts: parts of the data, pytrees of arrays of the same shapes; the likelihood is the sum over them.
        starts: (S, P) logarithms to start from; only the best result on the first parts is pursued with all of them.
        index: (K, N) index of the free value for each entry of the score's argument.
        report: called with (iteration, nats).
        total: sums over the processes that work together, each on its own parts (distributed.py); all of them then take
            the same steps, with all their parts from the start.
        leading: number of parts used at first; then 16 times as many, 256 times, and all of them.
        small: nats that a step may still promise at convergence.
        executor: executor whose workers process the parts; None = threads do.
    """
    fewest = leading if total is alone else len(parts)
    counts = [fewest * GROWTH**i for i in range(len(parts)) if fewest * GROWTH**i < len(parts)] + [len(parts)]
    smalls = [SMALL_GAIN_OF_PARTS] * (len(counts) - 1) + [small]
    climbs = [
        _ascend(partial(_evaluate, score, parts[: counts[0]], index, total, executor), z, smalls[0], report)
        for z in starts
    ]
    best = max(climbs, key=lambda climb: _finite(climb.at.value))
    agreeing = sum(climb.at.value > best.at.value - 2 * smalls[0] for climb in climbs)
    for count, small in zip(counts[1:], smalls[1:], strict=True):
        best = _ascend(partial(_evaluate, score, parts[:count], index, total, executor), best.beyond, small, report)
    stderr = standard_errors(best.at.information)
    reached = best.at.information, best.at.value, best.iterations, best.converged
    return Optimum(best.beyond, stderr, *reached, len(climbs), agreeing)


def for_each(function: Callable[[Any], Any], parts: Sequence[Any], executor: Executor | None = None) -> list[Any]:
    """Apply a compiled function to every part of the data, several at a time; returns its results as NumPy arrays.

    Args:
        function: function of one part; must be picklable if there is an executor.
        parts: parts of the data.
        executor: executor whose workers process the parts; None = threads do.
    """
    one = partial(_in_numpy, function)
    if len(parts) == 1:
        return [one(parts[0])]
    if executor is not None:
        # JAX arrays lose precision on their way to a process that computes in float32; NumPy arrays do not.
        return do_all(one, [jax.tree.map(np.asarray, part) for part in parts], executor)
    first = one(parts[0])  # compiles, once
    with ThreadPoolExecutor(THREADS) as pool:
        return [first, *pool.map(same_precision(one), parts[1:])]


def _in_numpy(function: Callable[[Any], Any], part: Any) -> Any:
    return jax.tree.map(np.asarray, function(part))


def standard_errors(information: np.ndarray) -> np.ndarray:
    """(P,) from the inverse of an information matrix; inf for what it does not determine."""
    strength, directions = np.linalg.eigh(information)
    known = strength > UNDETERMINED**-2
    variance = (directions[:, known] ** 2 / strength[known]).sum(1)
    touched = (directions[:, ~known] ** 2).sum(1) > 1e-2
    return np.where(touched, np.inf, np.sqrt(variance))


def _ascend(evaluate: Callable[[np.ndarray], _Point], start: np.ndarray, small: float, report: Report) -> _Ascent:
    """Newton iterations until the next step promises less than ``small``."""
    here = evaluate(start)
    for iteration in range(1, MAX_ITERATIONS + 1):
        step, gain = _ascent(here.slope, here.information)
        if gain < small:
            return _Ascent(here, here.z + step, iteration, True)
        for shortening in range(SHORTENINGS + 1):
            there = evaluate(here.z + SHORTEN**shortening * step)
            if _finite(there.value) > _finite(here.value):
                break
        else:  # rounding errors exceed the remaining gain
            return _Ascent(here, here.z, iteration, gain < 1e-2)
        here = there
        report(iteration, here.value)
    return _Ascent(here, here.z, MAX_ITERATIONS, False)


def _finite(value: float) -> float:
    """The value; -inf if it is not finite."""
    return value if np.isfinite(value) else -np.inf


def _evaluate(
    score: LaneScore, parts: Sequence[Any], index: np.ndarray, total: Total, executor: Executor | None, z: np.ndarray
) -> _Point:
    """Value, gradient and negative Hessian, the latter by differences of gradients of all lanes together."""
    K, P = len(index), len(z)
    x = z[index]
    points = np.concatenate([x[None], x + DIFFERENCE * np.eye(K)[:, :, None]])
    value, slope = 0.0, np.zeros(points.shape)
    for values, slopes in for_each(partial(_values_and_slopes, score, points), parts, executor):
        value, slope = value + float(values[0]), slope + slopes
    value, slope = total(value, slope)
    blocks = (slope[1:] - slope[0]) / DIFFERENCE  # (K, K, N)
    gradient, hessian = np.zeros(P), np.zeros((P, P))
    np.add.at(gradient, index, slope[0])
    for a in range(K):
        for b in range(K):
            np.add.at(hessian, (index[a], index[b]), blocks[a, b])
    return _Point(z, value, gradient, -(hessian + hessian.T) / 2)


def _values_and_slopes(score: LaneScore, points: Array, part: Any) -> tuple[Array, Array]:
    """Nats (M,) at points (M, K, N) and their gradients; not compiled itself, so that it can be sent to workers."""
    return _compiled(score, points, part)


@partial(jax.jit, static_argnames="score")
def _compiled(score: LaneScore, points: Array, part: Any) -> tuple[Array, Array]:
    one = jax.value_and_grad(lambda x: score(x, part).sum())
    if len(points) <= GRADIENTS_AT_ONCE:
        return jax.vmap(one)(points)
    return jax.lax.map(one, points, batch_size=GRADIENTS_AT_ONCE)


def _ascent(slope: np.ndarray, information: np.ndarray) -> tuple[np.ndarray, float]:
    """Newton step, uphill also in directions of wrong or no curvature, and the gain in nats that it promises."""
    strength, directions = np.linalg.eigh(information)
    along = directions.T @ slope
    safe = np.maximum(np.abs(strength), UNDETERMINED**-2 / 100)
    step = directions @ (along / safe)
    longest = np.abs(step).max()
    return step * min(1.0, LONGEST_STEP / max(longest, 1e-300)), float((along**2 / safe).sum() / 2)
