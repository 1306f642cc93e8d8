"""Judging fits on blocks of the log that they have not seen."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ftbias_jax.gap.fit import PRIOR_STD, Fit
from ftbias_jax.gap.problem import Problem

FOLDS = 4
BLOCK_SECONDS = 2.0
LOCAL_BLOCK_SECONDS = 0.05
"""For effects that act for a moment: a longer block would hide all of it."""


class HeldOut(NamedTuple):
    """A fit on blocks it has not seen."""

    error: np.ndarray
    """(B, 6) innovations, in standard deviations."""
    gain: float
    """nats per second over the reference."""
    gain_stderr: float


def hold_out(problem: Problem, fit: Fit, reference: np.ndarray) -> HeldOut:
    """Errors of each fold with the numbers fitted to the other folds, to first order around the whole fit.

    Args:
        problem: of the log. fit: on the whole log. reference: (B, 6) errors of the model to compare with.
    """
    local = any(h.local for h in fit.hypotheses)
    used, t = problem.used, np.asarray(problem.signals.t)[: problem.used]
    fold = (t / (LOCAL_BLOCK_SECONDS if local else BLOCK_SECONDS)).astype(int) % FOLDS
    columns, error = fit.columns[:, :used], fit.error[:used].copy()
    if len(columns):
        prior = np.zeros(len(columns))
        prior[: len(fit.free)] = PRIOR_STD**-2
        flat = columns.reshape(len(columns), used, 6)
        for k in range(FOLDS):
            rest, test = fold != k, fold == k
            seen = flat[:, rest].reshape(len(columns), -1)
            normal = seen @ seen.T + np.diag(prior)
            normal += 1e-7 * np.eye(len(normal)) * max(float(np.trace(normal)) / len(normal), 1e-12)
            shift = -np.linalg.solve(normal, seen @ fit.error[:used][rest].ravel())
            error[test] += np.tensordot(shift, flat[:, test], 1)
    block = (t / BLOCK_SECONDS).astype(int)
    gains = np.bincount(block, ((reference[:used] ** 2 - error**2).sum(1)) / 2)
    duration = max(problem.duration, 1e-9)
    return HeldOut(error, float(gains.sum() / duration), float(np.sqrt(len(gains)) * gains.std() / duration))


def excess(problem: Problem, error: np.ndarray) -> np.ndarray:
    """(B, 6) squared innovation beyond its expectation, in units of one sample's noise variance; 0 if not measured.

    Args:
        problem: of the log. error: innovations in standard deviations, of the used bins or of all.
    """
    used = problem.used
    relative = np.asarray(problem.wrench.variance)[:used] / problem.noise_std**2
    return np.where(problem.samples[:used] > 0, (error[:used] ** 2 - 1) * relative, 0)


def excess_by_channel(problem: Problem, error: np.ndarray) -> np.ndarray:
    """(6,) mean of the excess over the measured bins."""
    measured = (problem.samples[: problem.used] > 0).sum(0)
    mean: np.ndarray = excess(problem, error).sum(0) / np.maximum(measured, 1)
    return mean


def excess_stderr(problem: Problem, error: np.ndarray) -> float:
    """Standard error of the mean excess over the channels, from blocks."""
    block = (np.asarray(problem.signals.t)[: problem.used] / BLOCK_SECONDS).astype(int)
    sums = np.bincount(block, excess(problem, error).mean(1))
    return float(np.sqrt(len(sums)) * sums.std() / problem.used)
