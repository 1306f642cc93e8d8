"""Pooled diagnosis of one robot's logs over time: causes that no single log shows, when each began, and how it grew.

The latest logs are diagnosed together, with shared parameters. Each cause is then measured in every log as a share of
its size in the latest ones. The shares show when it began, whether suddenly or gradually, and how much it varies from
log to log in addition to the standard errors.
"""

from collections.abc import Callable, Collection, Iterable, Sequence
from functools import partial

import numpy as np

from ftbias_jax.diagnosis import diagnose
from ftbias_jax.diagnosis.problem import Problem, make_problem
from ftbias_jax.diagnosis.regression.evaluate import measured, readings, whitened
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.diagnosis.result import ALL_ALONG, AT_ONCE, GROWING, Course, Diagnosis
from ftbias_jax.diagnosis.thresholds import BLOCK_SECONDS, FEWEST_POOLED, LEAST_GAIN, MOST_POOLED, POOLED_SHARE
from ftbias_jax.errors import UsageError
from ftbias_jax.io import GivenLog, as_logs, names_of
from ftbias_jax.io.cleaning import slices, survey
from ftbias_jax.model.effects.fitting import SUDDEN
from ftbias_jax.model.effects.terms.parse import TERM
from ftbias_jax.model.own_effects import catalogue_of_setup
from ftbias_jax.runtime.jax_config import in_float64
from ftbias_jax.runtime.progress import silent
from ftbias_jax.setup import GivenSetup, as_setup

SCATTERS = np.array([0.0, 0.03, 0.06, 0.1, 0.15, 0.22, 0.33, 0.5])
"""Candidate standard deviations of a share from log to log."""


@in_float64
def diagnose_pooled(
    setup: GivenSetup,
    logs: Iterable[GivenLog],
    dates: Sequence[float] = (),
    names: Sequence[str] = (),
    without: Collection[str] = (),
    unchecked: bool = False,
    progress: Callable[[str], None] = silent,
) -> Diagnosis:
    """Diagnose logs of one robot over time: causes are found in the latest logs together and measured in all of them.

    Args:
        setup: as in ``diagnose``.
        logs: (N,) logs of free motion with the same robot, sensor and tool, as for ``diagnose``.
        dates: (N,) s since 1970; () = as stamped.
        names: as in ``diagnose``.
        without: effects that may not be named.
        unchecked: skip the check whether the setup can be right.
        progress: called with the name of each stage as it begins.

    Raises:
        UsageError: too few logs. Others as in ``diagnose``.
    """
    setup = as_setup(setup)
    read = as_logs(logs, setup, raw=True)
    if len(read) < FEWEST_POOLED:
        remedy = f"give {FEWEST_POOLED} logs or more of one robot, or leave out --pool"
        raise UsageError(f"got {len(read)} logs", field="logs", remedy=remedy)
    stamped = np.array(dates or [log.start for log in read], float)
    order = np.argsort(stamped, kind="stable")
    names = names or names_of(read)
    read, names, stamped = [read[i] for i in order], [names[i] for i in order], stamped[order]
    # An event in one log is no cause that logs share, but would absorb what varies between them.
    moments = {effect.name for effect in catalogue_of_setup(setup).searched_by(*SUDDEN)}
    left_out = {*without, *moments, TERM}
    # A cause that began a few logs ago may go unnoticed among many logs without it.
    for count in (int(np.clip(POOLED_SHARE * len(read), FEWEST_POOLED, MOST_POOLED)), FEWEST_POOLED):
        diagnosis, answer = diagnose.explain(setup, read[-count:], names[-count:], left_out, unchecked, progress)
        reported = [h.effect for h in answer.accepted.hypotheses if not h.shapes]
        if reported:
            break
    courses: tuple[Course, ...] = ()
    if reported:
        progress("measuring causes in every log")
        with_tool, whole = diagnose.ready(setup, read, [survey(slices(log)) for log in read])
        problem, _ = make_problem(with_tool, whole)
        share, stderr = shares(problem, answer.accepted)
        courses = tuple(map(partial(course_of, stamped), reported, share.T, stderr.T))
    return diagnosis._replace(courses=courses)


def shares(problem: Problem, accepted: Fit) -> tuple[np.ndarray, np.ndarray]:
    """(N, H) share of each cause of a fit to other logs that is present in every log, and its standard error.

    To first order around the fit: the innovations are e + sum_h a_h c_h, where c_h is the contribution of cause h.
    """
    causes = [h for h in accepted.hypotheses if not h.shapes]
    z = np.repeat(accepted.z[None], len(causes) + 1, 0)
    for row, h in enumerate(causes, 1):
        z[row, list({*h.free, *(place for place, _ in h.fixed)})] = 0
    z = np.concatenate([np.zeros_like(z[:1]), z])
    nominal, whole, *without = whitened(problem, readings(problem, z) - np.nan_to_num(measured(problem)))
    columns = whole - np.stack(without)  # (H, U, 6)
    block, logs = problem.block(BLOCK_SECONDS), [problem.log == number for number in range(len(problem.parts))]
    found = [share_in(columns[:, own], nominal[own], block[own]) for own in logs]
    share, stderr = (np.array(x) for x in zip(*found, strict=True))
    return share, stderr


def share_in(columns: np.ndarray, error: np.ndarray, block: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients (H,) of columns (H, U, 6) that minimise innovations (U, 6), in standard deviations, and stderrs
    (H,).

    Standard errors are widened where scores of whole blocks (numbers (U,)) scatter more than white noise would.
    """
    flat = columns.reshape(len(columns), -1)
    normal = flat @ flat.T + 1e-12 * np.trace(flat @ flat.T) * np.eye(len(flat)) + 1e-300 * np.eye(len(flat))
    inverse = np.linalg.inv(normal)
    coefficients = -inverse @ (flat @ error.ravel())
    left = error + np.tensordot(coefficients, columns, 1)
    scores = np.stack([np.bincount(block - block[0], x) for x in (columns * left).sum(2)])
    widened = inverse @ (scores @ scores.T) @ inverse
    return coefficients, np.sqrt(np.maximum(np.diag(inverse), np.diag(widened)))


def course_of(dates: np.ndarray, effect: str, share: np.ndarray, stderr: np.ndarray) -> Course:
    """Time course of a cause, by its shares (N,) and their standard errors in logs of these dates (N,), in order.

    Before the first log with the cause the share is constant, and from then on constant or growing linearly. It varies
    from log to log in proportion to what is present. The likeliest course must gain as much over a constant one as a
    cause must.
    """
    days = (dates - dates[0]) / 86400
    constant, level, scatter = _likeliest(np.ones((len(days), 1)), share, stderr, np.ones(len(days)))
    shapes = [(AT_ONCE, k, (days >= days[k]).astype(float)) for k in range(1, len(days))]
    shapes += [(GROWING, k, _ramp(days, k)) for k in range(1, len(days) - 1)]
    fits = [_likeliest(np.stack([np.ones(len(days)), x], 1), share, stderr, x) for *_, x in shapes]
    nats = np.array([fit[0] for fit in fits])
    best = int(np.argmax(nats))
    if nats[best] - constant < LEAST_GAIN:
        edges = dates[0], dates[0], dates[-1]
        return Course(effect, ALL_ALONG, *edges, dates, share, stderr, float(level[0]), scatter)
    odds = np.bincount([k for _, k, _ in shapes], np.exp(nats - nats[best]), len(days))
    first, last = np.searchsorted(np.cumsum(odds) / odds.sum(), (0.025, 0.975))
    (begins, k, _), (_, numbers, scatter) = shapes[best], fits[best]
    edges = dates[k], dates[first - 1], dates[last]
    return Course(effect, begins, *edges, dates, share, stderr, float(numbers[0]), scatter)


def _ramp(days: np.ndarray, first: int) -> np.ndarray:
    """(N,) ramp from 0, up to the log before the first, to 1 at the last one."""
    begin = days[first - 1]
    return np.clip((days - begin) / max(days[-1] - begin, 1e-9), 0.0, None)


def _likeliest(
    columns: np.ndarray, share: np.ndarray, stderr: np.ndarray, present: np.ndarray
) -> tuple[float, np.ndarray, float]:
    """nats, coefficients (K,) of columns (N, K), and scatter between logs in proportion to what is present (N,)."""
    variance = stderr**2 + (SCATTERS[:, None] * present) ** 2  # (S, N)
    weight = 1 / variance
    normal = np.einsum("sn,nk,nl->skl", weight, columns, columns)
    right = np.einsum("sn,nk,n->sk", weight, columns, share)
    numbers = np.linalg.solve(normal + 1e-12 * np.eye(columns.shape[1]), right[:, :, None])[:, :, 0]
    nats = -0.5 * (weight * (share - numbers @ columns.T) ** 2 + np.log(variance)).sum(1)
    best = int(np.argmax(nats))
    return float(nats[best]), numbers[best], float(SCATTERS[best])
