"""Rules for a right diagnosis, and shares of right diagnoses with confidence intervals."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from ftbias_jax.model.effects.catalogue import CATALOGUE
from validation.labels import Label

MOST_TWINS = 3
"""Number of a cause's declared twins that count as named; a longer list would name nothing in particular."""
FAILED: Mapping[str, Any] = {"verdict": "failed", "causes": [], "gap": {"shrink": 0.0}}
"""Placeholder for a diagnosis that was not written."""
ORACLE_SHRINK = 1.0
"""Shrink of an oracle that knows the true effects and parameters: only the noise remains, so after = floor in
1 - (after^2 - floor^2) / (before^2 - floor^2), whatever the gap was."""
SHRINK_MARGIN = 0.05


class Share(NamedTuple):
    """Number of successes among a number of cases."""

    hits: int
    of: int

    def interval(self) -> tuple[float, float]:
        """Wilson's 95 % confidence interval of the share; 0 to 1 without cases."""
        if self.of == 0:
            return 0.0, 1.0
        n, p, z = self.of, self.hits / self.of, 1.959964
        centre = (p + z**2 / (2 * n)) / (1 + z**2 / n)
        half = z / (1 + z**2 / n) * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
        return float(max(centre - half, 0.0)), float(min(centre + half, 1.0))

    def __str__(self) -> str:
        """Format the count, the share in percent and its interval."""
        if self.of == 0:
            return f"{'0/0':>8s}"
        low, high = self.interval()
        return f"{f'{self.hits}/{self.of}':>8s} {self.hits / self.of:5.0%}  ({low:.0%} to {high:.0%})"

    def plain(self) -> dict[str, Any]:
        """Return the share and its interval for JSON."""
        low, high = self.interval()
        share = self.hits / self.of if self.of else None
        return {"hits": self.hits, "of": self.of, "share": share, "low": low, "high": high}


def share(truths: Iterable[bool]) -> Share:
    """Count how many of the values are true."""
    listed = list(truths)
    return Share(sum(listed), len(listed))


def named(said: Mapping[str, Any]) -> list[set[str]]:
    """For each cause of a diagnosis, the effects that it names: itself and at most MOST_TWINS declared twins."""
    return [{cause["effect"], *cause.get("indistinguishable_from", [])[:MOST_TWINS]} for cause in said["causes"]]


def called(said: Mapping[str, Any]) -> str:
    """Causes of a diagnosis joined by "+", or its verdict if it names none."""
    return "+".join(cause["effect"] for cause in said["causes"]) or str(said["verdict"])


def is_right(label: Label, said: Mapping[str, Any]) -> bool:
    """Whether a diagnosis is right by the rule of the log's group.

    Group none: the verdict is none. Unlisted: the verdict is unknown, described or partly explained. Single or faint:
    the effect is named first. Pair: both effects are named.
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
    """Whether there is a gap to shrink: an effect on the mean reading, and a gap that is not faint."""
    of_mean = [effect for effect in label.effects if effect in CATALOGUE and CATALOGUE[effect].hook != "record"]
    return bool(of_mean) and label.group in ("single", "pair")


def left_out(effect: str, said: Mapping[str, Any]) -> str:
    """Classify a diagnosis whose catalogue lacks the true effect.

    Returns:
        the verdict if it is "unknown", "described", "partly_explained", "none" or "failed"; if it is "explained",
        "twin" if every cause is a catalogue twin of the effect or names one, else "wrong".
    """
    if said["verdict"] != "explained":
        return str(said["verdict"])
    return "twin" if names_only_twins(effect, said) else "wrong"


def names_only_twins(effect: str, said: Mapping[str, Any]) -> bool:
    """Whether every cause is or names a twin of the effect, declared in the catalogue by either of the two."""
    twins = {twin.effect for twin in CATALOGUE[effect].twins}
    twins |= {name for name, entry in CATALOGUE.items() if effect in {twin.effect for twin in entry.twins}}
    return all(names & twins for names in named(said))
