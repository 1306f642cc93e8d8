"""Assignment of effects, forms and severities to the logs, determined by the seed alone."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from validation.generator.effects.catalogue import ENTRIES, LISTED, TWINS, UNLISTED

T = TypeVar("T")

GROUPS = {"none": 12, "pairs": 12, "unlisted": 12} | dict.fromkeys(LISTED, 4)
"""Number of logs per group in a set of 132; other sizes keep the proportions."""


@dataclass(frozen=True)
class Job:
    """Effects, functional forms and severity level of one log."""

    names: tuple[str, ...]
    forms: tuple[str, ...]
    level: int


def groups(asked: str) -> dict[str, int]:
    """Map group to weight for a comma-separated list of effects, "none", "pairs", "unlisted", "catalogue" or "all".

    Raises:
        ValueError: a name is unknown.
    """
    chosen: dict[str, int] = {}
    for name in asked.split(","):
        if name in ("all", "catalogue"):
            chosen |= {group: weight for group, weight in GROUPS.items() if name == "all" or group in LISTED}
        elif name in GROUPS or name in ENTRIES:
            chosen[name] = GROUPS.get(name, 4)
        else:
            known = ", ".join(["all", "catalogue", *GROUPS, *UNLISTED])
            raise ValueError(f"no effect is called {name!r}; known: {known}")
    return chosen


def make_plan(asked: str, count: int, seed: int) -> list[Job]:
    """Draw ``count`` jobs in random order, with groups in proportion, and forms and levels of each effect in turn."""
    rng = np.random.default_rng([seed, 0])
    weights = groups(asked)
    # The k-th log of a group of weight w is placed at (k + u) / w, so any count samples the groups in proportion.
    places = [((k + rng.uniform()) / weight, name) for name, weight in weights.items() for k in range(count)]
    picked = [name for _, name in sorted(places, key=lambda place: place[0])[:count]]
    unlisted = _deck(list(UNLISTED), rng)
    levels: defaultdict[str, Iterator[int]] = defaultdict(lambda: _deck([0, 1, 2], rng))
    forms = {name: _deck(list(options), rng) for name, (_, options) in ENTRIES.items()}
    jobs = []
    for group in picked:
        names = _names(group, unlisted, rng)
        jobs.append(Job(names, tuple(next(forms[name]) for name in names), next(levels[group])))
    return [jobs[i] for i in rng.permutation(count)]


def _deck(cards: Sequence[T], rng: np.random.Generator) -> Iterator[T]:
    """Yield the cards in random order, reshuffled each time they run out."""
    while True:
        yield from (cards[i] for i in rng.permutation(len(cards)))


def _names(group: str, unlisted: Iterator[str], rng: np.random.Generator) -> tuple[str, ...]:
    if group == "none":
        return ()
    if group == "unlisted":
        return (next(unlisted),)
    if group != "pairs":
        return (group,)
    while True:
        pair = tuple(str(name) for name in rng.choice(list(LISTED), 2, replace=False))
        if set(pair) not in TWINS:
            return pair
