"""The size of the gap before and after, in all logs and in each, and the verdict on it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ftbias_jax.diagnosis.evidence.cross_validation import (
    HeldOut,
    excess_by_chance,
    excess_by_channel,
    excess_by_size,
    excess_stderr,
)
from ftbias_jax.diagnosis.evidence.estimates import parameters
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.design_matrix import Columns
from ftbias_jax.diagnosis.regression.fit import Fit, stepped
from ftbias_jax.diagnosis.result import Gap, LogGap
from ftbias_jax.diagnosis.thresholds import BEYOND_CHANCE, CHANCE, FAINT, LEFT, SILENT, USEFUL_SHARE


def measure_gap(problem: Problem, before: HeldOut, after: HeldOut) -> Gap:
    """The gap on unseen blocks, without and with what was found."""
    first, last = (excess_by_channel(problem, held.error) for held in (before, after))
    # Where less is left than expected, the joints are better known than was thought: then so much was noise before.
    spare = np.minimum(last, 0)
    first, last = np.maximum(first - spare, 0), last - spare
    total, left = float(first.mean()), float(last.mean())
    shrink = float(np.clip(1 - left / total, 0, 1)) if total > 0 else 0.0
    return Gap(
        before_rms=problem.noise_std * np.sqrt(1 + first),
        after_rms=problem.noise_std * np.sqrt(1 + last),
        noise_floor=problem.noise_std,
        before_sigmas=float(np.sqrt(1 + total)),
        after_sigmas=float(np.sqrt(1 + left)),
        shrink=shrink,
        shrink_stderr=min(excess_stderr(problem, after.error) / total, 1.0) if total > 0 else 0.0,
    )


def is_quiet(problem: Problem, gap: Gap) -> bool:
    """Whether there is no gap of the mean reading to speak of.

    Innovations scatter, and the noise that they are compared with is not known exactly: in a short log that is more.
    """
    before = np.sqrt(gap.before_sigmas**2 - 1)
    chance = np.hypot(excess_by_chance(problem), excess_by_size(problem))
    return bool(before < SILENT or before**2 < BEYOND_CHANCE * chance)


def is_closed(problem: Problem, gap: Gap) -> bool:
    """Whether what is left is small for the owner and against what was there, or no more than chance.

    That the noise may be larger than measured is no reason to call a gap closed.
    """
    before, after = np.sqrt(gap.before_sigmas**2 - 1), np.sqrt(gap.after_sigmas**2 - 1)
    small = max(LEFT * before, min(SILENT, FAINT * before))
    return bool(after < small or after**2 < excess_by_chance(problem))


def verdict_of(problem: Problem, gap: Gap, causes: int, found: int, sure: bool, terms: int = 0) -> str:
    """One of ``result.VERDICTS``.

    Of the named ``causes``, single samples show ``found``; ``sure``: none could as well be something else; ``terms``:
    how many describe what is not in the catalogue.
    """
    quiet = is_quiet(problem, gap)
    if not causes and not terms:
        return "none" if quiet else "unknown"
    if causes == found and not terms:  # single samples say nothing of the mean reading
        return "explained" if quiet else "unknown"
    # A gap near the noise may close by chance: the cause stands on its likelihood, the shrink on nothing.
    closed, certain = is_closed(problem, gap), quiet or gap.shrink >= CHANCE * gap.shrink_stderr
    if closed and sure and certain:
        return "described" if terms else "explained"
    useful = certain and gap.shrink >= USEFUL_SHARE
    return "partly_explained" if useful or closed else "unknown"


def compare(
    problem: Problem, names: Sequence[str], accepted: Fit, before: HeldOut, after: HeldOut
) -> tuple[LogGap, ...]:
    """What each log says by itself, held out without and with the causes fitted to all; nothing for a single log."""
    if len(problem.parts) < 2:
        return ()
    found = []
    for log, name in enumerate(names):
        own = problem.log == log
        first, last = (_sigmas(problem, held.error, own) for held in (before, after))
        alone, gain = alone_in(accepted, own)
        values = {h.effect: parameters(problem, alone, h) for h in accepted.hypotheses}
        gain_per_second = gain / max(problem.durations[log], 1e-9)
        said = {effect: value for effect, (value, _) in values.items()}
        stderr = {effect: error for effect, (_, error) in values.items()}
        found.append(LogGap(name, first, last, gain_per_second, said, stderr))
    return tuple(found)


def _sigmas(problem: Problem, error: np.ndarray, own: np.ndarray) -> float:
    """Rms of a log's innovations in noise sigmas."""
    few = problem._replace(variance=problem.variance[own], samples=problem.samples[own])
    return float(np.sqrt(1 + max(float(excess_by_channel(few, error[own]).mean()), 0.0)))


def alone_in(accepted: Fit, own: np.ndarray) -> tuple[Fit, float]:
    """The causes fitted to one log's bins (U,), to first order around the fit to all, and the nats this gains there."""
    columns = Columns(*(x * own[:, None] for x in accepted.columns))
    return stepped(accepted, columns, accepted.error * own[:, None])
