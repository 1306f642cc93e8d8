"""Spectral lines in time, of bins and of individual samples, and harmonics of a joint's angle."""

from collections.abc import Sequence

import numpy as np

from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.samples.types import SampleFindings
from ftbias_jax.diagnosis.thresholds import LEAST_POWER
from ftbias_jax.io.log import Log
from ftbias_jax.model.effects.terms.types import State

LINES = 4
PADDING = 8
"""Zero padding: factor by which the transform is longer than the log, so that a line's frequency is resolved."""
STRIDE = 16 * PADDING
"""Frequencies between two evaluations of the running median of a spectrum."""
LOWEST = 2.0
"""Hz; below, the motion itself has lines in the samples."""
NEIGHBOURS = 200 * PADDING + 1
"""Frequencies over which the running median of a spectrum is taken."""
HIGHEST_MULTIPLE = 120


def lines(problem: Problem, error: np.ndarray) -> list[float]:
    """Hz of the strongest lines in the longest log, strongest first."""
    log = int(np.argmax(problem.durations))
    own = problem.log == log
    t, e = problem.t[own], error[own]
    if len(t) < 64:
        return []
    frequency, power = _spectrum(t, e)
    return _strongest(frequency, power, np.full(len(power), np.median(power)), 1.5 / max(t[-1], 1e-9))


def fast_lines(logs: Sequence[Log], samples: Sequence[SampleFindings]) -> list[float]:
    """Hz of lines in the individual samples of the longest log, strongest first; in bins, higher ones are aliased."""
    log, found = max(zip(logs, samples, strict=True), key=lambda pair: float(pair[0].t[-1]))
    rows = np.isfinite(found.clean_wrench).all(1)
    t, wrench = np.asarray(log.t)[rows], found.clean_wrench[rows] / found.noise_std
    if len(t) < 256:
        return []
    frequency, power = _spectrum(t, np.diff(wrench, axis=0, prepend=wrench[:1]))
    padded = np.pad(power, NEIGHBOURS // 2, mode="reflect")
    usual = np.median(np.lib.stride_tricks.sliding_window_view(padded, NEIGHBOURS)[::STRIDE], axis=1)
    floor = np.interp(np.arange(len(power)), np.arange(len(usual)) * STRIDE, usual)
    return _strongest(frequency, power, floor, LOWEST)


def _spectrum(t: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Hz and power, summed over all channels, of values (T, 6) at nearly even times (T,) s."""
    even = np.linspace(t[0], t[-1], len(t))
    series = np.stack([np.interp(even, t, column) for column in values.T], 1)
    power = (np.abs(np.fft.rfft(series * np.hanning(len(t))[:, None], PADDING * len(t), axis=0)) ** 2).sum(1)
    return np.fft.rfftfreq(PADDING * len(t), even[1] - even[0]), power


def _strongest(frequency: np.ndarray, power: np.ndarray, floor: np.ndarray, lowest: float) -> list[float]:
    """Hz of the peaks above a frequency that exceed the floor most."""
    peak = np.flatnonzero((power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:]) & (frequency[1:-1] > lowest)) + 1
    peak = peak[power[peak] > LEAST_POWER * floor[peak]]
    above = power[peak] / np.maximum(floor[peak], np.finfo(float).tiny)
    return [float(f) for f in frequency[peak[np.argsort(-above)][:LINES]]]


def multiples(state: State, error: np.ndarray) -> list[tuple[int, float]]:
    """(joint, multiple) of the strongest fast harmonics of a joint's angle, as of cogging, teeth or magnets."""
    candidates = np.arange(5, HIGHEST_MULTIPLE + 1)
    found = []
    for j in range(state.q.shape[1]):
        q = state.q[:, j]
        if np.ptp(q) < 0.2:
            continue
        power = (np.abs(np.exp(1j * np.outer(candidates, q)) @ error) ** 2).sum(1)
        best = int(np.argmax(power))
        found.append((float(power[best]), j + 1, float(candidates[best])))
    return [(joint, multiple) for _, joint, multiple in sorted(found, reverse=True)[:2]]
