"""Calibration of an accelerometer's offset and gains against gravity, by the recorded orientation.

A MEMS accelerometer is off by some hundredths of gravity, and differently in each orientation. Integrated to a velocity
this grows with every second; as an acceleration it shifts the bias of a tool of one kilogram by tenths of a newton.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

BLOCK = 0.2
"""s over which samples are averaged: longer than vibration, shorter than a motion."""
PRIOR_STD = np.array([0.5, 0.03, 0.03, 0.03])
"""Prior standard deviations of an accelerometer's offset, m/s^2, and of its gain along each axis, per m/s^2 (MEMS: 50
mg of offset, 3 % of gain and of misalignment)."""
NOISE = 0.02
"""m/s^2, noise of the mean of a block at rest."""
NEAR = 2
"""Blocks before and after a block that must be as quiet for it to be at rest."""
HEAVY_TAILS = 3.0
"""Degrees of freedom of Student's t: the sensor's own acceleration is rare and large."""
MEDIAN = 0.6745
"""Median magnitude of a normal variable, in standard deviations."""
ROUNDS, LEAST_BLOCKS = 30, 8
LEAST_GAIN = 12.0
"""nats of log likelihood over an accelerometer without error, beyond the penalty for twelve parameters: half the
logarithm of the number of blocks each (BIC)."""
MISTAKE = 3.0
"""Prior standard deviations beyond which an estimate is no accelerometer error but a mistake of axes or units."""


class Calibration(NamedTuple):
    """Correction to subtract from a specific force, in the sensor's axes."""

    correction: Float[np.ndarray, "N 3"]
    """(N, 3) m/s^2; 0 if the log has too much motion to show more than chance would."""
    std: Float[np.ndarray, " 3"]
    """(3,) m/s^2, standard deviation of the remaining error, in the orientation in which it is largest."""


def calibrate_accelerometer(
    t: Float[np.ndarray, " N"], specific_force: Float[np.ndarray, "N 3"], against_gravity: Float[np.ndarray, "N 3"]
) -> Calibration | None:
    """Fit offset b and gains G of specific force = b + (1 + G) (-gravity) + motion, by the robust mean of all motion.

    The acceleration of a robot's sensor is near zero most of the time, and zero at rest. Blocks weigh less where the
    force changes, and residuals follow Student's t (Lange, Little and Taylor, 1989).

    Args:
        t: (N,) s, increasing.
        specific_force: (N, 3) m/s^2, acceleration minus gravity, sensor axes.
        against_gravity: (N, 3) m/s^2, minus gravity in the sensor's axes, from the orientation.

    Returns:
        the correction; None if the log is too short, or if the correction is so large that it must be a mistake.
    """
    count = int((t[-1] - t[0]) / BLOCK) if len(t) else 0
    if count < LEAST_BLOCKS:
        return None
    block = np.minimum(((t - t[0]) / BLOCK).astype(int), count - 1)
    samples = np.bincount(block, minlength=count)
    there = samples > 0

    def means(values: Float[np.ndarray, "N 3"]) -> Float[np.ndarray, "B 3"]:
        return np.stack([np.bincount(block, x, count)[there] / samples[there] for x in values.T], 1)

    off, design = means(specific_force - against_gravity), _design(means(against_gravity))
    known = [_robust(design, column) for column in off.T]
    if any((np.abs(one.numbers) > MISTAKE * PRIOR_STD).any() for one in known):
        return None
    numbers = np.stack([one.numbers for one in known], 1)
    variance = np.stack([np.einsum("bi,ij,bj->b", design, one.covariance, design) for one in known], 1)
    corrected = sum(one.gain for one in known) > LEAST_GAIN + numbers.size * np.log(len(design)) / 2
    return Calibration(_design(against_gravity) @ (corrected * numbers), np.sqrt(variance.max(0)))


def _design(against_gravity: Float[np.ndarray, "B 3"]) -> Float[np.ndarray, "B 4"]:
    return np.column_stack([np.ones(len(against_gravity)), against_gravity])


class _Axis(NamedTuple):
    """Offset and gains of one axis."""

    numbers: Float[np.ndarray, " 4"]
    covariance: Float[np.ndarray, "4 4"]
    gain: float
    """nats of log likelihood over an axis without error."""


def _robust(design: Float[np.ndarray, "B 4"], values: Float[np.ndarray, " B"]) -> _Axis:
    steps = np.pad(np.abs(np.gradient(values)), NEAR, mode="edge")  # the peaks of an oscillation do not count as rest
    around = np.lib.stride_tricks.sliding_window_view(steps, 2 * NEAR + 1).max(1)
    scale, prior = np.hypot(NOISE, 2 * around), np.diag(PRIOR_STD**-2.0)
    numbers = np.zeros(4)
    for _ in range(ROUNDS):
        error = values - design @ numbers
        spread = scale * max(float(np.median(np.abs(error / scale))) / MEDIAN, 1.0)
        weight = (HEAVY_TAILS + 1) / (HEAVY_TAILS * spread**2 + error**2)
        information = (design.T * weight) @ design + prior
        numbers = np.linalg.solve(information, (design.T * weight) @ values)
    squares = (HEAVY_TAILS * spread**2 + (values - design @ numbers) ** 2) / (HEAVY_TAILS * spread**2 + values**2)
    alike = _correlation(weight * spread * (values - design @ numbers))
    gain = -(HEAVY_TAILS + 1) / 2 * float(np.log(squares).sum()) / alike
    return _Axis(numbers, alike * np.linalg.inv(information), gain)


def _correlation(scores: Float[np.ndarray, " B"]) -> float:
    """Number of consecutive blocks that count as one: autocorrelations summed up to the first that is not positive."""
    total, power = 1.0, float(scores @ scores)
    for lag in range(1, len(scores) // 2):
        alike = float(scores[lag:] @ scores[:-lag]) / max(power, 1e-300)
        if alike <= 0:
            break
        total += 2 * alike
    return total
