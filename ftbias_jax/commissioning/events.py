"""Events of one log that are no property of its robot, and so are left out of a setup for logs recorded next."""

from collections.abc import Collection, Sequence
from dataclasses import replace

from ftbias_jax.commissioning.result import Step
from ftbias_jax.diagnosis.result import WANDER, Diagnosis
from ftbias_jax.diagnosis.tool_first import left_open
from ftbias_jax.model.effects.terms.parse import TERM, goes_by_clock
from ftbias_jax.model.own_effects import catalogue_of_setup
from ftbias_jax.setup.types import Setup


def without_events(setup: Setup, given: Setup) -> tuple[Setup, tuple[str, ...]]:
    """The setup without effects that depend on the time within one log, and the names of these.

    A jump or a warm-up of the bias, contact, what is switched at a time, and a wave, whose phase differs in the next
    log, would be predicted there as well. What ``given`` states is kept, because its owner knows why.
    """
    catalogue, stated = catalogue_of_setup(setup), given.effects
    events = [
        name for name in setup.effects if name not in stated and name in catalogue and catalogue[name].goes_by_clock
    ]
    terms = list(setup.effects.get(TERM, ()))
    known = len(stated.get(TERM, ()))
    lasting = [*terms[:known], *(term for term in terms[known:] if not goes_by_clock(term))]
    effects = {name: values for name, values in setup.effects.items() if name not in (*events, TERM)}
    of_terms = [f"term of {term['drive']}" for term in terms if term not in lasting]
    kept = effects | ({TERM: lasting} if lasting else {})
    return (replace(setup, effects=kept) if events or of_terms else setup), tuple(dict.fromkeys([*events, *of_terms]))


def is_bias_alone(found: Diagnosis, steps: Sequence[Step]) -> bool:
    """Whether a diagnosis adds to its causes, which were the last step, only how much the bias wanders.

    The filter finds that itself, and predicts no better with it; the identification of the tool needs it all the same.
    """
    return (not found.causes or steps[-1].kept) and all(term.form == WANDER for term in found.terms)


def other_causes(setup: Setup, looked_for: Collection[str]) -> set[str]:
    """All causes except ``looked_for`` and those that a draft leaves open."""
    catalogue = catalogue_of_setup(setup)
    return {*catalogue, TERM} - {*looked_for, *left_open(setup, catalogue)}


def same_causes(one: Setup, other: Setup, draft: Setup) -> bool:
    """Whether two setups from one draft have the same effects, except for those that the draft leaves open."""
    return {*one.effects} ^ {*other.effects} <= {*left_open(draft, catalogue_of_setup(draft))}
