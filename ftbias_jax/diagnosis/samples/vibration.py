"""Noise whose variance grows with the speeds of the joints, judged by held-out likelihood.

The squares of what the fast waves leave of each sample have the noise's variance as their mean. A constant and
squared joint speeds with weights that are not negative are fitted to them by the maximum of the likelihood of normal
noise, and must predict the variance on blocks of the log that they have not seen better than a constant does. A speed
from which the variance grows with the speed alone must predict it better again.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.samples.growth_errors import stderr_with_speed, variance_stderr
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
from ftbias_jax.model.motion_noise import MotionNoise, effective_speed_squared

BLOCK_SECONDS = 20.0
BLOCKS = 20
"""At least, in a log too short for so many of these blocks: the standard error of the gain comes from them."""
FOLDS = 4
MOST_ROWS = 12288
"""Longer logs are averaged over runs of samples, in which the speed hardly changes."""
ROUNDS, SETTLED = 200, 1e-5
"""Of the fit, and the share of the mean variance by which a round then changes a term."""
SPEEDS, FINER = tuple(2.0**-k for k in range(6)), (0.5, 0.25, 0.125)
"""rad/s from which the variance may grow with the speed alone, tried first; then powers of 2 on either side of the
best. A joint slower than the last of them rests, so a lower speed would change nothing."""
ROUNDS_TO_COMPARE = 60
"""Of the fits that only choose the speed."""


class Growth(NamedTuple):
    """Noise that grows with the speeds of n joints in k channels."""

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
    speed: float | None = None
    """rad/s from which it grows with the speed alone (``effective_speed_squared``); None = with its square, always."""
    speed_stderr: float = 0.0
    rest_factor: np.ndarray | float = 1.0
    """(k,) by which the standard deviation at rest differs if it grows with the square at any speed: which form the
    growth has is not so sure that the difference would be evidence."""

    @property
    def detected(self) -> bool:
        """It is certain, and large enough to matter."""
        certain = self.nats > max(GROWTH_NATS, CERTAIN * self.nats_stderr)
        return certain and self.visible > GROWTH_VISIBLE

    @property
    def relative(self) -> MotionNoise:
        """The growth per variance at rest."""
        return MotionNoise(self.variance / self.rest, self.speed)


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
    block = ((t[:, 0] - t[0, 0]) // min(BLOCK_SECONDS, np.ptp(t) / BLOCKS)).astype(int)
    whole = fast.sum(1)
    shares = samples / len(t)

    def drives(most: float | None) -> np.ndarray:
        return average_runs(effective_speed_squared(speed[:, moving], most), run)

    plain = _judged(_design(fast[:, moving]), squares, block, shares)
    found, most = plain, None
    if _visible(plain, whole) > GROWTH_VISIBLE and plain.nats.sum() > GROWTH_NATS:
        at = _likeliest_speed(drives, squares)
        bent = _judged(_design(drives(at)), squares, block, shares)
        found, most = (bent, at) if _is_better(bent, plain) else (plain, None)
    variance, error = np.zeros((2, len(mean), squares.shape[1]))
    if most is None:
        stderr, speed_error = variance_stderr(found.design, squares, found.weights, block), 0.0
    else:
        stderr, speed_error = stderr_with_speed(found.design, most, squares, found.weights, block)
    variance[moving], error[moving] = found.weights[1:], np.where(found.better, stderr[1:], 0)
    rested = float((whole <= SLOW**2 * whole[_fastest(whole)].mean()).mean())
    return Growth(
        variance,
        error,
        found.weights[0],
        float(found.nats.sum()),
        float(np.sqrt(len(found.nats)) * found.nats.std()),
        _visible(found, whole),
        rested >= RESTED,
        most,
        speed_error,
        np.sqrt(plain.weights[0] / found.weights[0]),
    )


class _Judged(NamedTuple):
    """One form of the growth."""

    design: np.ndarray
    """(N, d): ones, and what the variance grows with."""
    weights: np.ndarray
    """(d, k)."""
    better: np.ndarray
    """(k,) bool: channels that grow; the others keep their constant."""
    nats: np.ndarray
    """(blocks,) over a constant, on blocks that both have not seen."""


def _judged(design: np.ndarray, squares: np.ndarray, block: np.ndarray, share: float) -> _Judged:
    gains = held_out_gains(design, squares, block) * share
    better = gains.sum(0) > 0
    weights = fit_variance(design, squares)
    weights = np.where(better, weights, np.outer(np.eye(len(weights))[0], squares.mean(0)))
    return _Judged(design, weights, better, gains[:, better].sum(1))


def _design(drives: np.ndarray) -> np.ndarray:
    return np.column_stack([np.ones(len(drives)), drives])


def _fastest(whole: np.ndarray) -> np.ndarray:
    """(N,) bool: the tenth in which the squared speeds of all joints together are largest."""
    fastest: np.ndarray = whole >= np.quantile(whole, 0.9)
    return fastest


def _visible(found: _Judged, whole: np.ndarray) -> float:
    extra = found.design[:, 1:] @ found.weights[1:]
    return float(np.sqrt(1 + (extra[_fastest(whole)].mean(0) / found.weights[0]).max()))


def _is_better(bent: _Judged, plain: _Judged) -> bool:
    """Whether a form gains over a simpler one on unseen blocks, by their signed ranks (Wilcoxon 1945).

    One wild block on which the simpler form is all wrong would make the mean gain, and its scatter.
    """
    more = bent.nats - plain.nats
    count = len(more)
    ranks = np.argsort(np.argsort(np.abs(more))) + 1
    scatter = np.sqrt(count * (count + 1) * (2 * count + 1) / 6)
    return bool(more.sum() > GROWTH_NATS and (np.sign(more) * ranks).sum() > CERTAIN * scatter)


def _likeliest_speed(drives: Callable[[float | None], np.ndarray], squares: np.ndarray) -> float:
    """The speed, rad/s, from which the variance grows with the speed alone, whatever the weights."""

    def nats(most: float) -> float:
        design = _design(drives(most))
        variance = design @ fit_variance(design, squares, ROUNDS_TO_COMPARE)
        return float(-(np.log(variance) + np.minimum(squares / variance, FAR_SQUARES)).sum() / 2)

    tried = {most: nats(most) for most in SPEEDS}
    for power in FINER:
        best = max(tried, key=lambda most: tried[most])
        tried |= {most: nats(most) for most in (best * 2**power, max(best / 2**power, SPEEDS[-1]))}
    return max(tried, key=lambda most: tried[most])


def average_runs(x: np.ndarray, length: int) -> np.ndarray:
    """(N, ...) -> (N // length, ...) means over runs of so many rows."""
    count = len(x) // length
    mean: np.ndarray = x[: count * length].reshape(count, length, *x.shape[1:]).mean(1)
    return mean


def fit_variance(design: np.ndarray, squares: np.ndarray, rounds: int = ROUNDS) -> np.ndarray:
    """Weights (d, k), none negative, of the most likely variance ``design @ weights`` of normal noise.

    Every round multiplies each weight by the ratio of the two parts of its derivative, so that signs never change;
    at the maximum the ratio is 1, or the weight goes to 0.

    Args:
        design: (N, d) not negative, the first column ones.
        squares: (N, k) of the noise.
        rounds: at most.
    """
    size, mean = design.mean(0), squares.mean(0)
    weights: np.ndarray = np.outer(1 / size, mean) / len(size)
    # Long rows in the order in memory, into the same memory every round: most of the time would go into new pages.
    drives, seen = np.ascontiguousarray(design.T), np.ascontiguousarray(squares.T)
    parts = np.empty((2, *seen.shape))
    raising, lowering = parts
    for _ in range(rounds):
        np.matmul(weights.T, drives, out=lowering)
        np.divide(1, lowering, out=lowering)
        np.multiply(seen, lowering, out=raising)
        np.minimum(raising, FAR_SQUARES, out=raising)
        np.multiply(raising, lowering, out=raising)
        up, down = parts @ design
        before, weights = weights, weights * (up / down).T
        moved = np.abs(weights - before) * size[:, None]  # what it changes in the mean variance
        if (moved <= SETTLED * mean).all():
            break
    weights[0] = np.maximum(weights[0], LEAST_REST * mean)
    return weights


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
