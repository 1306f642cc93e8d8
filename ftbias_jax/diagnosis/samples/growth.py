"""Noise whose variance grows with the speeds of the joints, judged by held-out likelihood.

The squared high-frequency part of each sample has the noise variance as its mean. A constant and the squared joint
speeds, with non-negative weights, are fitted to it by maximum likelihood for normal noise, and must predict the
variance on held-out blocks of the log better than a constant does. A speed above which the variance grows linearly
instead must improve this prediction again.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.samples.types import Finding, Numbers, name_channels
from ftbias_jax.diagnosis.samples.variance_fit import (
    VarianceFit,
    average_runs,
    blocks_of,
    fit_variance,
    judge_variance,
    standard_errors,
    with_ones,
)
from ftbias_jax.diagnosis.thresholds import CERTAIN, FAR_SQUARES, GROWTH_NATS, GROWTH_VISIBLE, MOVES, RESTED, SLOW
from ftbias_jax.model.effects.fitting import GROWTH
from ftbias_jax.model.motion_noise import MotionNoise, effective_speed_squared

MOST_ROWS = 12288
"""Largest number of rows; longer logs are averaged over runs of samples in which the speed hardly changes."""
SPEEDS, FINER = tuple(2.0**-k for k in range(6)), (0.5, 0.25, 0.125)
"""rad/s, candidate speeds above which the variance grows linearly with speed, tried first; then powers of 2 on either
side of the best. A joint slower than the last of them is at rest, so a lower speed would change nothing."""
ROUNDS_TO_COMPARE = 20
"""Largest number of iterations of the fits that only select the speed."""
FAR, LOWEST = 3.0, 0.1
"""Standard errors by which the speed may be lower, and the least share of it that is then assumed."""


class Growth(NamedTuple):
    """Noise that grows with the speeds of n joints in k channels."""

    variance: np.ndarray
    """(n, k) N^2/(rad/s)^2, Nm^2/(rad/s)^2; 0 = none, or the joint hardly moves."""
    stderr: np.ndarray
    """(n, k)."""
    rest: np.ndarray
    """(k,) N^2, Nm^2: variance at rest."""
    nats: float
    """Gain in nats over the best constant on held-out blocks, for all samples of the log."""
    nats_stderr: float
    visible: float
    """Standard deviation in the fastest tenth of the log per that at rest, in the channel in which it grows most."""
    shows_rest: bool
    """Whether the log rests long enough for ``rest`` to be more than a residual of the form of the growth."""
    speed: float | None
    """rad/s above which the variance grows linearly (``effective_speed_squared``); None = always quadratically."""
    speed_stderr: float
    rest_factor: np.ndarray
    """(k,) ratio of the standard deviation at rest under quadratic growth at any speed to the reported one: the form of
    the growth is not certain enough for the difference to be evidence."""

    @property
    def detected(self) -> bool:
        """Whether the growth is significant and large enough to matter."""
        certain = self.nats > max(GROWTH_NATS, CERTAIN * self.nats_stderr)
        return certain and self.visible > GROWTH_VISIBLE

    @property
    def relative(self) -> MotionNoise:
        """The growth relative to the variance at rest."""
        return MotionNoise(self.variance / self.rest, self.speed)

    @property
    def finding(self) -> Finding:
        """The growth in six channels as a finding."""
        sentence = "the noise does not grow with the speed of the motion, or no more than it may by chance"
        if self.detected:
            grown = name_channels(np.asarray(self.variance.any(0)))
            sentence = f"noise of {grown} grows with the motion, up to {self.visible:.3g} times in the fastest tenth"
            sentence += " of the log; the gain is beyond that of a constant of the best size"
        parameters: Numbers = {"variance": self.variance.tolist()}
        errors: Numbers = {"variance": self.stderr.tolist()}
        if self.speed is not None:
            parameters["speed"], errors["speed"] = self.speed, self.speed_stderr
        return Finding(GROWTH, self.detected, parameters, errors, max(self.nats, 0.0), sentence, self.nats_stderr)


def no_growth(joints: int, rest: np.ndarray) -> Growth:
    """Result without growth, for noise of variance (k,) N^2, Nm^2."""
    zeros = np.zeros((joints, len(rest)))
    return Growth(zeros, zeros, rest, 0.0, 0.0, 1.0, True, None, 0.0, np.ones(len(rest)))


def measure_growth(t: np.ndarray, squares: np.ndarray, speed: np.ndarray, samples: int) -> Growth:
    """Fit the growth to a whole log, and judge it on held-out blocks.

    Args:
        t: (N,) s.
        squares: (N, k) N^2, Nm^2, squared noise whose mean is the variance.
        speed: (N, n) rad/s, of the joints.
        samples: number of samples of the log, of which N can be examined.
    """
    run = -(-len(t) // MOST_ROWS)
    t, squares, fast = (average_runs(x, run) for x in (t, squares, speed**2))
    mean, share = fast.mean(0), samples / len(t)
    moving = mean > MOVES**2 * mean.max()
    if not mean.any() or not (squares.mean(0) > 0).all():
        return no_growth(len(mean), squares.mean(0))
    block, whole = blocks_of(t), fast.sum(1)
    fastest = whole >= np.quantile(whole, 0.9)

    def drives(most: float) -> np.ndarray:
        return average_runs(effective_speed_squared(speed[:, moving], most), run)

    plain = judge_variance(fast[:, moving], squares, block, share)
    found, most = plain, None
    if _visible(plain, fastest) > GROWTH_VISIBLE and plain.nats.sum() > GROWTH_NATS:
        at = _likeliest_speed(drives, squares)
        bent = judge_variance(drives(at), squares, block, share)
        found, most = (bent, at) if _is_better(bent, plain) else (plain, None)
    found = found._replace(weights=np.where(found.better, _alike(found, squares), found.weights))
    stderr, speed_error = _standard_errors(found, most, squares, block)
    variance, error = np.zeros((2, len(mean), squares.shape[1]))
    variance[moving], error[moving] = found.weights[1:], np.where(found.better, stderr[1:], 0)
    rested = float((whole <= SLOW**2 * whole[fastest].mean()).mean())
    return Growth(
        variance,
        error,
        found.weights[0],
        float(found.nats.sum()),
        float(np.sqrt(len(found.nats)) * found.nats.std()),
        _visible(found, fastest),
        rested >= RESTED,
        most,
        speed_error,
        np.sqrt(plain.weights[0] / found.weights[0]),
    )


def _alike(found: VarianceFit, squares: np.ndarray) -> np.ndarray:
    """(d, k) weights with a prior that keeps those of joints that hardly move no larger than the others need to be.

    Otherwise a log in which these joints move would be assigned all of the noise that chance gave them.
    """
    size = squares.mean(0) / found.design[:, 1:].sum(1).mean()
    return fit_variance(found.design, squares, expected=size)


def _visible(found: VarianceFit, fastest: np.ndarray) -> float:
    """Largest ratio of the standard deviation in the fastest tenth, marked in (N,), to that at rest."""
    extra = found.design[:, 1:] @ found.weights[1:]
    return float(np.sqrt(1 + (extra[fastest].mean(0) / found.weights[0]).max()))


def _is_better(bent: VarianceFit, plain: VarianceFit) -> bool:
    """Whether a form gains over a simpler one on held-out blocks, by their signed ranks (Wilcoxon 1945).

    A single outlying block on which the simpler form fails would dominate the mean gain and its scatter.
    """
    more = bent.nats - plain.nats
    count = len(more)
    ranks = np.argsort(np.argsort(np.abs(more))) + 1
    scatter = np.sqrt(count * (count + 1) * (2 * count + 1) / 6)
    return bool(more.sum() > GROWTH_NATS and (np.sign(more) * ranks).sum() > CERTAIN * scatter)


def _likeliest_speed(drives: Callable[[float], np.ndarray], squares: np.ndarray) -> float:
    """The most likely speed, rad/s, above which the variance grows linearly, with the weights fitted for each speed."""

    def nats(most: float) -> float:
        design = with_ones(drives(most))
        variance = design @ fit_variance(design, squares, ROUNDS_TO_COMPARE)
        return float(-(np.log(variance) + np.minimum(squares / variance, FAR_SQUARES)).sum() / 2)

    tried = {most: nats(most) for most in SPEEDS}
    for power in FINER:
        best = max(tried, key=lambda most: tried[most])
        tried |= {most: nats(most) for most in (best * 2**power, max(best / 2**power, SPEEDS[-1]))}
    return max(tried, key=lambda most: tried[most])


def _standard_errors(
    found: VarianceFit, speed: float | None, squares: np.ndarray, block: np.ndarray
) -> tuple[np.ndarray, float]:
    """Standard errors of the weights (d, k), and of the speed, rad/s, above which the variance grows linearly.

    Where the joints are faster than that speed, the noise constrains little but the product of weight and speed. The
    errors of the weights therefore include how much larger they would be if the speed were FAR standard errors lower.
    """
    design, weights = found.design, found.weights
    alone = standard_errors(design, squares, weights, block)[0]
    if speed is None:
        return alone, 0.0
    # Solve r = design / speed^2 = u / sqrt(1 + u) for u = (dq / speed)^2.
    r = design[:, 1:] / speed**2
    u = r * (r / 2 + np.sqrt(1 + r**2 / 4))
    slope = speed * u**2 / (1 + u) ** 1.5 @ weights[1:]
    error = standard_errors(design, squares, weights, block, slope)[1]
    lower = max(speed - FAR * error, LOWEST * speed)
    larger = np.ones(len(weights))
    larger[1:] = design[:, 1:].mean(0) / effective_speed_squared(speed * np.sqrt(u), lower).mean(0)
    return np.hypot(alone, (larger - 1)[:, None] / FAR * weights), error
