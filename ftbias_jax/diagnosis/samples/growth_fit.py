"""Fits a variance that grows with something; standard errors from the scatter of its likelihood's slope over blocks."""

from __future__ import annotations

import numpy as np

from ftbias_jax.diagnosis.thresholds import FAR_SQUARES, LEAST_REST
from ftbias_jax.model.motion_noise import effective_speed_squared

ROUNDS, SETTLED = 100, 1e-5
"""Of the fit, and the share of the mean variance by which a step then changes a term."""
LEAST_LEFT, TINY = 0.01, 1e-24
"""Share of a weight that is left where carrying on would pass zero; of a step that is none."""
FAR, LOWEST = 3.0, 0.1
"""Standard errors at which a speed may be, and the share of it that it is not below."""


def fit_variance(design: np.ndarray, squares: np.ndarray, rounds: int = ROUNDS) -> np.ndarray:
    """Weights (d, k), none negative, of the most likely variance ``design @ weights`` of normal noise.

    Every step multiplies each weight by the ratio of the two parts of its derivative, so that signs never change;
    at the maximum the ratio is 1, or the weight goes to 0. From two steps each channel is carried on as far as they
    shrink (SQUAREM, Varadhan and Roland 2008): alone, hundreds of them would not arrive.

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

    def stepped(weights: np.ndarray) -> np.ndarray:
        np.matmul(weights.T, drives, out=lowering)
        np.divide(1, lowering, out=lowering)
        np.multiply(seen, lowering, out=raising)
        np.minimum(raising, FAR_SQUARES, out=raising)
        np.multiply(raising, lowering, out=raising)
        up, down = parts @ design
        after: np.ndarray = weights * (up / down).T
        return after

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


def stderr_with_speed(
    design: np.ndarray, speed: float, squares: np.ndarray, weights: np.ndarray, block: np.ndarray
) -> tuple[np.ndarray, float]:
    """Standard errors of the weights (d, k), and of the speed from which the variance grows with the speed alone.

    Where the joints are faster than that speed, the noise tells little but the product of weight and speed. So the
    weights are as uncertain as they would be larger if the speed were FAR standard errors lower.

    Args:
        design: (N, d) ones, then ``effective_speed_squared`` of the joints.
        speed: rad/s, that of the design.
        squares: (N, k) of the noise.
        weights: (d, k) that were fitted.
        block: (N,) number of the block of each row.
    """
    # With r = design / speed^2 = u / sqrt(1 + u), where u = (dq / speed)^2.
    r = design[:, 1:] / speed**2
    u = r * (r / 2 + np.sqrt(1 + r**2 / 4))
    error = _stderr_of_speed(design, speed * u**2 / (1 + u) ** 1.5 @ weights[1:], squares, weights, block)
    lower = max(speed - FAR * error, LOWEST * speed)
    as_low = effective_speed_squared(speed * np.sqrt(u), lower)
    larger = np.ones(len(weights))
    larger[1:] = design[:, 1:].mean(0) / as_low.mean(0)
    alone = variance_stderr(design, squares, weights, block)
    return np.hypot(alone, (larger - 1)[:, None] / FAR * weights), error


def _stderr_of_speed(
    design: np.ndarray, slope: np.ndarray, squares: np.ndarray, weights: np.ndarray, block: np.ndarray
) -> float:
    """rad/s, with all weights fitted beside it; slope (N, k) is that of the variance by the speed."""
    d, k = weights.shape
    variance = design @ weights
    score = (np.minimum(squares, FAR_SQUARES * variance) - variance) / variance**2
    scale = design.mean(0)[:, None] / variance.mean(0)  # (d, k); of a weight that makes all of the variance
    information = np.zeros((d * k + 1, d * k + 1))
    scores = np.zeros((block.max() + 1, d * k + 1))
    for channel in range(k):
        columns = np.column_stack([design / scale[:, channel], slope[:, channel]])
        relative = columns / variance[:, [channel]]
        own = [*range(channel * d, channel * d + d), d * k]
        information[np.ix_(own, own)] += relative.T @ relative
        scores[:, own] += np.stack([np.bincount(block, x) for x in (columns * score[:, [channel]]).T], 1)
    return float(np.linalg.norm(scores @ np.linalg.pinv(information, rcond=1e-9, hermitian=True)[-1]))
