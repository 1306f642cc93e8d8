"""Standard errors of a variance that grows with something, from the scatter of its likelihood's slope over blocks."""

from __future__ import annotations

import numpy as np

from ftbias_jax.diagnosis.thresholds import FAR_SQUARES
from ftbias_jax.model.motion_noise import effective_speed_squared

FAR, LOWEST = 3.0, 0.1
"""Standard errors at which a speed may be, and the share of it that it is not below."""


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
