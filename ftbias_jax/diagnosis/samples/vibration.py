"""Noise whose variance grows with the squared speeds of the joints, judged by held-out likelihood.

The squares of what the fast waves leave of each sample have the noise's variance as their mean. A constant and
squared joint speeds with weights that are not negative are fitted to them by the maximum of the likelihood of normal
noise, and must predict the variance on blocks of the log that they have not seen better than a constant does.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.thresholds import (
    CERTAIN,
    FAR_SQUARES,
    GROWTH_NATS,
    GROWTH_VISIBLE,
    LEAST_REST,
    MOVES,
    RESTED,
    SLOW,
)

BLOCK_SECONDS = 20.0
BLOCKS = 20
"""At least, in a log too short for so many of these blocks: the standard error of the gain comes from them."""
FOLDS = 4
MOST_ROWS = 12288
"""Longer logs are averaged over runs of samples, in which the speed hardly changes."""
ROUNDS, SETTLED = 100, 1e-5
"""Of the fit, and the share of the mean variance by which a step then changes a term."""
LEAST_LEFT, TINY = 0.01, 1e-24
"""Share of a weight that is left where carrying on would pass zero; of a step that is none."""


class Growth(NamedTuple):
    """Noise that grows with the squared speeds of n joints in k channels."""

    variance: np.ndarray
    """(n, k) N^2/(rad/s)^2, Nm^2/(rad/s)^2; 0 = none, or the joint hardly moves."""
    stderr: np.ndarray
    """(n, k)."""
    rest: np.ndarray
    """(k,) N^2, Nm^2: variance at rest."""
    nats: float
    """Gain over a constant of the best size, on blocks that both have not seen; all samples of the log."""
    nats_stderr: float
    visible: float
    """Standard deviation in the fastest tenth of the log per standard deviation at rest, where it grows most."""
    shows_rest: bool
    """The log rests long enough for ``rest`` to be more than what the form of the growth leaves over."""

    @property
    def detected(self) -> bool:
        """It is certain, and large enough to matter."""
        certain = self.nats > max(GROWTH_NATS, CERTAIN * self.nats_stderr)
        return certain and self.visible > GROWTH_VISIBLE

    @property
    def relative(self) -> np.ndarray:
        """(n, k) 1/(rad/s)^2, growth per variance at rest."""
        relative: np.ndarray = self.variance / self.rest
        return relative


def no_growth(joints: int, rest: np.ndarray) -> Growth:
    """Nothing seen, in noise of variance (k,) N^2, Nm^2."""
    zeros = np.zeros((joints, len(rest)))
    return Growth(zeros, zeros, rest, 0.0, 0.0, 1.0, True)


def measure_growth(t: np.ndarray, squares: np.ndarray, speed: np.ndarray, samples: int) -> Growth:
    """Fit the growth to all of a log, and judge it on blocks.

    Args:
        t: (N,) s.
        squares: (N, k) N^2, Nm^2, whose mean is the variance.
        speed: (N, n) rad/s, of the joints.
        samples: of the log, of which N can be examined.
    """
    run = -(-len(t) // MOST_ROWS)
    t, squares, fast = (average_runs(x, run) for x in (t[:, None], squares, speed**2))
    mean = fast.mean(0)
    moving = mean > MOVES**2 * mean.max()
    nothing = no_growth(len(mean), squares.mean(0))
    if not mean.any() or not (squares.mean(0) > 0).all():
        return nothing
    design = np.column_stack([np.ones(len(fast)), fast[:, moving]])
    block = ((t[:, 0] - t[0, 0]) // min(BLOCK_SECONDS, np.ptp(t) / BLOCKS)).astype(int)
    gains = held_out_gains(design, squares, block) * samples / len(t)
    better = gains.sum(0) > 0  # a channel that does not grow keeps its constant
    weights = fit_variance(design, squares)
    stderr = variance_stderr(design, squares, weights, block)
    weights = np.where(better, weights, np.outer(np.eye(len(weights))[0], squares.mean(0)))
    variance, error = np.zeros((2, len(mean), squares.shape[1]))
    variance[moving], error[moving] = weights[1:], np.where(better, stderr[1:], 0)
    extra = fast @ variance
    whole = fast.sum(1)
    tenth = whole >= np.quantile(whole, 0.9)
    rested = float((whole <= SLOW**2 * whole[tenth].mean()).mean())
    visible = np.sqrt(1 + (extra[tenth].mean(0) / weights[0]).max())
    total = gains[:, better].sum(1)
    scatter = float(np.sqrt(len(total)) * total.std())
    return Growth(variance, error, weights[0], float(total.sum()), scatter, float(visible), rested >= RESTED)


def average_runs(x: np.ndarray, length: int) -> np.ndarray:
    """(N, ...) -> (N // length, ...) means over runs of so many rows."""
    count = len(x) // length
    mean: np.ndarray = x[: count * length].reshape(count, length, *x.shape[1:]).mean(1)
    return mean


def fit_variance(design: np.ndarray, squares: np.ndarray) -> np.ndarray:
    """Weights (d, k), none negative, of the most likely variance ``design @ weights`` of normal noise.

    Every step multiplies each weight by the ratio of the two parts of its derivative, so that signs never change;
    at the maximum the ratio is 1, or the weight goes to 0. From two steps each channel is carried on as far as they
    shrink (SQUAREM, Varadhan and Roland 2008): alone, hundreds of them would not arrive.

    Args:
        design: (N, d) not negative, the first column ones.
        squares: (N, k) of the noise.
    """
    size, mean = design.mean(0), squares.mean(0)
    weights: np.ndarray = np.outer(1 / size, mean) / len(size)
    # Long rows in the order in memory, into the same memory every round: most of the time would go into new pages.
    drives, seen = np.ascontiguousarray(design.T), np.ascontiguousarray(squares.T)
    parts = np.empty((2, *seen.shape))
    raising, lowering = parts

    def stepped(weights: np.ndarray) -> np.ndarray:
        np.matmul(weights.T, drives, out=lowering)
        np.divide(1, lowering, out=lowering)
        np.multiply(seen, lowering, out=raising)
        np.minimum(raising, FAR_SQUARES, out=raising)
        np.multiply(raising, lowering, out=raising)
        up, down = parts @ design
        after: np.ndarray = weights * (up / down).T
        return after

    for _ in range(ROUNDS):
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


def variance_stderr(design: np.ndarray, squares: np.ndarray, weights: np.ndarray, block: np.ndarray) -> np.ndarray:
    """(d, k) standard errors of the weights, from the scatter of the derivative over blocks (N,)."""
    variance = design @ weights
    score = (np.minimum(squares, FAR_SQUARES * variance) - variance) / variance**2
    scale = design.mean(0)
    stderr = np.zeros_like(weights)
    for channel in range(weights.shape[1]):
        relative = design / scale / variance[:, [channel]]
        inverse = np.linalg.pinv(relative.T @ relative, rcond=1e-9, hermitian=True)
        terms = design / scale * score[:, [channel]]
        sums = np.stack([np.bincount(block, column) for column in terms.T], 1)
        stderr[:, channel] = np.sqrt(((sums @ inverse) ** 2).sum(0)) / scale
    return stderr


def held_out_gains(design: np.ndarray, squares: np.ndarray, block: np.ndarray) -> np.ndarray:
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
    return np.stack([np.bincount(block, column) for column in gain.T], 1)
