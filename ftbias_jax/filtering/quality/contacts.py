"""The wrench of each interval of contact, with its error, summed up while the parts of a result go by."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ftbias_jax.filtering.noise.contact import Contact
from ftbias_jax.filtering.result import Filtered
from ftbias_jax.types import Array


class ContactInterval(NamedTuple):
    """A stretch of a log in which something touches the tool; wrenches on the tool, sensor frame."""

    start: float
    """s, as recorded: its first sample."""
    end: float
    """s, its last sample."""
    samples: int
    wrench: Array
    """(6,) N, Nm: mean of contact_wrench; NaN on axes that were not measured."""
    std: Array
    """(6,) N, Nm: root mean square of contact_wrench_std, the error of one sample. The mean's error is between that of
    the bias, which all samples share, and this."""
    peak: Array
    """(6,) N, Nm: contact_wrench where it is largest, axis by axis."""

    def plain(self) -> dict[str, Any]:
        """Numbers and lists for JSON; what has no value is None."""
        return {name: _plain(value) for name, value in self._asdict().items()}


class Tally(NamedTuple):
    """Sums over the samples of one contact so far."""

    start: float
    end: float
    samples: int
    count: Array
    """(6,) measured."""
    total: Array
    squares: Array
    """Of the standard deviation."""
    peak: Array


def start(contacts: Sequence[Contact]) -> list[Tally]:
    """Before the first part.

    Args:
        contacts: that were found in the log.
    """
    return [Tally(np.nan, np.nan, 0, *np.zeros((4, 6))) for _ in contacts]


def add(tallies: Sequence[Tally], contacts: Sequence[Contact], part: Filtered, log_start: float) -> list[Tally]:
    """Take in the next part.

    Args:
        tallies: so far.
        contacts: in s of the log's own time.
        part: of the result, in s as recorded.
        log_start: s between the two.
    """
    if not contacts or part.contact_wrench is None or part.contact_wrench_std is None:
        return list(tallies)
    t, added = part.t - log_start, []
    for tally, contact in zip(tallies, contacts, strict=True):
        rows = slice(*np.searchsorted(t, [contact.start, contact.end]))
        added.append(_with_rows(tally, part.t[rows], part.contact_wrench[rows], part.contact_wrench_std[rows]))
    return added


def _with_rows(tally: Tally, t: Array, wrench: Array, std: Array) -> Tally:
    """A contact with more of its samples: t (R,), wrench and std (R, 6)."""
    if not len(t):
        return tally
    seen = np.isfinite(wrench)
    wrench = np.where(seen, wrench, 0.0)
    farthest = wrench[np.abs(wrench).argmax(0), np.arange(6)]
    return Tally(
        start=tally.start if tally.samples else float(t[0]),
        end=float(t[-1]),
        samples=tally.samples + len(t),
        count=tally.count + seen.sum(0),
        total=tally.total + wrench.sum(0),
        squares=tally.squares + np.where(seen, std**2, 0.0).sum(0),
        peak=np.where(np.abs(farthest) > np.abs(tally.peak), farthest, tally.peak),
    )


def finish(tallies: Sequence[Tally]) -> tuple[ContactInterval, ...]:
    """The intervals in which there are samples."""
    found = []
    for tally in tallies:
        if tally.samples:
            count = np.where(tally.count, tally.count, np.nan)
            mean, std = tally.total / count, np.sqrt(tally.squares / count)
            peak = np.where(tally.count, tally.peak, np.nan)
            found.append(ContactInterval(tally.start, tally.end, tally.samples, mean, std, peak))
    return tuple(found)


def contact_intervals(filtered: Filtered, contacts: Sequence[Contact], log_start: float) -> tuple[ContactInterval, ...]:
    """The intervals of a result that is whole.

    Args:
        filtered: as recorded.
        contacts: in s of the log's own time.
        log_start: s between the two.
    """
    return finish(add(start(contacts), contacts, filtered, log_start))


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return [float(x) if np.isfinite(x) else None for x in value]
    return value
