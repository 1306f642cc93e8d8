"""Causes that may be something else, although they fit: what can take nearly any shape, and what that is instead."""

from __future__ import annotations

from ftbias_jax.diagnosis.hypothesis import Hypothesis
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.proposals import entries, pulls, touches
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.model.effects.fitting import Entries, Pull, Touches

DOUBTS = {Touches: touches.doubt, Pull: pulls.doubt, Entries: entries.doubt}
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
