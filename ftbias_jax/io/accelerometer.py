"""An accelerometer's offset and gains, by gravity as the recorded orientation has it.

A MEMS accelerometer is off by some hundredths of gravity, and differently in each orientation. Added up to a velocity
that grows by the second; as an acceleration it moves the bias of a tool of one kilogram by tenths of a newton.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

BLOCK = 0.2
"""s over which samples are averaged: longer than vibration, shorter than a motion."""
PRIOR_STD = np.array([0.5, 0.03, 0.03, 0.03])
"""m/s^2 of offset, and per m/s^2 along each axis: what an accelerometer may be off by before the log says more (MEMS:
50 mg of offset, 3 % of gain and of misalignment)."""
NOISE = 0.02
"""m/s^2: of a block at rest."""
NEAR = 2
"""Blocks before and after one that must be as quiet, for it to be at rest."""
HEAVY_TAILS = 3.0
"""Degrees of freedom of Student's t: the sensor's own acceleration is rare and large."""
MEDIAN = 0.6745
"""Of the sizes of normal numbers, in standard deviations."""
ROUNDS, LEAST_BLOCKS = 30, 8
LEAST_GAIN = 12.0
"""nats over an accelerometer that is right, beyond the price of twelve numbers: half the logarithm of the number of
blocks each (BIC)."""
MISTAKE = 3.0
"""A priori standard deviations beyond which it is no error of an accelerometer, but a mistake of axes or units."""


class Calibration(NamedTuple):
    """What to take off a specific force, in the sensor's axes."""

    correction: Float[np.ndarray, "N 3"]
    """(N, 3) m/s^2; 0 where the log is too restless to show more than chance would."""
    std: Float[np.ndarray, " 3"]
    """(3,) m/s^2, standard deviation of what is left, in the orientation in which it is known worst."""


def calibrate_accelerometer(
    t: Float[np.ndarray, " N"], specific_force: Float[np.ndarray, "N 3"], against_gravity: Float[np.ndarray, "N 3"]
) -> Calibration | None:
    """Offset b and gains G with specific force = b + (1 + G) (-gravity) + motion, by the robust mean of all motion.

    What a robot's sensor accelerates by is near zero most of the time, and at rest exactly. Blocks weigh less where the
    force changes, and are judged by Student's t (Lange, Little and Taylor, 1989).

    Args:
        t: (N,) s, increasing.
        specific_force: (N, 3) m/s^2, acceleration less gravity, sensor axes.
        against_gravity: (N, 3) m/s^2, minus gravity in the sensor's axes, by the orientation.

    Returns:
        the correction; None where the log is too short to tell, or where it would be so large that it must be a
        mistake.
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
    """nats over an axis that is right."""


def _robust(design: Float[np.ndarray, "B 4"], values: Float[np.ndarray, " B"]) -> _Axis:
    steps = np.pad(np.abs(np.gradient(values)), NEAR, mode="edge")  # the peaks of an oscillation are no rest
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
    """How many blocks in a row count as one: their correlations summed up to the first that is none."""
    total, power = 1.0, float(scores @ scores)
    for lag in range(1, len(scores) // 2):
        alike = float(scores[lag:] @ scores[:-lag]) / max(power, 1e-300)
        if alike <= 0:
            break
        total += 2 * alike
    return total
