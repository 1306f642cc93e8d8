"""Judging fits on blocks of the log that they have not seen."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.design_matrix import change, step_and_gain
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.diagnosis.thresholds import BLOCK_SECONDS, FOLDS


class HeldOut(NamedTuple):
    """A fit on blocks it has not seen."""

    error: np.ndarray
    """(U, 6) innovations, in standard deviations."""
    nats: float
    """Per second, over the reference."""
    nats_stderr: float
    nats_by_noise: float = 0.0
    """Per second: how far noise, and what else the fit leaves, may have moved the gain. Less than the standard error,
    which counts it, too, that an effect acts in some blocks more than in others."""


class Judge:
    """Holds out fits of one problem; each of them once, however often and against whatever it is judged."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self._errors: dict[int, tuple[Fit, np.ndarray]] = {}  # with the fit, or its id might be given again

    def __call__(self, fit: Fit, reference: np.ndarray) -> HeldOut:
        """A fit to all logs on blocks it has not seen; reference: (U, 6) errors of the model to compare with."""
        if id(fit) not in self._errors:
            self._errors[id(fit)] = fit, unseen_error(self._problem, fit)
        _, error = self._errors[id(fit)]
        block, duration = self._problem.block(BLOCK_SECONDS), max(self._problem.duration, 1e-9)
        gains = np.bincount(block, (reference**2 - error**2).sum(1) / 2)
        # The change of the prediction, s = r - e, gains s^2 / 2 + s e: of these only s e is chance.
        chance = np.bincount(block, ((reference - error) * error).sum(1))
        stderr, by_noise = np.sqrt(len(gains)) * gains.std(), np.sqrt((chance**2).sum())
        return HeldOut(error, *(float(x / duration) for x in (gains.sum(), stderr, by_noise)))


def unseen_error(problem: Problem, fit: Fit) -> np.ndarray:
    """(U, 6) errors of each fold with the numbers fitted to the other folds, to first order around the whole fit."""
    # What acts for a moment has every fourth bin left out: a longer block would hide all of it.
    local = any(h.local for h in fit.hypotheses)
    fold = (np.arange(len(problem.t)) if local else problem.block(BLOCK_SECONDS)) % FOLDS
    error = fit.error.copy()
    for k in range(FOLDS if fit.degrees else 0):
        rest, test = fold != k, fold == k
        error[test] += change(fit.columns.at(test), step_and_gain(fit.columns.at(rest), fit.error[rest])[0])
    return error


def excess(problem: Problem, error: np.ndarray) -> np.ndarray:
    """(U, 6) squared innovation beyond its expectation, in units of one sample's noise variance; 0 if not measured."""
    relative = problem.variance / problem.noise_std**2
    return np.where(problem.samples > 0, (error**2 - 1) * relative, 0)


def excess_by_channel(problem: Problem, error: np.ndarray) -> np.ndarray:
    """(6,) mean of the excess, each bin weighted by how well it tells it: not at all where joints are hardly known."""
    mean: np.ndarray = (_weights(problem) * excess(problem, error)).sum(0)
    return mean


def excess_over_quiet(problem: Problem, error: np.ndarray) -> np.ndarray:
    """(6,) mean of the excess beyond that of the quieter half of the log, where that is below zero.

    Smooth joints are known better than a filter believes that was tuned to the whole log. Innovations are then smaller
    than expected nearly everywhere, and a mean over the log hides a few blocks in which they are far too large.
    """
    block, weights = problem.block(BLOCK_SECONDS), _weights(problem)
    sums = np.stack([np.bincount(block, x) for x in (weights * excess(problem, error)).T])
    shares = np.stack([np.bincount(block, x) for x in weights.T])
    quiet = np.array([_median(x / np.maximum(share, 1e-300), share) for x, share in zip(sums, shares, strict=True)])
    over_quiet: np.ndarray = sums.sum(1) - np.minimum(quiet, 0)
    return over_quiet


def gap_removed(problem: Problem, before: np.ndarray, after: np.ndarray) -> float:
    """Mean square gap that is gone between two sets of errors (U, 6), in noise variances."""
    return float((excess_by_channel(problem, before) - excess_by_channel(problem, after)).mean())


def excess_stderr(problem: Problem, error: np.ndarray) -> float:
    """Standard error of the mean excess over the channels, from blocks."""
    sums = np.bincount(problem.block(BLOCK_SECONDS), (_weights(problem) * excess(problem, error)).mean(1))
    return float(np.sqrt(len(sums)) * sums.std())


def excess_by_chance(problem: Problem) -> float:
    """Standard error of the mean excess over the channels if the innovations are white noise of the measured size."""
    relative = problem.variance / problem.noise_std**2
    return float(np.sqrt(2 * ((_weights(problem) * relative) ** 2).sum()) / 6)


def excess_by_size(problem: Problem) -> float:
    """Standard error of the mean excess over the channels that the noise's size has, which was measured in the log."""
    share = (_weights(problem) * problem.variance).sum(0) / problem.noise_std**2
    return float(np.linalg.norm(2 * problem.noise_stderr / problem.noise_std * share) / 6)


def _weights(problem: Problem) -> np.ndarray:
    """(U, 6) inverse variances of the bins' excess, with sum 1 over the bins."""
    weight = np.where(problem.samples > 0, (problem.noise_std**2 / problem.variance) ** 2, 0)
    scaled: np.ndarray = weight / np.maximum(weight.sum(0), 1e-300)
    return scaled


def _median(x: np.ndarray, weight: np.ndarray) -> float:
    """The value with half of the weight below it."""
    order = np.argsort(x)
    return float(x[order][np.searchsorted(np.cumsum(weight[order]), weight.sum() / 2)])
