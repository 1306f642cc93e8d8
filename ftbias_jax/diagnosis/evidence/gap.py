"""Fits judged on held-out blocks, the size of the gap in all logs and in each, and the verdict."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis import thresholds
from ftbias_jax.diagnosis.evidence.estimates import parameters
from ftbias_jax.diagnosis.hypothesis import moments
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.design_matrix import Columns, change, step_and_gain
from ftbias_jax.diagnosis.regression.fit import Fit, log_likelihood_gain, stepped
from ftbias_jax.diagnosis.result import Gap, LogGap


class HeldOut(NamedTuple):
    """A fit evaluated on held-out blocks."""

    error: np.ndarray
    """(U, 6) held-out innovations, in standard deviations."""
    nats: float
    """Gain over the reference, nats per second."""
    nats_stderr: float
    nats_by_noise: float = 0.0
    """nats per second: standard error of the gain due to noise and the remaining residuals alone; smaller than
    ``nats_stderr``, which also contains the variation of the effect between blocks."""


class CrossValidation:
    """Evaluates fits of one problem on held-out blocks, each fit once, whatever it is compared with."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self._errors: dict[int, tuple[Fit, np.ndarray]] = {}  # keeps the fit alive, so that its id is not reused

    def __call__(self, fit: Fit, reference: np.ndarray) -> HeldOut:
        """Evaluate a fit to all logs on held-out blocks; reference: (U, 6) errors of the model to compare with."""
        if id(fit) not in self._errors:
            self._errors[id(fit)] = fit, held_out_error(self._problem, fit)
        _, error = self._errors[id(fit)]
        block, duration = self._problem.block(thresholds.BLOCK_SECONDS), max(self._problem.duration, 1e-9)
        # The change of the prediction, s = r - e, gains s^2 / 2 + s e, of which only s e is due to chance.
        chance = np.bincount(block, ((reference - error) * error).sum(1))
        numbers = (*log_likelihood_gain(self._problem, error, reference), np.sqrt((chance**2).sum()))
        return HeldOut(error, *(float(x / duration) for x in numbers))


def held_out_error(problem: Problem, fit: Fit) -> np.ndarray:
    """(U, 6) errors of each fold with the parameters fitted to the other folds, to first order around the full fit."""
    # For a short effect every fourth bin is held out, because a longer block would hide all of it.
    local = any(h.local or moments(problem, problem.catalogue[h.effect]) for h in fit.hypotheses)
    fold = (np.arange(len(problem.t)) if local else problem.block(thresholds.BLOCK_SECONDS)) % thresholds.FOLDS
    error = fit.error.copy()
    for k in range(thresholds.FOLDS if fit.degrees else 0):
        rest, test = fold != k, fold == k
        error[test] += change(fit.columns.at(test), step_and_gain(fit.columns.at(rest), fit.error[rest])[0])
    return error


def excess(problem: Problem, error: np.ndarray) -> np.ndarray:
    """(U, 6) squared innovation beyond its expectation, in units of one sample's noise variance; 0 if not measured."""
    relative = problem.variance / problem.noise_std**2
    return np.where(problem.samples > 0, (error**2 - 1) * relative, 0)


def excess_by_channel(problem: Problem, error: np.ndarray) -> np.ndarray:
    """(6,) mean excess with inverse-variance weights, nearly zero for bins where the joints are poorly known."""
    return (_weights(problem) * excess(problem, error)).sum(0)


def excess_over_quiet(problem: Problem, error: np.ndarray) -> np.ndarray:
    """(6,) mean excess beyond that of the quieter half of the log, where that is below zero.

    Joints in smooth motion are known better than a filter tuned to the whole log assumes. Innovations are then smaller
    than expected nearly everywhere, and a mean over the log hides a few blocks in which they are far too large.
    """
    block, weights = problem.block(thresholds.BLOCK_SECONDS), _weights(problem)
    sums = np.stack([np.bincount(block, x) for x in (weights * excess(problem, error)).T])
    shares = np.stack([np.bincount(block, x) for x in weights.T])
    quiet = np.array([_median(x / np.maximum(share, 1e-300), share) for x, share in zip(sums, shares, strict=True)])
    return sums.sum(1) - np.minimum(quiet, 0)


def gap_removed(problem: Problem, before: np.ndarray, after: np.ndarray) -> float:
    """Decrease of the mean square gap from one set of errors (U, 6) to another, in noise variances."""
    return float((excess_by_channel(problem, before) - excess_by_channel(problem, after)).mean())


def excess_stderr(problem: Problem, error: np.ndarray) -> float:
    """Standard error of the mean excess over the channels, from the scatter of blocks."""
    sums = np.bincount(problem.block(thresholds.BLOCK_SECONDS), (_weights(problem) * excess(problem, error)).mean(1))
    return float(np.sqrt(len(sums)) * sums.std())


def excess_by_chance(problem: Problem) -> float:
    """Standard error of the mean excess over the channels if the innovations are white noise of the measured size."""
    relative = problem.variance / problem.noise_std**2
    return float(np.sqrt(2 * ((_weights(problem) * relative) ** 2).sum()) / 6)


def least_beside_joints(problem: Problem) -> float:
    """Least mean square gap, in noise variances, that a cause must remove, because joint errors may cause as much."""
    coherent = _of_joints(problem)
    joints = float((_weights(problem)[: len(coherent)] * coherent / problem.noise_std**2).sum(0).mean())
    return min(thresholds.SHARE_OF_JOINTS * joints, thresholds.LEADS**2)


def nats_of_joints(problem: Problem) -> float:
    """nats that a cause that follows the motion may gain from joint errors alone, because these follow it too.

    A low-pass, for example, smooths these errors in the model's prediction.
    """
    coherent = _of_joints(problem)
    return thresholds.SHARE_OF_JOINTS * float((coherent / problem.variance[: len(coherent)]).sum()) / 2


def _of_joints(problem: Problem) -> np.ndarray:
    """(U, 6) N^2, Nm^2: variance of the bins due to errors of the joints."""
    return np.concatenate([np.zeros((0, 6)), *(part.coherent for part in problem.parts)])


def excess_by_size(problem: Problem) -> float:
    """Standard error of the mean excess over the channels due to the error of the noise level measured in the log."""
    share = (_weights(problem) * problem.variance).sum(0) / problem.noise_std**2
    return float(np.linalg.norm(2 * problem.noise_stderr / problem.noise_std * share) / 6)


def _weights(problem: Problem) -> np.ndarray:
    """(U, 6) inverse variances of the bins' excess, with sum 1 over the bins."""
    weight = np.where(problem.samples > 0, (problem.noise_std**2 / problem.variance) ** 2, 0)
    return weight / np.maximum(weight.sum(0), 1e-300)


def _median(x: np.ndarray, weight: np.ndarray) -> float:
    """Weighted median: the value with half of the weight below it."""
    order = np.argsort(x)
    return float(x[order][np.searchsorted(np.cumsum(weight[order]), weight.sum() / 2)])


def measure_gap(problem: Problem, before: HeldOut, after: HeldOut) -> Gap:
    """The gap on held-out blocks, without and with the causes and terms found."""
    first, last = (excess_by_channel(problem, held.error) for held in (before, after))
    # A negative remainder means that the joints are known better than assumed; it corrects the gap before as well.
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
    """Whether the gap of the mean reading is negligible or no more than chance.

    Innovations scatter, and the noise level that they are compared with has an error, which is larger in a short log.
    """
    before = np.sqrt(gap.before_sigmas**2 - 1)
    chance = np.hypot(excess_by_chance(problem), excess_by_size(problem))
    return bool(before < thresholds.SILENT or before**2 < thresholds.BEYOND_CHANCE * chance)


def may_hide_a_gap(problem: Problem, error: np.ndarray) -> bool:
    """Whether innovations are so far below the assumed joint error that a gap of LEADS sigmas would not show."""
    return bool(np.maximum(-excess_by_channel(problem, error), 0).mean() > thresholds.LEADS**2)


def is_closed(problem: Problem, gap: Gap) -> bool:
    """Whether the remaining gap is too small to matter, also relative to the gap before, or no more than chance.

    The error of the measured noise level is left out: that the noise may be larger is no reason to call a gap closed.
    """
    before, after = np.sqrt(gap.before_sigmas**2 - 1), np.sqrt(gap.after_sigmas**2 - 1)
    small = max(thresholds.LEFT * before, min(thresholds.SILENT, thresholds.FAINT * before))
    return bool(after < small or after**2 < excess_by_chance(problem))


def verdict_of(problem: Problem, gap: Gap, causes: int, found: int, sure: bool, terms: int = 0) -> str:
    """One of ``result.VERDICTS``.

    ``causes``: number of causes, of which ``found`` come from single samples; ``sure``: no cause is in doubt;
    ``terms``: number of terms that describe what is not in the catalogue.
    """
    quiet = is_quiet(problem, gap)
    if not causes and not terms:
        return "none" if quiet else "unknown"
    if causes == found and not terms:  # findings in single samples do not explain the mean reading
        return "explained" if quiet else "unknown"
    # A gap near the noise may close by chance: the likelihood supports the cause, but nothing supports the shrink.
    closed, certain = is_closed(problem, gap), quiet or gap.shrink >= thresholds.CHANCE * gap.shrink_stderr
    if closed and sure and certain:
        return "described" if terms else "explained"
    useful = certain and gap.shrink >= thresholds.USEFUL_SHARE
    return "partly_explained" if useful or closed else "unknown"


def compare(
    problem: Problem, names: Sequence[str], accepted: Fit, before: HeldOut, after: HeldOut
) -> tuple[LogGap, ...]:
    """Gap and parameters of each log separately, without and with the causes fitted to all; empty for a single log."""
    if len(problem.parts) < 2:
        return ()
    found = []
    for log, name in enumerate(names):
        own = problem.log == log
        first, last = (_sigmas(problem, held.error, own) for held in (before, after))
        alone, gain = refit_one_log(accepted, own)
        values = {h.effect: parameters(problem, alone, h) for h in accepted.hypotheses}
        seconds = max(problem.durations[log], 1e-9)
        said = {effect: value for effect, (value, _) in values.items()}
        stderr = {effect: error for effect, (_, error) in values.items()}
        nats = float((before.error[own] ** 2 - after.error[own] ** 2).sum()) / 2
        left = np.where(problem.samples[own] > 0, after.error[own] ** 2 - 1, 0).sum() / 2
        left_per_second = max(float(left), 0.0) / seconds
        found.append(LogGap(name, first, last, gain / seconds, said, stderr, nats, left_per_second))
    return tuple(found)


def worsened(by_log: Sequence[LogGap]) -> tuple[LogGap, ...]:
    """Logs that do not share the others' causes: these add more than the noise to the error, or are clearly unlikely.

    A small loss of likelihood is none: real causes never have exactly the fitted form, nor the same size every day.
    """
    most = max((log.nats for log in by_log), default=0.0)
    loss = max(thresholds.LEAST_GAIN, thresholds.FORM_LOSS * most)
    return tuple(log for log in by_log if log.is_raised or log.nats < -loss)


def differ(by_log: Sequence[LogGap]) -> bool:
    """Whether the logs need parameters of their own: these would remove most of what the shared ones leave."""
    own, left = (sum(getattr(log, name) for log in by_log) for name in ("own_gain", "left"))
    return own > thresholds.APART * left and own > thresholds.LEAST_APART


def _sigmas(problem: Problem, error: np.ndarray, own: np.ndarray) -> float:
    """Rms of a log's innovations in noise sigmas."""
    few = problem._replace(variance=problem.variance[own], samples=problem.samples[own])
    return float(np.sqrt(1 + max(float(excess_by_channel(few, error[own]).mean()), 0.0)))


def refit_one_log(accepted: Fit, own: np.ndarray) -> tuple[Fit, float]:
    """The causes refitted to one log's bins (U,), to first order around the fit to all, and the gain there in nats."""
    columns = Columns(*(x * own[:, None] for x in accepted.columns))
    return stepped(accepted, columns, accepted.error * own[:, None])
