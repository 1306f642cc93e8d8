"""What the setup states of the parameters that a diagnosis found, and what an effect says of both."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ftbias_jax.diagnosis.hypothesis import neutral_of
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.result import Candidate
from ftbias_jax.model.effects.statements import Estimate, amount
from ftbias_jax.model.effects.types import Effect


def with_nominal(problem: Problem, candidate: Candidate) -> Candidate:
    """A candidate with what the setup states of its parameters, in one of its sections, and with both in a sentence.

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
    nominal = {name: np.asarray(stated[name], float) for name in found}
    statement = statement_of(entry, candidate, nominal)
    return candidate._replace(nominal={name: value.tolist() for name, value in nominal.items()}, statement=statement)


def statement_of(entry: Effect, candidate: Candidate, nominal: Mapping[str, np.ndarray]) -> str:
    """What the effect says of its parameters; of one that says nothing, its explanation and the first of them."""
    estimates = {}
    for name, value in candidate.parameters.items():
        values = np.asarray(value, float)
        errors = np.asarray(candidate.stderr.get(name, np.nan), float)
        unknown = np.full(values.shape, np.nan)
        errors = errors if errors.shape == values.shape else unknown
        estimates[name] = Estimate(values, errors, nominal.get(name, unknown))
    if entry.statement is not None:
        return entry.statement(estimates)
    first = entry.parameters[0]
    if first.name not in estimates or estimates[first.name].value.size != 1:
        return entry.explanation
    unit = "" if first.unit == "1" else f" {first.unit}"
    return amount(f"{entry.explanation} ({first.name} {{value}}{unit}{{setup}})", first.name)(estimates)
