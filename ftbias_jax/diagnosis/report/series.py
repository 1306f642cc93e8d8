"""Location of the gap by channels, times, regimes and frequencies, and the series that the report shows.

The location follows from squared residuals in units of their noise: noise alone gives each square a mean of 1, so the
*excess* over 1 is the gap. A location is stated only if chance is unlikely to produce it.
"""

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import jax
import numpy as np

from ftbias_jax.diagnosis.evidence.gap import HeldOut, excess
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.evaluate import measured, over_bins, readings, sensor_axes
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.diagnosis.result import Regime, Series, Where
from ftbias_jax.diagnosis.samples.bins import sum_of_bins
from ftbias_jax.filtering.quality.consistency import chi_square_quantile
from ftbias_jax.model.kinematics.recorded_pose import FreeBody
from ftbias_jax.model.kinematics.screws import Arm
from ftbias_jax.types import AXES, AXIS_UNITS

SERIES_SECONDS = 0.2
BREAK = 10.0
"""s between two logs laid end to end."""
SIGNIFICANT = 3.0
"""Standard errors by which a stated location must differ from chance."""
NOTABLE = 1.3
"""Least ratio of a regime's share of the gap to its share of the time."""
BLOCK = 1.0
"""s, blocks of a log that are taken as independent of each other."""
WINDOW = 0.2
"""s, resolution of the intervals."""
STANDS_OUT = 1.5
"""Least ratio of an interval's mean excess to that of the whole log."""
MAX_INTERVALS = 5
BAND_EDGES = (0.0, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)
"""Hz, edges of the frequency bands."""
SMALLEST_BAND = 0.02
"""Share of the gap below which a band is not listed."""
HANN_SPREAD = 35 / 18
"""Sum of squared correlations of neighbouring frequencies under a Hann window."""
LEAST_WARMING = 1.0
"""K, range of temperature below which no warm and cold regimes are distinguished."""


class Conditions(NamedTuple):
    """Motion and temperature of the robot at the bins of the residual; NaN = not known there."""

    speed: np.ndarray
    """(B,) rad/s, norm of the joint velocities, or of the sensor's angular velocity if its pose is recorded."""
    acceleration: np.ndarray
    """(B,) rad/s^2, norm of the joint accelerations, or of the sensor's angular acceleration."""
    gravity: np.ndarray
    """(B, 3) direction of gravity in the sensor frame, unit vector."""
    load_rate: np.ndarray
    """(B,) rate of the magnitude of the load on the sensor, positive while it grows, any unit."""
    temperature: np.ndarray | None = None
    """(B,) deg C, if recorded."""


def where(problem: Problem, held: HeldOut, stages: tuple[str, ...]) -> Where:
    """Location of the gap; with several logs, the times are those of the log with the largest gap."""
    white = np.where(problem.samples > 0, held.error, np.nan)
    starts = np.concatenate([[0.0], np.cumsum(np.array(problem.durations) + BREAK)])
    whole = locate(white, problem.t + starts[problem.log], _motion(problem), stages)
    if len(problem.parts) == 1:
        return whole
    worst = int(np.argmax(np.bincount(problem.log, excess(problem, held.error).sum(1))))
    own = problem.log == worst
    motion = jax.tree.map(lambda x: x[own], _motion(problem))
    return whole._replace(intervals=locate(white[own], problem.t[own], motion, stages).intervals)


def show(problem: Problem, base: Fit, accepted: Fit, before: HeldOut, after: HeldOut) -> tuple[Series, ...]:
    """Coarse means of the innovations of each log, and of the change that the causes make to the reading."""
    without, with_causes = readings(problem, np.stack([base.z, accepted.z]))
    change = with_causes - without + accepted.of_series()
    # A constant change is no regressor, so the channel whose change varies most is taken.
    channel = int((change / problem.noise_std).var(0).argmax())
    first, last = (held.error * np.sqrt(problem.variance) for held in (before, after))
    # Innovations are nearly white, so those with the causes plus the change by the causes are those without them.
    refitted = np.where(problem.samples > 0, last + change - change.mean(0), 0.0)
    arrays = (problem.t, first, last, problem.variance, change[:, channel], refitted)
    found = []
    for log in range(len(problem.parts)):
        own = problem.log == log
        block = np.unique((problem.t[own] // SERIES_SECONDS).astype(int), return_inverse=True)[1]
        counts = np.bincount(block)
        means = [(sum_of_bins(block, np.nan_to_num(x[own])).T / counts).T for x in arrays]
        t, at_first, at_last, variance, regressor, whole = means
        noise_std, name = np.sqrt(variance / counts[:, None]), f"predicted change of {AXES[channel]}"
        found.append(Series(t, at_first, at_last, noise_std, regressor, f"{name} [{AXIS_UNITS[channel]}]", whole))
    return tuple(found)


def _motion(problem: Problem) -> Conditions:
    carrier: Arm | FreeBody = problem.parts[0].signals.model.arm
    gravity = np.asarray(problem.parts[0].signals.model.gravity)
    if isinstance(carrier, FreeBody):
        speed = over_bins(problem, lambda part: part.nominal.angular_velocity.T)
        acceleration = over_bins(problem, lambda part: part.nominal.angular_acceleration.T)
    else:
        speed = over_bins(problem, lambda part: part.signals.dq)
        acceleration = over_bins(problem, lambda part: part.signals.ddq)
    load = np.linalg.norm(np.nan_to_num(measured(problem)[:, :3]), axis=1)
    return Conditions(
        speed=np.linalg.norm(speed, axis=1),
        acceleration=np.linalg.norm(acceleration, axis=1),
        gravity=np.einsum("i,tij->tj", gravity / np.linalg.norm(gravity), sensor_axes(problem)),
        load_rate=np.gradient(load) if len(load) > 1 else np.zeros(len(load)),
        temperature=problem.temperature if np.ptp(problem.temperature) > 0 else None,
    )


def locate(white: np.ndarray, t: np.ndarray, motion: Conditions, stages: tuple[str, ...] = ()) -> Where:
    """Location of the gap in a log: channels always; intervals, regimes and bands only where they are significant.

    ``white`` (B, 6) holds residuals of means of bins at t (B,) s, increasing, in standard deviations of their noise,
    NaN = not measured. The stages of the named causes are passed through.
    """
    seen = np.isfinite(white)
    white = np.where(seen, white, 0.0)
    excess, count = np.sum(white**2 - seen, axis=1), seen.sum(axis=1)
    return Where(
        stages,
        dict(zip(AXES, _shares(white, seen).tolist(), strict=True)),
        _intervals(excess, count, t),
        _significant_regimes(excess, count, t, motion),
        _bands(white, seen, t),
    )


def _shares(white: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """(6,) shares of the channels of the mean square gap; sums to 1, equal where there is no gap."""
    mean_excess = np.sum(white**2 - seen, axis=0) / np.maximum(seen.sum(axis=0), 1)
    positive = np.maximum(mean_excess, 0.0)
    total = float(positive.sum())
    return positive / total if total > 0 else np.full(len(positive), 1 / len(positive))


def _intervals(excess: np.ndarray, count: np.ndarray, t: np.ndarray) -> tuple[tuple[float, float, float], ...]:
    """(start s, end s, gap in noise sigmas) of at most MAX_INTERVALS intervals with the largest gap, in order of time.

    ``excess`` (B,) is the sum of squares over the measured channels, ``count`` (B,) of them, minus its expectation.
    """
    if not count.any():
        return ()
    window = np.floor((t - t[0]) / WINDOW).astype(int)
    summed, measured = np.bincount(window, excess), np.bincount(window, count)
    typical = max(float(excess.sum() / count.sum()), 0.0)
    chance = 1 - 0.01 / len(summed)
    limit = [chi_square_quantile(chance, n) - n if n else np.inf for n in measured]
    loud = (summed > limit) & (summed > STANDS_OUT * typical * measured)
    found = []
    for first, last in _runs(loud):
        inside = np.flatnonzero((window >= first) & (window <= last))
        total, channels = float(excess[inside].sum()), int(count[inside].sum())
        found.append((total, float(t[inside[0]]), float(t[inside[-1]]), float(np.sqrt(1 + total / channels))))
    largest = sorted(found, reverse=True)[:MAX_INTERVALS]
    return tuple((start, end, sigmas) for _, start, end, sigmas in sorted(largest, key=lambda item: item[1]))


def _runs(marks: np.ndarray) -> list[tuple[int, int]]:
    """First and last index of each run of marks; a single unmarked window does not end a run."""
    places = np.flatnonzero(marks)
    if not len(places):
        return []
    breaks = np.flatnonzero(np.diff(places) > 2)
    firsts, lasts = np.r_[0, breaks + 1], np.r_[breaks, len(places) - 1]
    return [(int(places[a]), int(places[b])) for a, b in zip(firsts, lasts, strict=True)]


def _significant_regimes(
    excess: np.ndarray, count: np.ndarray, t: np.ndarray, motion: Conditions
) -> tuple[Regime, ...]:
    """Regimes that hold significantly more of the gap than of the time, the most significant first."""
    total = float(excess.sum())
    block = np.floor((t - t[0]) / BLOCK).astype(int) if len(t) else np.zeros(0, int)
    if _standard_errors(excess, block) < SIGNIFICANT:
        return ()
    found = []
    for name, inside in _regimes(t, motion):
        expected = float(count[inside].sum() / count.sum())
        share = min(float(excess[inside].sum()) / total, 1.0)
        evidence = _standard_errors((inside - expected) * excess, block)
        if expected > 0 and evidence > SIGNIFICANT and share > NOTABLE * expected:
            found.append((evidence, Regime(name, share, expected)))
    return tuple(regime for _, regime in sorted(found, key=lambda item: -item[0]))


def _standard_errors(terms: np.ndarray, block: np.ndarray) -> float:
    """A sum in units of its standard error, with the sums of the blocks as independent draws with mean 0."""
    sums = np.bincount(block, terms)
    spread = float(np.sqrt(sums @ sums))
    return float(sums.sum()) / spread if spread > 0 else 0.0


def _regimes(t: np.ndarray, motion: Conditions) -> Iterator[tuple[str, np.ndarray]]:
    """(name, (B,) bool: whether a bin belongs to it) for the regimes that occur in this motion."""
    yield from _outer_thirds(motion.speed, "fast motion (over {:.2g} rad/s)", "slow motion (under {:.2g} rad/s)")
    yield from _outer_thirds(
        motion.acceleration, "strong acceleration (over {:.2g} rad/s²)", "weak acceleration (under {:.2g} rad/s²)"
    )
    for column, axis in enumerate("xyz"):
        for sign, mark in ((1, "+"), (-1, "-")):
            yield f"the sensor's {mark}{axis} axis points down", sign * motion.gravity[:, column] > np.sqrt(0.5)
    yield "load rising", motion.load_rate > 0
    yield "load falling", motion.load_rate < 0
    if motion.temperature is not None and np.isfinite(motion.temperature).any():
        coldest, warmest = np.nanmin(motion.temperature), np.nanmax(motion.temperature)
        middle = (coldest + warmest) / 2
        if warmest - coldest > LEAST_WARMING:
            yield f"warm (over {middle:.1f} °C)", motion.temperature > middle
            yield f"cold (under {middle:.1f} °C)", motion.temperature < middle
    elapsed = (t - t[0]) / max(t[-1] - t[0], np.finfo(float).tiny)
    yield "first tenth of the log", elapsed < 0.1
    yield "first half of the log", elapsed < 0.5
    yield "second half of the log", elapsed >= 0.5


def _outer_thirds(values: np.ndarray, high: str, low: str) -> Iterator[tuple[str, np.ndarray]]:
    """The bins of the upper and of the lower third of a signal that varies, with the limits in the names."""
    known = values[np.isfinite(values)]
    if not len(known):
        return
    lower, upper = np.quantile(known, [1 / 3, 2 / 3])
    if upper > 1.1 * lower:
        yield high.format(upper), values > upper
        yield low.format(lower), values < lower


def _bands(white: np.ndarray, seen: np.ndarray, t: np.ndarray) -> tuple[tuple[float, float, float], ...]:
    """(low Hz, high Hz, share of the gap) of the bands with more power than white noise of the stated size."""
    if len(t) < 16 or not seen.any():
        return ()
    step = float(np.median(np.diff(t)))
    place = np.round((t - t[0]) / step).astype(int)
    grid, mask = np.zeros((2, place[-1] + 1, white.shape[1]))
    grid[place], mask[place] = white, seen
    taper = np.hanning(len(grid))[:, None]
    power = np.abs(np.fft.rfft(taper * grid, axis=0)) ** 2
    chance = np.sum(taper**2 * mask, axis=0)  # of white noise, at every frequency
    excess, spread = np.sum(power - chance, axis=1), float(np.sum(chance**2))
    frequency = np.fft.rfftfreq(len(grid), step)
    found = []
    for low, high in pairwise(BAND_EDGES):
        inside = (frequency >= low) & (frequency < high)
        if not inside.any():
            continue
        evidence = float(excess[inside].sum() / np.sqrt(HANN_SPREAD * inside.sum() * spread))
        if evidence > SIGNIFICANT:
            found.append((low, min(high, float(frequency[-1])), float(excess[inside].sum())))
    total = sum(part for *_, part in found)
    return tuple((low, high, part / total) for low, high, part in found if part > SMALLEST_BAND * total)
