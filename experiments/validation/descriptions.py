"""What a diagnosis says of an effect that is in no catalogue, held against the label: drive, names, shrink, numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ftbias_jax.types import Array
from validation.labels import Label, Withheld
from validation.parameters import WITHIN, numbers
from validation.rules import MOST_TWINS, named


class Coefficient(NamedTuple):
    """One coefficient of the first term, for which a standard error is stated and a truth known; numbers (N,)."""

    unit: str
    error: Array
    """Stated minus true, in that unit."""
    stderr: Array

    @property
    def inside(self) -> Array:
        """(N,) whether the truth lies within three standard errors."""
        found: Array = np.abs(self.error) <= WITHIN * self.stderr
        return found


class Judged(NamedTuple):
    """One log of a withheld kind, and what was said of it."""

    truth: Withheld
    gap_sigmas: float
    verdict: str
    drive: str
    """Of the first term; "" without terms."""
    also: tuple[str, ...]
    """Drives that the diagnosis itself calls equivalent to it, at most three."""
    anywhere: bool
    """Whether any term has the right drive."""
    wrong: tuple[str, ...]
    """Effects of the catalogue among the causes that are not even nearly what acts."""
    nearly: tuple[str, ...]
    """Effects of the catalogue that the label declares as nearly the same."""
    shrink: float
    """Held out."""
    second: float | None
    """Shrink of a second log of the same robot and effect, with what was said of the first one applied."""
    coefficients: tuple[Coefficient, ...]

    @property
    def right(self) -> bool:
        """The drive of the first term is the true one."""
        return self.drive == self.truth.drive

    @property
    def equivalent(self) -> bool:
        """It is the true one, or says the same by the label."""
        return self.right or self.drive in self.truth.equivalent

    @property
    def claimed(self) -> bool:
        """It is one of these, or the diagnosis calls one of these equivalent to it."""
        return self.equivalent or bool({self.truth.drive, *self.truth.equivalent} & set(self.also))

    @property
    def of_mean(self) -> bool:
        """There is a mean gap to shrink."""
        return self.truth.oracle_shrink is not None


def judge(label: Label, said: Mapping[str, Any]) -> Judged:
    """Hold a diagnosis (JSON of schema 1 or 2) against the label of a withheld kind.

    Args:
        label: with ``withheld``.
        said: the diagnosis; one of schema 1 has no terms.

    Raises:
        ValueError: the label is of no withheld kind.
    """
    if label.withheld is None:
        raise ValueError("the label is of no withheld kind")
    truth = label.withheld
    terms = said.get("terms") or [{}]
    first = terms[0]
    wrong: list[str] = []
    nearly: list[str] = []
    for cause, names in zip(said["causes"], named(said), strict=True):
        (nearly if names & set(truth.catalogue_twins) else wrong).append(str(cause["effect"]))
    return Judged(
        truth=truth,
        gap_sigmas=label.gap_sigmas,
        verdict=str(said["verdict"]),
        drive=str(first.get("drive", "")),
        also=tuple(first.get("equivalent_to", ())[:MOST_TWINS]),
        anywhere=any(term.get("drive") == truth.drive for term in terms),
        wrong=tuple(wrong),
        nearly=tuple(nearly),
        shrink=float(said["gap"]["shrink"] or 0.0),
        second=said.get("second", {}).get("shrink"),
        coefficients=_compared(truth, first),
    )


def _compared(truth: Withheld, term: Mapping[str, Any]) -> tuple[Coefficient, ...]:
    """Coefficients and parameters that both know, where the drive is the true one: others mean other things."""
    if term.get("drive") != truth.drive:
        return ()
    said = {**term.get("parameters", {}), **term.get("coefficients", {})}
    spread = {**term.get("parameters_stderr", {}), **term.get("stderr", {})}
    found = []
    for unit, true in truth.coefficients.items():
        if unit in said and np.shape(said[unit]) == np.shape(true):
            error, stderr = numbers(said[unit], spread.get(unit), true)
            if len(error):
                found.append(Coefficient(unit, error, stderr))
    return tuple(found)
