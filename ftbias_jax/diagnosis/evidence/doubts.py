"""Causes that may be something else, although they fit: what can take nearly any shape, and what that is instead."""

from __future__ import annotations

from collections.abc import Sequence

from ftbias_jax.diagnosis.hypothesis import Hypothesis
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.proposals import entries, jumps, pulls, touches
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.model.effects.fitting import Entries, Pull, Step, Touches
from ftbias_jax.model.effects.terms.types import Term

DOUBTS = {Step: jumps.doubt, Touches: touches.doubt, Pull: pulls.doubt, Entries: entries.doubt}
"""Search of an effect -> (problem, fit, its hypothesis) -> why it may be something else, in words; "" = it may not."""


def doubt_of(problem: Problem, found: Fit, h: Hypothesis) -> str:
    """Why a cause may be something else, as the end of a sentence; "" = no reason.

    Args:
        problem: of the logs.
        found: all causes together.
        h: one of them.
    """
    search = type(problem.catalogue[h.effect].fit.search)
    return DOUBTS[search](problem, found, h) if search in DOUBTS else ""


def is_sure(problem: Problem, found: Fit) -> bool:
    """Whether no cause of a fit may be something else."""
    return not any(doubt_of(problem, found, h) for h in found.hypotheses)


def doubt_by(terms: Sequence[Term]) -> str:
    """The same of a cause that terms could take the place of, which are as good; "" = there are none."""
    drives = ", ".join(dict.fromkeys(term.drive for term in terms))
    return f"; or something that is not in the catalogue: a term does as well (drive: {drives})" if drives else ""
