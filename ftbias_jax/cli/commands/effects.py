"""``ftbias effects``: list the catalogue, describe an effect, or check the user's own effects."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ftbias_jax.cli.given import start_jax
from ftbias_jax.errors import UsageError

if TYPE_CHECKING:
    from ftbias_jax.model.effects.types import Effect, Parameter


def run(arguments: argparse.Namespace) -> int:
    """List, describe or check effects; returns 1 if a check found a fault, else 0."""
    start_jax()
    from ftbias_jax.model.effects.catalogue import CATALOGUE, check_names
    from ftbias_jax.model.own_effects import catalogue_with, installed, load_all

    words = arguments.words
    if words[:1] == ["check"]:
        return check([*words[1:], *arguments.own_effects])
    catalogue = catalogue_with(load_all(tuple(arguments.own_effects)))
    check_names(words, "NAME", catalogue)
    if words:
        print("\n\n".join("\n".join(describe(catalogue[name])) for name in words))
        return 0
    for effect in catalogue.values():
        mark = "" if effect.name in CATALOGUE else " (your own)"
        print(f"{effect.name:18s} {effect.stage:12s} {effect.explanation}{mark}")
    for entry in installed():
        print(f"{entry.name:18s} {'':12s} of an installed package; to use it: --effects {entry.name}")
    return 0


def check(files: list[str]) -> int:
    """Print the faults of the effects in files, one per line; returns 1 if there are any, else 0."""
    from ftbias_jax.diagnosis.check_effects import check_effects
    from ftbias_jax.diagnosis.regression.coordinates import why_not_fitted
    from ftbias_jax.model.own_effects import load_all

    if not files:
        raise UsageError("needs the file to check", field="check", remedy="write ftbias effects check my_effects.py")
    effects = load_all(tuple(files))
    faults = check_effects(effects)
    for fault in faults:
        print(f"ftbias: {fault}", file=sys.stderr)
    for effect in effects if not faults else ():
        reason = why_not_fitted(effect)
        print(f"{effect.name}: in order" + (f"; not looked for in a diagnosis, because {reason}" if reason else ""))
    return 1 if faults else 0


def describe(effect: Effect) -> Iterator[str]:
    """Description of an effect, line by line."""
    yield f"{effect.name} ({effect.stage}): {effect.explanation}"
    for parameter in effect.parameters:
        yield f"  {parameter.name} [{parameter.unit}]: {parameter.meaning}"
        yield f"      {'; '.join(_numbers(parameter))}"
    if effect.needs:
        yield f"  needs in the log: {', '.join(effect.needs)}"
    for twin in effect.twins:
        what = "is indistinguishable from" if twin.exact else "looks like"
        other = "nothing at all" if twin.effect == "none" else twin.effect
        yield f"  {what} {other}: {twin.separate_by}"
    yield f"  what to do: {effect.remedy}"


def _numbers(parameter: Parameter) -> Iterator[str]:
    shape = "x".join("n" if size == -1 else str(size) for size in parameter.shape)
    yield f"{shape} numbers" if shape else "one number"
    yield f"from {_span(parameter.lower)} to {_span(parameter.upper)}"
    yield f"does nothing at {'what the setup states' if callable(parameter.neutral) else _span(parameter.neutral)}"
    if np.any(np.asarray(parameter.scale) != 0):
        yield f"typically off by {_span(parameter.scale)}"
    if parameter.search:
        yield "searched from several starts"
    if parameter.optional:
        yield "may be left out"


def _span(value: object) -> str:
    low, high = (f"{edge(np.asarray(value, float)):g}" for edge in (np.min, np.max))
    return low if low == high else f"{low}..{high}"
