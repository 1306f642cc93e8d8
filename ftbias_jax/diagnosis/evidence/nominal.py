"""What the setup states of the parameters that a diagnosis found, to be shown beside them."""

from __future__ import annotations

import numpy as np

from ftbias_jax.diagnosis.hypothesis import neutral_of
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.result import Candidate


def with_nominal(problem: Problem, candidate: Candidate) -> Candidate:
    """A candidate with what the setup states of its parameters: in its section of the effect, or in one of its own.

    The tool's mass stands in [tool] and gravity in [robot]; no key states a gain.

    Args:
        problem: of the diagnosis.
        candidate: of its catalogue; one that is not fitted in it stays.
    """
    if candidate.effect not in problem.catalogue:
        return candidate
    entry, known = problem.catalogue[candidate.effect], problem.known.get(candidate.effect, {})
    stated = {p.name: neutral_of(problem, entry, p.name) for p in entry.parameters if callable(p.neutral)} | known
    found = [name for name in candidate.parameters if name in stated]
    return candidate._replace(nominal={name: np.asarray(stated[name], float).tolist() for name in found})
