"""Comparison of fitted with true parameters: errors, and whether the standard errors cover them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ftbias_jax.types import Array
from validation.labels import Label, true_parameters

WITHIN = 3.0
"""Number of standard errors within which a true value counts as covered."""


class Compared(NamedTuple):
    """One parameter of one diagnosis: its (N,) numbers that have a stated standard error and a known true value."""

    effect: str
    parameter: str
    error: Array
    """Fitted minus true value, in the units of the catalogue."""
    stderr: Array
    missed: int = 0
    """Number of true events or joints that were not found; each counts as a number outside three standard errors."""

    @property
    def inside(self) -> Array:
        """(N + missed,) whether the true value is within three standard errors."""
        return np.concatenate([np.abs(self.error) <= WITHIN * self.stderr, np.zeros(self.missed, bool)])


def compare(label: Label, said: Mapping[str, Any]) -> list[Compared]:
    """Compare the parameters of all causes that are true; a twin's parameters have a different meaning.

    A number with a standard error of 0 (or none) was not fitted by the diagnosis and is not compared. A joint's index
    has no error; if it is wrong, its offset counts as missed.
    """
    found = []
    for cause in said["causes"]:
        effect = cause["effect"]
        if effect not in label.effects:
            continue
        true = true_parameters(label, effect)
        if effect == "contact":
            found += _compare_events(cause, true)
            continue
        found += [
            Compared(effect, name, *numbers(cause["parameters"][name], cause["stderr"].get(name), value))
            for name, value in true.items()
            if name in cause["parameters"] and name != "joint"
        ]
        if effect == "encoder_offset" and round(cause["parameters"]["joint"]) != true["joint"]:
            found[-1] = Compared(effect, "offset", np.zeros(0), np.zeros(0), missed=1)
    return [one for one in found if len(one.error) or one.missed]


def numbers(said: Any, stderr: Any, true: Any) -> tuple[Array, Array]:
    """Errors and standard errors (N,) of the numbers that can be compared; JSON has null for non-finite numbers."""
    value, spread, truth = (np.array(x, float).ravel() for x in (said, stderr, true))
    value, spread, truth = np.broadcast_arrays(value, spread, truth)
    usable = np.isfinite(value) & np.isfinite(truth) & (spread > 0)
    return (value - truth)[usable], spread[usable]


def _compare_events(cause: Mapping[str, Any], true: Mapping[str, Any]) -> list[Compared]:
    """Compare each true contact with the fitted contact that overlaps it most."""
    start, end = (np.array(cause["parameters"][name], float) for name in ("start", "end"))
    pairs, missed = [], 0
    for i, (begin, last) in enumerate(zip(true["start"], true["end"], strict=True)):
        overlap = np.minimum(end, last) - np.maximum(start, begin)
        if len(overlap) and overlap.max() > 0:
            pairs.append((i, int(overlap.argmax())))
        else:
            missed += 1
    return [
        Compared("contact", name, *_of_events(cause["parameters"][name], cause["stderr"][name], truth, pairs), missed)
        for name, truth in true.items()
        if name in cause["parameters"]
    ]


def _of_events(said: Any, stderr: Any, true: Array, pairs: list[tuple[int, int]]) -> tuple[Array, Array]:
    """Errors and standard errors of one event parameter; ``pairs``: (index of the true event, of the fitted event)."""
    sides = [numbers(said[fitted], stderr[fitted], true[event]) for event, fitted in pairs]
    empty = np.zeros(0)
    return np.concatenate([empty, *(side[0] for side in sides)]), np.concatenate([empty, *(side[1] for side in sides)])
