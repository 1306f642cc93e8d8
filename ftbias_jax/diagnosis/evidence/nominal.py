"""What the setup states of the parameters that a diagnosis found, to be shown beside them."""

from __future__ import annotations

import numpy as np

from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.result import Candidate
from ftbias_jax.model.effects.catalogue import neutral_values


def with_nominal(problem: Problem, candidate: Candidate) -> Candidate:
    """A candidate with what the setup states of its parameters: in its section of the effect, or in one of its own.

    The tool's mass stands in [tool] and gravity in [robot]; no key states a gain.

    Args:
        problem: of the diagnosis.
        candidate: of its catalogue; one that is not fitted in it stays.
    """
    if candidate.effect not in problem.catalogue:
        return candidate
    entry, model = problem.catalogue[candidate.effect], problem.parts[0].signals.model
    neutral, known = neutral_values(entry, model), problem.known.get(candidate.effect, {})
    stated = {p.name: neutral[p.name] for p in entry.parameters if callable(p.neutral)} | known
    found = [name for name in candidate.parameters if name in stated]
    return candidate._replace(nominal={name: np.asarray(stated[name], float).tolist() for name in found})
