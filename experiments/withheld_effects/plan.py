"""Which log gets which effects, forms and severity: fixed by the seed alone."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from catalogue import ENTRIES, LISTED, TWINS, UNLISTED

GROUPS = {"none": 12, "pairs": 12, "unlisted": 12} | dict.fromkeys(LISTED, 4)
"""Logs of every group in a set of 128; other sizes keep the shares."""


@dataclass(frozen=True)
class Job:
    """What one log is to show."""

    names: tuple[str, ...]
    forms: tuple[str, ...]
    level: int


def groups(asked: str) -> dict[str, int]:
    """Group and weight for a comma-separated list of effects, "none", "pairs", "unlisted", "catalogue" or "all".

    Raises:
        ValueError: an unknown name.
    """
    chosen: dict[str, int] = {}
    for name in asked.split(","):
        if name in ("all", "catalogue"):
            chosen |= {group: weight for group, weight in GROUPS.items() if name == "all" or group in LISTED}
        elif name in GROUPS or name in ENTRIES:
            chosen[name] = GROUPS.get(name, 4)
        else:
            known = ", ".join(["all", "catalogue", *GROUPS, *UNLISTED])
            raise ValueError(f"--effects: no effect is called {name!r}; known: {known}")
    return chosen


def make_plan(asked: str, count: int, seed: int) -> list[Job]:
    """``count`` jobs, groups in proportion, forms and levels of every effect in turn, all in random order."""
    rng = np.random.default_rng([seed, 0])
    weights = groups(asked)
    names = list(weights)
    # The k-th log of a group of weight w comes at (k + u) / w: any count is a fair sample of the groups.
    places = [((k + rng.uniform()) / weight, name) for name, weight in weights.items() for k in range(count)]
    picked = [name for _, name in sorted(places, key=lambda place: place[0])[:count]]
    jobs, seen = [], Counter[str]()
    starts = {name: rng.integers(12, size=2) for name in [*names, *ENTRIES]}
    for group in picked:
        effects = _effects(group, rng, seen, starts)
        first = effects[0] if effects else group
        level = int((starts[first][0] + seen[first]) % 3)
        forms = []
        for name in effects:
            options = ENTRIES[name][1]
            forms.append(options[(starts[name][1] + seen[name]) % len(options)])
        seen.update(effects or (group,))
        jobs.append(Job(effects, tuple(forms), level))
    return [jobs[i] for i in rng.permutation(count)]


def _effects(
    group: str, rng: np.random.Generator, seen: Counter[str], starts: dict[str, np.ndarray]
) -> tuple[str, ...]:
    if group == "none":
        return ()
    if group == "unlisted":
        names = list(UNLISTED)
        turn = sum(seen[name] for name in names) + starts["unlisted"][0]
        return (names[turn % len(names)],)
    if group != "pairs":
        return (group,)
    while True:
        pair = tuple(str(name) for name in rng.choice(list(LISTED), 2, replace=False))
        if set(pair) not in TWINS:
            return pair
