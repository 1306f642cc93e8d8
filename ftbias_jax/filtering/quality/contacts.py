"""The wrench of each interval of contact, with its error, accumulated over the parts of a result."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ftbias_jax.filtering.noise.contact import Contact
from ftbias_jax.filtering.result import Filtered
from ftbias_jax.io.atomic import plain
from ftbias_jax.types import Array


class ContactInterval(NamedTuple):
    """An interval of a log in which something touches the tool; wrenches on the tool, sensor frame."""

    start: float
    """s, as recorded: stamp of its first sample."""
    end: float
    """s, stamp of its last sample."""
    samples: int
    wrench: Array
    """(6,) N, Nm: mean of contact_wrench; NaN on axes that were not measured."""
    std: Array
    """(6,) N, Nm: root mean square of contact_wrench_std, the error of one sample. The error of the mean is between
    that of the bias, which all samples share, and this."""
    peak: Array
    """(6,) N, Nm: contact_wrench of largest magnitude, axis by axis."""

    def plain(self) -> dict[str, Any]:
        """Numbers and lists for JSON; what has no value is None."""
        return dict(plain(self._asdict()))


Sums = tuple[tuple[float, float], int, Array, Array, Array, Array]
"""Sums over the samples of a contact in one part: stamps of the first and the last, number of samples, and by axis the
number measured, their sum, the sum of squared standard deviations, and the largest."""


def start(contacts: Sequence[Contact]) -> list[list[Sums]]:
    """Empty sums before the first part, for contacts that were found in the log."""
    return [[] for _ in contacts]


def add(tallies: list[list[Sums]], contacts: Sequence[Contact], part: Filtered, log_start: float) -> list[list[Sums]]:
    """Add the next part of the result, whose stamps are ``log_start`` s after the time of log and contacts."""
    wrench, std = part.contact_wrench, part.contact_wrench_std
    if not contacts or wrench is None or std is None:
        return tallies
    edges = np.searchsorted(part.t - log_start, [(contact.start, contact.end) for contact in contacts])
    rows = [slice(*both) for both in edges]
    return [[*sums, *_sums(part.t[at], wrench[at], std[at])] for sums, at in zip(tallies, rows, strict=True)]


def _sums(t: Array, wrench: Array, std: Array) -> list[Sums]:
    if not len(t):
        return []
    seen = np.isfinite(wrench)
    wrench = np.where(seen, wrench, 0.0)
    largest = wrench[np.abs(wrench).argmax(0), np.arange(6)]
    squares = np.where(seen, std**2, 0.0).sum(0)
    return [((float(t[0]), float(t[-1])), len(t), seen.sum(0), wrench.sum(0), squares, largest)]


def finish(tallies: Sequence[Sequence[Sums]]) -> tuple[ContactInterval, ...]:
    """The contact intervals that contain samples."""
    found = []
    for times, samples, *of_axes in (zip(*sums, strict=True) for sums in tallies if sums):
        measured, total, squares, largest = map(np.array, of_axes)
        count = measured.sum(0)
        count = np.where(count, count, np.nan)
        peak = np.where(np.isnan(count), np.nan, largest[np.abs(largest).argmax(0), np.arange(6)])
        mean, std = total.sum(0) / count, np.sqrt(squares.sum(0) / count)
        found.append(ContactInterval(times[0][0], times[-1][1], sum(samples), mean, std, peak))
    return tuple(found)
