"""The setup mended: what a diagnosis found becomes part of what the robot's owner states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from ftbias_jax.diagnosis.report.tables import parameter_words
from ftbias_jax.diagnosis.result import Candidate, FoundTerm
from ftbias_jax.model.effects.catalogue import values_from_setup
from ftbias_jax.model.effects.terms.parse import NAME as TERM
from ftbias_jax.model.own_effects import catalogue_of_setup
from ftbias_jax.setup.types import Setup


def with_causes(setup: Setup, causes: Sequence[Candidate], terms: Sequence[FoundTerm] = ()) -> Setup:
    """The setup with the causes and terms among its effects; the same setup if there are none.

    Args:
        setup: of the diagnosis.
        causes: their values replace those the setup has for the same effect.
        terms: come after those that the setup has.
    """
    effects: dict[str, Any] = {**setup.effects, **{cause.effect: cause.parameters for cause in causes}}
    if terms:
        effects[TERM] = [*effects.get(TERM, ()), *(term.section for term in terms)]
    values_from_setup(effects, catalogue=catalogue_of_setup(setup))  # what is written can be read
    comments = {
        f"effects.{cause.effect}.{name}": f"ftbias diagnose: {words}"
        for cause in causes
        for name, words in parameter_words(cause)
    }
    return replace(setup, effects=effects, comments={**setup.comments, **comments})
