"""A tool that may be wrong is fitted beside every cause, because its error looks like other causes."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import NamedTuple

from ftbias_jax.diagnosis.candidates import Scored, score
from ftbias_jax.diagnosis.evidence.cross_validation import Judge
from ftbias_jax.diagnosis.hypothesis import Hypothesis, at_zero, movable
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.fit import Fit, fit
from ftbias_jax.diagnosis.search import gap_of, search
from ftbias_jax.diagnosis.thresholds import LEAST_GAIN, LEAST_SHARE_OF_GAP, LEAST_SIGMAS, SURE
from ftbias_jax.model.effects.types import Effect
from ftbias_jax.runtime.progress import silent
from ftbias_jax.setup.require import is_draft
from ftbias_jax.setup.types import Setup


class Searched(NamedTuple):
    """What a search found beside the tool."""

    start: Fit
    """The nominal model, with those effects of the tool that stay."""
    accepted: Fit
    """All that stays, the tool first."""
    rounds: list[list[Scored]]
    """Candidates of each, the accepted one first; the last round may have added nothing."""


def search_causes(
    setup: Setup,
    problem: Problem,
    base: Fit,
    hold_out: Judge,
    without: Collection[str] = (),
    progress: Callable[[str], None] = silent,
) -> Searched:
    """Search for causes; where the tool may be wrong, beside a tool that is fitted with them.

    It may be where the setup states it with an error that shows. A tool that is stated without one is believed first:
    its effects are candidates like all others. But a wrong tool beside something else makes a gap that neither explains
    alone, and a greedy search does not find the way: where more than one cause was found, or much is left, the
    tool is tried beside them, too, and taken if that explains all by fewer numbers.

    Args:
        setup: of the logs.
        problem: of the logs.
        base: the nominal model.
        hold_out: judges fits.
        without: effects that may not be named.
        progress: called with the name of each stage as it begins.
    """
    excluded = _of_tool(problem).keys() & {*without, *problem.known}
    drafted = is_draft(setup) and not excluded
    plain = None if drafted else Searched(base, *search(problem, base, hold_out, without, progress))
    enough = max(LEAST_SIGMAS**2, LEAST_SHARE_OF_GAP * gap_of(problem, base))
    if plain and (_is_simple(problem, plain.accepted, enough) or excluded):
        return plain
    progress("trying causes beside a wrong tool")
    beside = _beside_tool(problem, base, hold_out, without)
    if plain is None:
        return beside
    closed = gap_of(problem, beside.accepted) <= enough
    better = beside.start.hypotheses and closed and score(beside.accepted, plain.accepted) > LEAST_GAIN
    return beside if better else plain


def _of_tool(problem: Problem) -> dict[str, Effect]:
    """Effects of a tool whose mass or centre of mass is not as the setup states."""
    known = problem.catalogue.items()
    return {name: effect for name, effect in known if effect.parameters and all(x.stated for x in effect.parameters)}


def _is_simple(problem: Problem, found: Fit, enough: float) -> bool:
    """Whether at most one cause explains all, or nearly all if it is neither of the tool nor of nearly any shape."""
    names = {h.effect for h in found.hypotheses}
    like_tool = names & _of_tool(problem).keys() or any(problem.catalogue[name].fit.any_shape for name in names)
    return len(names) < 2 and gap_of(problem, found) <= (LEAST_SIGMAS**2 if like_tool else enough)


def _beside_tool(problem: Problem, base: Fit, hold_out: Judge, without: Collection[str]) -> Searched:
    """Causes found with the tool free; of the tool stays what is worth its numbers beside them.

    It must also hold in blocks that are left out: what other causes put into the tool does not.
    """
    of_tool = tuple(at_zero(name, movable(problem, effect)) for name, effect in _of_tool(problem).items())
    accepted, rounds = search(problem, fit(problem, of_tool, base), hold_out, without)
    causes, stay = accepted.hypotheses[len(of_tool) :], of_tool
    for h in of_tool:
        rest = fit(problem, tuple(other for other in accepted.hypotheses if other is not h), accepted)
        held = hold_out(accepted, rest.error)
        if score(accepted, rest) < LEAST_GAIN or held.nats < SURE * held.nats_stderr:
            accepted, stay = rest, tuple(other for other in stay if other is not h)
    if stay != of_tool:
        rounds = _refitted(problem, stay, causes, accepted, rounds)
    return _with_rounds_of_tool(problem, base, stay, accepted, rounds)


def _refitted(
    problem: Problem,
    stay: tuple[Hypothesis, ...],
    causes: tuple[Hypothesis, ...],
    accepted: Fit,
    rounds: list[list[Scored]],
) -> list[list[Scored]]:
    """The rounds of the causes with the accepted one of each fitted beside that of the tool which stays."""
    fits = [fit(problem, (*stay, *causes[:i]), accepted) for i in range(1, len(causes))] + [accepted]
    pairs = zip(rounds[: len(causes)], fits[: len(causes)], strict=True)
    first = [[best._replace(fit=own), *others] for (best, *others), own in pairs]
    return [*first, *rounds[len(causes) :]]


def _with_rounds_of_tool(
    problem: Problem, base: Fit, stay: tuple[Hypothesis, ...], accepted: Fit, rounds: list[list[Scored]]
) -> Searched:
    """With a round of its own for each effect of the tool, the first of which has the candidates of the causes, too."""
    start, of_tool = base, list[list[Scored]]()
    for i in range(len(stay)):
        wider = fit(problem, stay[: i + 1], start)
        of_tool.append([Scored(wider, score(wider, start))])
        start = wider
    if of_tool and rounds:
        of_tool[0] += rounds[0]
    return Searched(start, accepted, of_tool + rounds)
