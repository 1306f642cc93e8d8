"""Maximum-likelihood fit of a variance that grows with regressors: weights, their errors, and the held-out gain."""

from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.samples.bins import sum_of_bins
from ftbias_jax.diagnosis.thresholds import FAR_SQUARES, LEAST_REST

BLOCK_SECONDS = 20.0
BLOCKS = 20
"""Least number of blocks, shorter ones in a short log: the standard error of the gain comes from their scatter."""
FOLDS = 4
ROUNDS, SETTLED = 100, 1e-5
"""Largest number of iterations, and the change of a term at convergence as a share of the mean variance."""
LEAST_LEFT, TINY = 0.01, 1e-24
"""Share of a weight that remains where extrapolation would pass zero; relative square of a step that is zero."""


class VarianceFit(NamedTuple):
    """Fit of one form of the growth in k channels."""

    design: np.ndarray
    """(N, d) design matrix: ones, and the regressors that the variance grows with."""
    weights: np.ndarray
    """(d, k) fitted weights."""
    better: np.ndarray
    """(k,) bool: channels that grow; the others keep their constant."""
    nats: np.ndarray
    """(blocks,) gain in nats over a constant, on held-out blocks."""


def judge_variance(drives: np.ndarray, squares: np.ndarray, block: np.ndarray, share: float) -> VarianceFit:
    """Fit a variance that grows with regressors (drives), and judge it on held-out blocks.

    Args:
        drives: (N, d - 1) or (N,), not negative.
        squares: (N, k) N^2, Nm^2, whose mean is the variance.
        block: (N,) number of the block of each row.
        share: number of samples of the log that each row stands for.
    """
    design = with_ones(drives)
    gains = _held_out_gains(design, squares, block) * share
    better = gains.sum(0) > 0
    weights = fit_variance(design, squares)
    weights = np.where(better, weights, np.outer(np.eye(len(weights))[0], squares.mean(0)))
    return VarianceFit(design, weights, better, gains[:, better].sum(1))


def with_ones(drives: np.ndarray) -> np.ndarray:
    """(N, d) design matrix of a constant and the regressors."""
    return np.column_stack([np.ones(len(drives)), drives])


def blocks_of(t: np.ndarray) -> np.ndarray:
    """(N,) the number of the block of every stamp (N,) s."""
    return np.asarray((t - t[0]) // min(BLOCK_SECONDS, np.ptp(t) / BLOCKS)).astype(int)


def average_runs(x: np.ndarray, length: int) -> np.ndarray:
    """(N, ...) -> (N // length, ...) means over runs of ``length`` rows."""
    count = len(x) // length
    return x[: count * length].reshape(count, length, *x.shape[1:]).mean(1)


def _held_out_gains(design: np.ndarray, squares: np.ndarray, block: np.ndarray) -> np.ndarray:
    """(blocks, k) nats that the growing variance gains over a constant, both fitted to the other blocks."""
    gain = np.zeros_like(squares)
    for fold in range(FOLDS):
        test = block % FOLDS == fold
        if test.all() or not test.any():
            continue
        growing = design[test] @ fit_variance(design[~test], squares[~test])
        constant = fit_variance(design[~test, :1], squares[~test])
        seen = np.minimum(squares[test], FAR_SQUARES * growing)
        gain[test] = (seen / constant - seen / growing - np.log(growing / constant)) / 2
    return sum_of_bins(block, gain)


def fit_variance(
    design: np.ndarray, squares: np.ndarray, rounds: int = ROUNDS, expected: np.ndarray | None = None
) -> np.ndarray:
    """Non-negative weights (d, k) of the most likely variance ``design @ weights`` of normal noise.

    Every step multiplies each weight by the ratio of the two parts of its derivative, so that signs never change; at
    the maximum the ratio is 1, or the weight goes to 0. Each channel is extrapolated from two steps (SQUAREM, Varadhan
    and Roland 2008), because hundreds of plain steps would not converge.

    Args:
        design: (N, d) not negative, the first column ones.
        squares: (N, k) squares of the noise.
        rounds: largest number of iterations.
        expected: (k,) mean of an exponential prior of every weight but the first; None = a flat prior.
    """
    size, mean = design.mean(0), squares.mean(0)
    weights: np.ndarray = np.outer(1 / size, mean) / len(size)
    # Contiguous rows and reused buffers, because most of the time would otherwise go into allocating pages.
    drives, seen = np.ascontiguousarray(design.T), np.ascontiguousarray(squares.T)
    parts = np.empty((2, *seen.shape))
    raising, lowering = parts
    prior = np.zeros_like(weights.T) if expected is None else np.outer(2 / expected, np.arange(len(size)) > 0)

    def stepped(weights: np.ndarray) -> np.ndarray:
        np.matmul(weights.T, drives, out=lowering)
        np.divide(1, lowering, out=lowering)
        np.multiply(seen, lowering, out=raising)
        np.minimum(raising, FAR_SQUARES, out=raising)
        np.multiply(raising, lowering, out=raising)
        up, down = parts @ design
        return weights * (up / (down + prior)).T

    for _ in range(rounds):
        once = stepped(weights)
        twice = stepped(once)
        moved, bent = (x * size[:, None] for x in (once - weights, twice - 2 * once + weights))  # of the mean variance
        settled = (np.abs(moved + bent) <= SETTLED * mean).all()
        further = np.sqrt((moved**2).sum(0) / np.maximum((bent**2).sum(0), TINY * mean**2))
        carried = weights + (2 * further * moved + further**2 * bent) / size[:, None]
        weights = twice if settled else np.where(further > 1, np.maximum(carried, LEAST_LEFT * twice), twice)
        if settled:
            break
    weights[0] = np.maximum(weights[0], LEAST_REST * mean)
    return weights


def standard_errors(
    design: np.ndarray, squares: np.ndarray, weights: np.ndarray, block: np.ndarray, slope: np.ndarray | None = None
) -> tuple[np.ndarray, float]:
    """Standard errors (d, k) of fitted weights, from the scatter of the likelihood's derivative over blocks.

    With ``slope`` (N, k), the variance's derivative with respect to a parameter that all channels share, also its
    error.
    """
    d, k = weights.shape
    variance = design @ weights
    score = (np.minimum(squares, FAR_SQUARES * variance) - variance) / variance**2
    scale = design.mean(0)[:, None] / variance.mean(0)  # (d, k); inverse of a weight that makes up all of the variance
    shared = [] if slope is None else [d * k]
    information = np.zeros((d * k + len(shared),) * 2)
    scores = np.zeros((block.max() + 1, len(information)))
    for channel in range(k):
        columns = design / scale[:, channel]
        columns = columns if slope is None else np.column_stack([columns, slope[:, channel]])
        relative = columns / variance[:, [channel]]
        own = [*range(channel * d, channel * d + d), *shared]
        information[np.ix_(own, own)] += relative.T @ relative
        scores[:, own] += sum_of_bins(block, columns * score[:, [channel]])
    errors = np.linalg.norm(scores @ np.linalg.pinv(information, rcond=1e-9, hermitian=True), axis=0)
    return errors[: d * k].reshape(k, d).T / scale, float(errors[d * k :].sum())
