"""All withheld kinds, and the assignment of kind, form and size to the logs, determined by the seed alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from validation.generator.kinds.events import EVENTS
from validation.generator.kinds.fields import FIELDS
from validation.generator.kinds.gauges import GAUGES
from validation.generator.kinds.moving import MOVING
from validation.generator.kinds.slow import SLOW

ALL_ALONG = {kind.name: kind for kind in (*FIELDS, *MOVING, *SLOW, *GAUGES)}
"""Kinds that act throughout a log: two per drive, one of them unseen until the end; none is named in a catalogue."""
KINDS = ALL_ALONG | {kind.name: kind for kind in EVENTS}
"""All kinds, including those that are intermittent or act in one region."""

SMALLEST, LARGEST = 0.3, 10.0
"""Range of the gaps in noise sigmas, spread evenly on a logarithmic scale."""
LARGEST_NOISE = 4.0
"""Largest gap of a kind that only adds noise; the smallest is 0.5, because a short log does not show fainter noise."""


@dataclass(frozen=True)
class Job:
    """Kind, form and size of the effect in one log."""

    kind: str
    form: str
    gap_sigmas: float


def chosen(which: str) -> list[str]:
    """Return the names of the kinds that are "seen", "unseen", "all" of these, or "events"."""
    if which == "events":
        return [kind.name for kind in EVENTS]
    return [name for name, kind in ALL_ALONG.items() if which == "all" or kind.unseen == (which == "unseen")]


def make_plan(which: str, count: int, seed: int) -> list[Job]:
    """Draw ``count`` jobs in random order, with kinds and forms in turn and evenly spread sizes.

    Args:
        which: "seen", "unseen", "all" or "events".
        count: number of logs.
        seed: the same seed makes the same plan.
    """
    rng = np.random.default_rng([seed, 2])
    names = chosen(which)
    rounds = -(-count // len(names))
    order = [(names[i], turn) for turn in range(rounds) for i in rng.permutation(len(names))][:count]
    flips = dict(zip(names, rng.integers(2, size=len(names)), strict=True))
    places = (rng.permutation(count) + rng.uniform(size=count)) / max(count, 1)
    return [
        Job(name, KINDS[name].forms[(turn + flips[name]) % 2], _size(KINDS[name].drive, float(place)))
        for (name, turn), place in zip(order, places, strict=True)
    ]


def _size(drive: str, place: float) -> float:
    low, high = (0.5, LARGEST_NOISE) if drive == "noise" else (SMALLEST, LARGEST)
    return float(low * (high / low) ** place)
