"""Steps of the reading in a log that was meant to be free of contact: a tare, a touch, a load that changes."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.io.log import Log
from ftbias_jax.types import AXES, Array

WINDOW = 5
"""Readings on either side of a step whose medians are compared, so that single outliers are no step."""
LARGE = 12.0
"""Size of a step in standard deviations of the differences of these medians elsewhere in the log."""
MOST = 10
"""Number of steps that are searched for, the largest first; a log with more of them is one of contact."""
LASTING, SCATTER = 1.0, 0.2
"""s that the levels before and after a step must last, and largest scatter of the readings about them, per step."""
LEAST_GAIN = 50.0
"""nats, relative to the log's own scatter, that free jumps of the bias must gain: three times what six numbers cost."""


class Step(NamedTuple):
    """A change of the reading from one sample to the next."""

    time: float
    """s, between the last reading before it and the first after it, relative to the first sample."""
    size: Array
    """(6,) N, Nm."""

    def __str__(self) -> str:
        force = [i for i in range(3) if abs(self.size[i]) >= np.abs(self.size[:3]).max() / 2]
        axes = ", ".join(f"{AXES[i]} by {self.size[i]:.3g} N" for i in force)
        return f"{axes} at {self.time:.2f} s"


def find_steps(t: Array, left: Array) -> list[Step]:
    """Steps larger than all other changes within as short a time, whose new level lasts, in the order of time.

    They are steps of ``left`` (T, 6) N, Nm, the residual of the reading with the identified tool; NaN = not measured.
    """
    rows = np.isfinite(left).all(1)
    t, left = t[rows], left[rows]
    if len(t) < 4 * WINDOW:
        return []
    medians = np.median(np.lib.stride_tricks.sliding_window_view(left, WINDOW, axis=0), axis=2)
    changes = medians[WINDOW:] - medians[:-WINDOW]  # of row k: readings from k + WINDOW on, less those before
    scale = 1.4826 * np.median(np.abs(changes), axis=0)
    sizes = np.abs(changes / np.where(scale > 0, scale, np.inf)).max(1)
    found: list[Step] = []
    for _ in range(MOST):
        if sizes.max() < LARGE:
            break
        k = int(sizes.argmax())
        sizes[max(0, k - 2 * WINDOW) : k + 2 * WINDOW + 1] = 0
        axis = int(np.abs(changes[k, :3]).argmax())
        row = k + 1 + int(np.abs(np.diff(left[k : k + 2 * WINDOW, axis])).argmax())  # medians are a reading or two off
        if _lasts(t, left[:, axis], row, changes[k, axis]):
            found.append(Step(float(t[row - 1 : row + 1].mean()), changes[k]))
    return sorted(found, key=lambda step: step.time)


def _lasts(t: Array, left: Array, row: int, change: float) -> bool:
    """Whether one axis (T,) has one lasting level before ``row`` and another from it on, unlike after a knock."""
    fewest = 4 * WINDOW
    first, last = np.searchsorted(t, [t[row] - LASTING, t[row] + LASTING])
    before, after = left[max(0, min(first, row - fewest)) : row], left[row : max(last, row + fewest)]
    if min(len(before), len(after)) < fewest:
        return False
    scatter = max(float(np.median(np.abs(x - np.median(x)))) for x in (before, after))
    step = float(np.median(after) - np.median(before)) / change
    return scatter < SCATTER * abs(change) and abs(step - 1) < 2 * SCATTER


def with_steps(log: Log, steps: Sequence[Step]) -> Log:
    """The log with a tare at each step, so that the bias begins anew there."""
    return log._replace(rezeroed_at=tuple(sorted({*log.rezeroed_at, *(step.time for step in steps)})))


def is_gained(log: Log, before: float, after: float) -> bool:
    """Whether steps reduce the innovations, in units of the stated noise, by more than chance explains."""
    nats = np.isfinite(log.wrench).sum() / 2 * (before**2 - after**2) / after**2
    return bool(nats > LEAST_GAIN)
