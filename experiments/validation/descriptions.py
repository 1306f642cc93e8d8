"""Comparison of a diagnosis of an effect outside the catalogue with its label: drive, names, shrink, coefficients."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ftbias_jax.types import Array
from validation.labels import Label, Withheld
from validation.parameters import WITHIN, numbers
from validation.rules import MOST_TWINS, named


class Coefficient(NamedTuple):
    """One coefficient, of (N,) numbers, of the first term with a stated standard error and a known true value."""

    unit: str
    error: Array
    """Stated minus true value, in that unit."""
    stderr: Array

    @property
    def inside(self) -> Array:
        """(N,) whether the true value is within three standard errors."""
        found: Array = np.abs(self.error) <= WITHIN * self.stderr
        return found


class Judged(NamedTuple):
    """One log of a withheld kind, with its label and its diagnosis."""

    truth: Withheld
    gap_sigmas: float
    verdict: str
    drive: str
    """Drive of the first term; "" without terms."""
    also: tuple[str, ...]
    """Drives that the diagnosis itself declares equivalent to that drive, at most three."""
    anywhere: bool
    """Whether any term has the true drive."""
    wrong: tuple[str, ...]
    """Catalogue effects among the causes that are not nearly the same as the true effect according to the label."""
    nearly: tuple[str, ...]
    """Catalogue effects among the causes that the label declares as nearly the same as the true effect."""
    shrink: float
    """Held-out share of the mean square gap that the findings remove, as the diagnosis states it."""
    second: float | None
    """Shrink of a second log of the same robot and effect when the findings from the first are applied to it."""
    coefficients: tuple[Coefficient, ...]

    @property
    def right(self) -> bool:
        """Whether the drive of the first term is the true one."""
        return self.drive == self.truth.drive

    @property
    def equivalent(self) -> bool:
        """Whether that drive is the true one or equivalent to it according to the label."""
        return self.right or self.drive in self.truth.equivalent

    @property
    def claimed(self) -> bool:
        """Whether that drive, or one declared equivalent to it by the diagnosis, is the true one or its equivalent."""
        return self.equivalent or bool({self.truth.drive, *self.truth.equivalent} & set(self.also))

    @property
    def of_mean(self) -> bool:
        """Whether there is a mean gap to shrink."""
        return self.truth.oracle_shrink is not None


def judge(label: Label, said: Mapping[str, Any]) -> Judged:
    """Compare a diagnosis (JSON of schema 1 or 2) with the label of a withheld kind.

    Args:
        label: one with ``withheld``.
        said: the diagnosis; schema 1 has no terms.

    Raises:
        ValueError: the label is not of a withheld kind.
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
    """Coefficients in both diagnosis and label, if the drive is the true one; otherwise they mean different things."""
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
