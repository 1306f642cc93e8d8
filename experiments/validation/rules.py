"""When a diagnosis counts as right, and the shares that come of it with their confidence intervals."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from ftbias_jax.model.effects.catalogue import CATALOGUE
from validation.labels import Label

MOST_TWINS = 3
"""A diagnosis that lists more twins than this names nothing."""
FAILED: Mapping[str, Any] = {"verdict": "failed", "causes": [], "gap": {"shrink": 0.0}}
"""Stands for a diagnosis that was not written."""
ORACLE_SHRINK = 1.0
"""Of who knows the true effects and their parameters: only the noise is left, so after = floor in
1 - (after^2 - floor^2) / (before^2 - floor^2), whatever the gap was."""
SHRINK_MARGIN = 0.05


class Share(NamedTuple):
    """A count of successes."""

    hits: int
    of: int

    def interval(self) -> tuple[float, float]:
        """Wilson's 95 % confidence interval of the share; 0 to 1 where nothing was counted."""
        if self.of == 0:
            return 0.0, 1.0
        n, p, z = self.of, self.hits / self.of, 1.959964
        centre = (p + z**2 / (2 * n)) / (1 + z**2 / n)
        half = z / (1 + z**2 / n) * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
        return float(max(centre - half, 0.0)), float(min(centre + half, 1.0))

    def __str__(self) -> str:
        """Count, percent, interval."""
        if self.of == 0:
            return f"{'0/0':>8s}"
        low, high = self.interval()
        return f"{f'{self.hits}/{self.of}':>8s} {self.hits / self.of:5.0%}  ({low:.0%} to {high:.0%})"

    def plain(self) -> dict[str, Any]:
        """For JSON."""
        low, high = self.interval()
        share = self.hits / self.of if self.of else None
        return {"hits": self.hits, "of": self.of, "share": share, "low": low, "high": high}


def share(truths: Iterable[bool]) -> Share:
    """How many of them are true."""
    listed = list(truths)
    return Share(sum(listed), len(listed))


def named(said: Mapping[str, Any]) -> list[set[str]]:
    """For each cause of a diagnosis, the effects it names: itself and at most three declared twins."""
    return [{cause["effect"], *cause.get("indistinguishable_from", [])[:MOST_TWINS]} for cause in said["causes"]]


def called(said: Mapping[str, Any]) -> str:
    """The diagnosis in one word: its causes, or its verdict if it names none."""
    return "+".join(cause["effect"] for cause in said["causes"]) or str(said["verdict"])


def is_right(label: Label, said: Mapping[str, Any]) -> bool:
    """Whether a diagnosis is right, by the rule of the log's group.

    None: the verdict is none. Unlisted: unknown, described or partly explained. One effect: it is named first. Two:
    both are named.
    """
    match label.group:
        case "none":
            return bool(said["verdict"] == "none")
        case "unlisted":
            return said["verdict"] in ("unknown", "described", "partly_explained")
        case "pair":
            return all(is_named(label, said))
    names = named(said)
    return bool(names) and set(label.effects) <= names[0]


def is_named(label: Label, said: Mapping[str, Any]) -> list[bool]:
    """For each true effect, whether any cause names it."""
    return [any(effect in names for names in named(said)) for effect in label.effects]


def has_mean_gap(label: Label) -> bool:
    """Whether there is anything to shrink: an effect on the mean reading, and a gap that is not faint."""
    of_mean = [effect for effect in label.effects if effect in CATALOGUE and CATALOGUE[effect].hook != "record"]
    return bool(of_mean) and label.group in ("single", "pair")


def left_out(effect: str, said: Mapping[str, Any]) -> str:
    """What became of a diagnosis that may not name the true effect.

    Returns:
        "unknown", "described", "partly_explained", "none" or "failed", as the verdict is; of the explained, "twin" if
        every cause is a twin of the effect in the catalogue (or names one), else "wrong".
    """
    if said["verdict"] != "explained":
        return str(said["verdict"])
    return "twin" if names_only_twins(effect, said) else "wrong"


def names_only_twins(effect: str, said: Mapping[str, Any]) -> bool:
    """Whether every cause is, or names, what the catalogue declares as a twin of the effect, from either side."""
    twins = {twin.effect for twin in CATALOGUE[effect].twins}
    twins |= {name for name, entry in CATALOGUE.items() if effect in {twin.effect for twin in entry.twins}}
    return all(names & twins for names in named(said))
