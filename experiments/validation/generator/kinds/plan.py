"""All withheld kinds, and which log shows which, in which form, and how large: fixed by the seed alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from validation.generator.kinds.events import EVENTS
from validation.generator.kinds.fields import FIELDS
from validation.generator.kinds.gauges import GAUGES
from validation.generator.kinds.moving import MOVING
from validation.generator.kinds.slow import SLOW

ALL_ALONG = {kind.name: kind for kind in (*FIELDS, *MOVING, *SLOW, *GAUGES)}
"""Two for every drive of a description, one of them unseen until the end; no name is one of a catalogue."""
KINDS = ALL_ALONG | {kind.name: kind for kind in EVENTS}
"""With those that begin and end, or act in one place."""

SMALLEST, LARGEST = 0.3, 10.0
"""Noise sigmas of gap; evenly spread on the scale of the logarithm."""
LARGEST_NOISE = 4.0
"""The same of a kind that only adds noise, from 0.5 on: fainter noise is not seen in a short log."""


@dataclass(frozen=True)
class Job:
    """What one log is to show."""

    kind: str
    form: str
    gap_sigmas: float


def chosen(which: str) -> list[str]:
    """Names of the kinds that are "seen", "unseen", "all" of these, or "events"."""
    if which == "events":
        return [kind.name for kind in EVENTS]
    return [name for name, kind in ALL_ALONG.items() if which == "all" or kind.unseen == (which == "unseen")]


def make_plan(which: str, count: int, seed: int) -> list[Job]:
    """``count`` jobs: kinds and forms in turn, sizes evenly spread, all in random order.

    Args:
        which: "seen", "unseen", "all" or "events".
        count: logs.
        seed: the same makes the same plan.
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
