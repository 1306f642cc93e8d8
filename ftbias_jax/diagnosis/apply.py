"""Apply a diagnosis to a setup: what was found becomes part of what the setup states.

The catalogue is imported inside the functions because it imports JAX, which pages of saved results do without.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ftbias_jax.diagnosis.report.tables import parameter_words
from ftbias_jax.diagnosis.result import WANDER, Candidate, Diagnosis, FoundTerm
from ftbias_jax.errors import SetupError
from ftbias_jax.setup.types import Setup


def setup_with_causes(diagnosis: Diagnosis, setup: Setup) -> Setup:
    """Setup with the causes added to its effects, replacing equal ones, and the terms appended to those it has.

    Causes and terms whose values no setup can state are left out (``refused``), and so are changes with time, which the
    bias follows (``is_left_to_bias``). Bound to ``Diagnosis.apply``.
    """
    terms = [term for term in diagnosis.terms if not is_left_to_bias(term)]
    return with_causes(setup.with_effects(diagnosis.own_effects), diagnosis.causes, terms, diagnosis.model_stderr)


def is_left_to_bias(term: FoundTerm) -> bool:
    """Whether a term changes with the time of a log: in a longer one it would grow without bound."""
    return term.drive == "time"


def with_causes(
    setup: Setup,
    causes: Sequence[Candidate],
    terms: Sequence[FoundTerm] = (),
    model_stderr: np.ndarray | None = None,
) -> Setup:
    """Setup with the causes and terms added to its effects, except those that ``refused`` names.

    Sensor noise replaces the value in [sensor], and tool parameters that the setup states with a standard error, as a
    draft does, are replaced in [tool].

    Args:
        setup: setup of the diagnosis.
        causes: their values replace those that the setup has for the same effect.
        terms: appended to those of the setup; a bias that wanders changes what the setup states of the bias.
        model_stderr: (6,) N, Nm, standard error of the reading with the causes, used if larger than the setup's.
    """
    from ftbias_jax.model.effects.terms.parse import TERM, goes_by_clock
    from ftbias_jax.model.params import NOISE_LEVEL, with_noise_as_known

    causes = [cause for cause in causes if not _refusal(setup, {cause.effect: cause.parameters})]
    setup = with_noise_as_known(setup)  # the found noise was measured relative to it
    setup, causes = _with_tool(setup, causes)
    setup = _with_wander(setup, terms)
    terms = [term for term in _of_effects(terms) if not _refusal(setup, {TERM: [term.section]})]
    lasting = [term for term in terms if len(term.reading_stderr) and not goes_by_clock(term.section)]
    of_terms = [np.array(term.reading_stderr) for term in lasting]  # the bias follows what goes by the clock
    setup = _with_model_error(setup, ([model_stderr] if causes and model_stderr is not None else []) + of_terms)
    sections = [term.section for term in terms]
    effects: dict[str, Any] = {**setup.effects, **{cause.effect: cause.parameters for cause in causes}}
    if sections:
        effects[TERM] = [*effects.get(TERM, ()), *sections]
    comments = {
        "sensor.noise_std"
        if cause.effect == NOISE_LEVEL
        else f"effects.{cause.effect}.{name}": f"ftbias diagnose: {words}"
        for cause in causes
        for name, words in parameter_words(cause)
    }
    return with_noise_as_known(replace(setup, effects=effects, comments={**setup.comments, **comments}))


def _with_tool(setup: Setup, causes: Sequence[Candidate]) -> tuple[Setup, list[Candidate]]:
    """Setup with mass and centre of mass replaced where it states their standard errors, and the remaining causes."""
    from ftbias_jax.model.own_effects import catalogue_of_setup

    tool, comments, others = setup.tool, dict(setup.comments), list[Candidate]()
    for cause in causes:
        effect = catalogue_of_setup(setup)[cause.effect]
        if not (effect.tool_keys and tool.has_errors(effect.tool_keys)) or cause.effect in setup.effects:
            others.append(cause)
            continue
        stated = {x.name: x.stated for x in effect.parameters}
        for name, key in stated.items():
            value, stderr = (np.asarray(x[name], float) for x in (cause.parameters, cause.stderr))
            pair = {key: value, f"{key}_std": stderr}.items()
            exact: dict[str, Any] = {k: float(x) if not x.ndim else x for k, x in pair}
            tool = replace(tool, **exact)
        comments |= {f"tool.{stated[name]}": f"ftbias diagnose: {words}" for name, words in parameter_words(cause)}
    return replace(setup, tool=tool, comments=comments), others


def refused(setup: Setup, causes: Sequence[Candidate], terms: Sequence[FoundTerm] = ()) -> tuple[str, ...]:
    """Reasons why no setup can state some causes or terms: a fitted value may be outside the catalogue's bounds."""
    from ftbias_jax.model.effects.terms.parse import TERM

    sections: list[dict[str, Any]] = [{cause.effect: cause.parameters} for cause in causes]
    sections += [{TERM: [term.section]} for term in _of_effects(terms)]
    return tuple(why for section in sections if (why := _refusal(setup, section)))


def _with_wander(setup: Setup, terms: Sequence[FoundTerm]) -> Setup:
    """Setup with the noise density of the wandering bias, if one of the terms is that."""
    for term in terms:
        if term.form == WANDER:
            bias = replace(setup.bias, noise_density=np.asarray(term.section["noise_density"], float))
            comments = {**setup.comments, "bias.noise_density": f"ftbias diagnose: {term.statement}"}
            setup = replace(setup, bias=bias, comments=comments)
    return setup


def _with_model_error(setup: Setup, stderrs: Sequence[np.ndarray]) -> Setup:
    if not stderrs:
        return setup
    stderr = np.sqrt(np.square(stderrs).sum(0))
    more = np.fmax(stderr, 0.0 if setup.bias.model_std is None else setup.bias.model_std)
    comments = {**setup.comments, "bias.model_std": "ftbias diagnose: standard errors of the effects, by its logs"}
    return replace(setup, bias=replace(setup.bias, model_std=more), comments=comments)


def _of_effects(terms: Sequence[FoundTerm]) -> list[FoundTerm]:
    """Terms that a setup states among its effects."""
    return [term for term in terms if term.form != WANDER]


def some_applied(diagnosis: Diagnosis, not_stated: Sequence[str]) -> bool:
    """Whether the setup with the findings is worth writing: not if ``refused`` (``not_stated``) rejects all of them."""
    return not not_stated or len(not_stated) < len(diagnosis.causes) + len(diagnosis.terms)


def _refusal(setup: Setup, effects: dict[str, Any]) -> str:
    """Reason why a setup cannot state these effects; "" if it can."""
    from ftbias_jax.model.effects.catalogue import values_from_setup
    from ftbias_jax.model.own_effects import catalogue_of_setup

    try:
        values_from_setup(effects, catalogue=catalogue_of_setup(setup))
    except SetupError as error:
        return str(error)
    return ""
