"""Search with a tool that may be wrong fitted together with every cause, because its error resembles other causes."""

from collections.abc import Callable, Collection, Mapping
from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.candidates import Scored, score
from ftbias_jax.diagnosis.evidence.estimates import departs, parameters
from ftbias_jax.diagnosis.evidence.gap import CrossValidation, nats_of_joints
from ftbias_jax.diagnosis.evidence.reading import stderr_of_reading
from ftbias_jax.diagnosis.hypothesis import at_zero, movable
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.proposals.entries import entries_of, evidence, whole_matrix
from ftbias_jax.diagnosis.regression.fit import Fit, fit, log_likelihood_gain
from ftbias_jax.diagnosis.result import Candidate
from ftbias_jax.diagnosis.search import Rounds, enough, gap_of, search, with_first_fits
from ftbias_jax.diagnosis.thresholds import ALIKE, LEADS, LEAST_GAIN, LEAST_SIGMAS, SURE
from ftbias_jax.model.effects.catalogue import Catalogue
from ftbias_jax.model.effects.types import Effect
from ftbias_jax.runtime.progress import silent
from ftbias_jax.setup.require import is_draft
from ftbias_jax.setup.types import Setup

CHANNELS = 3
"""Number of channels of a force or a torque."""


class Searched(NamedTuple):
    """Result of a search together with the tool."""

    start: Fit
    """Nominal model with the accepted effects of the tool."""
    accepted: Fit
    """Fit of all accepted effects, those of the tool first."""
    rounds: Rounds


def search_causes(
    setup: Setup,
    problem: Problem,
    base: Fit,
    hold_out: CrossValidation,
    without: Collection[str] = (),
    progress: Callable[[str], None] = silent,
) -> Searched:
    """Search for causes, together with a tool fit where the tool may be wrong; arguments as in ``Search``.

    The tool may be wrong where the setup states it with a noticeable standard error. A tool stated without one is
    assumed correct at first, and its effects are candidates like all others. A wrong tool with something else makes a
    gap that neither explains alone and that a greedy search misses: where more than one cause was found, or much is
    left, the tool is fitted with them too, and taken if that explains all, or as much as they do with fewer parameters.
    """
    excluded = _of_tool(problem).keys() & {*without, *problem.known}
    drafted = is_draft(setup) and not excluded
    plain = None if drafted else Searched(base, *search(problem, base, hold_out, without, progress))
    least = enough(problem, base)
    if plain and (excluded or (_is_simple(problem, plain.accepted, least) and not _stands_for_tool(problem, plain))):
        return _with_all_entries(problem, plain)
    progress("trying causes beside a wrong tool")
    open_names = _still_open(setup, problem, without) if drafted else _of_tool(problem)
    beside = _with_all_entries(problem, _beside_tool(problem, base, hold_out, without, open_names))
    if plain is None:
        return beside
    plain = _with_all_entries(problem, plain)
    left, by_plain = (gap_of(problem, one.accepted) for one in (beside, plain))
    closed = left <= max(least, min(by_plain, LEADS**2) if plain.accepted.hypotheses else 0.0)
    # Crosstalk that mimics a wrong tool is larger than that of any sensor, which the evidence accounts for.
    gained = evidence(problem, beside.accepted) - evidence(problem, plain.accepted)
    better = gained > LEAST_GAIN
    if {h.effect for h in plain.accepted.hypotheses} & _like_tool(problem):
        # A cause that is as good as the tool but has more parameters ranks after it.
        lost, error = log_likelihood_gain(problem, plain.accepted.error, beside.accepted.error)
        as_good = lost < max(ALIKE * error, LEAST_GAIN, nats_of_joints(problem))
        better = better or (as_good and (gained > 0 or beside.accepted.degrees < plain.accepted.degrees))
    return beside if beside.start.hypotheses and closed and better else plain


def _with_all_entries(problem: Problem, found: Searched) -> Searched:
    """Replace few entries of a matrix by the whole matrix where something is left unexplained beside them.

    No other cause was accepted, so many small crosstalk entries are likelier than an unknown effect. With only a few of
    them, gains would fit better than another tool.
    """
    before, count = len(found.start.hypotheses), len(found.accepted.hypotheses)
    is_left = gap_of(problem, found.accepted) > LEAST_SIGMAS**2
    few = entries_of(problem, found.accepted) if is_left else None
    whole = whole_matrix(problem, found.accepted, few) if few else None
    if not whole or not whole.worth_its_parameters:
        return found
    of_causes = with_first_fits(problem, found.rounds[before:count], whole.fit, before)
    return Searched(found.start, whole.fit, [*found.rounds[:before], *of_causes, *found.rounds[count:]])


def stderr_beside(setup: Setup, problem: Problem, accepted: Fit) -> tuple[dict[str, np.ndarray], np.ndarray | None]:
    """Standard errors with all findings fitted: of the tool, by keys of [tool], and (6,) N, Nm of the model's reading.

    Those of the tool are {} if it is neither a draft nor among the findings. Those of the reading are from
    ``stderr_of_reading``, without what the setup states of the tool's. Parameters that a draft leaves open are free.
    """
    beside = _with_left_open(setup, problem, accepted)
    of_tool = {} if _of_tool(problem).keys() & problem.known else _stderr_of_tool(setup, problem, beside)
    given = [name for name, effect in _of_tool(problem).items() if setup.tool.has_errors(effect.tool_keys)]
    given += [name for name, effect in problem.catalogue.items() if effect.goes_by_clock]  # the bias follows these
    return of_tool, stderr_of_reading(problem, beside, given)


def _with_left_open(setup: Setup, problem: Problem, accepted: Fit) -> Fit:
    if _of_tool(problem).keys() & problem.known:
        return accepted
    return _freed(problem, accepted, _still_open(setup, problem, {h.effect for h in accepted.hypotheses}))


def _stderr_of_tool(setup: Setup, problem: Problem, beside: Fit) -> dict[str, np.ndarray]:
    of_tool = _of_tool(problem)
    found: dict[str, np.ndarray] = {}
    for h in beside.hypotheses:
        if h.effect in of_tool:
            stderr = parameters(problem, beside, h, either=True)[1]
            found |= {x.stated: np.asarray(stderr[x.name]) for x in of_tool[h.effect].parameters if x.stated}
    share = _open_scale(problem, beside)
    return {key: np.hypot(stderr, share * np.linalg.norm(getattr(setup.tool, key))) for key, stderr in found.items()}


def with_stderr_of_tool(
    problem: Problem, cause: Candidate, accepted: Fit, of_tool: Mapping[str, np.ndarray]
) -> Candidate:
    """Cause with standard errors no smaller than the tool's, including the undetermined scale of gains."""
    if cause.effect not in problem.catalogue or not of_tool:
        return cause
    effect = problem.catalogue[cause.effect]
    pairs = [(x.name, of_tool[x.stated]) for x in effect.parameters if x.stated in of_tool and x.name in cause.stderr]
    if _scales_tool(problem, effect):
        scale = _open_scale(problem, accepted)
        pairs += [(name, np.hypot(stderr, scale * np.sign(stderr))) for name, stderr in cause.stderr.items()]
    return cause._replace(stderr=cause.stderr | {k: np.fmax(cause.stderr[k], std).tolist() for k, std in pairs})


def _open_scale(problem: Problem, found: Fit) -> float:
    """Relative error that gains and a tool fitted together may have in common.

    Only a known weight distinguishes equal gains of all channels from a scaled tool. Where unequal gains were found,
    their scatter gives the standard error of their mean.
    """
    for h in found.hypotheses:
        if _scales_tool(problem, problem.catalogue[h.effect]):
            (gains,) = parameters(problem, found, h)[0].values()
            return float(np.std(gains, ddof=1) / np.sqrt(CHANNELS))
    return 0.0


def _scales_tool(problem: Problem, effect: Effect) -> bool:
    """Whether an effect, such as equal gains, can be identical to one of the tool for any motion."""
    return any(twin.exact and twin.effect in _of_tool(problem) for twin in effect.twins)


def _of_tool(problem: Problem) -> dict[str, Effect]:
    """Effects of a tool whose mass or centre of mass is not as the setup states."""
    return {name: effect for name, effect in problem.catalogue.items() if effect.tool_keys}


def with_tool(problem: Problem, base: Fit) -> Fit:
    """Nominal model with mass and centre of mass of the tool free."""
    return _freed(problem, base, _of_tool(problem))


def _freed(problem: Problem, found: Fit, names: Collection[str]) -> Fit:
    """Fit with further effects free, none of which it contains."""
    further = [at_zero(name, movable(problem, problem.catalogue[name])) for name in names]
    return fit(problem, (*found.hypotheses, *further), found) if further else found


def left_open(setup: Setup, catalogue: Catalogue) -> list[str]:
    """Effects that a drafted setup leaves open: the tool's mass, centre of mass and inertia, and the sensor's place.

    Mass and centre of mass come first. The last two are small, but change a cause as another form of it would: if they
    were ignored, its parameters and the mass would be off by many standard errors.
    """
    if not is_draft(setup):
        return []
    unmeasured = {name: effect.fit.unmeasured for name, effect in catalogue.items()}
    of_tool = [name for name, effect in catalogue.items() if effect.tool_keys]
    return of_tool + [name for name, is_open in unmeasured.items() if is_open and is_open(setup)]


def _still_open(setup: Setup, problem: Problem, settled: Collection[str]) -> list[str]:
    """Those of ``left_open`` that are neither settled nor known."""
    return [name for name in left_open(setup, problem.catalogue) if name not in {*settled, *problem.known}]


def _like_tool(problem: Problem) -> set[str]:
    """Effects that do not belong to the tool and declare it as a twin."""
    of_tool = _of_tool(problem).keys()
    return {name for name, effect in problem.catalogue.items() if of_tool & {x.effect for x in effect.twins}} - of_tool


def _is_simple(problem: Problem, found: Fit, least: float) -> bool:
    """Whether at most one cause explains all, or nearly all if it is unlike the tool and not of nearly any shape."""
    names = {h.effect for h in found.hypotheses}
    doubtful = names & (_of_tool(problem).keys() | _like_tool(problem))
    doubtful |= {name for name in names if problem.catalogue[name].fit.any_shape}
    return len(names) < 2 and gap_of(problem, found) <= (LEAST_SIGMAS**2 if doubtful else least)


def _stands_for_tool(problem: Problem, found: Searched) -> bool:
    """Whether mass and centre of mass together are clearly better than the causes found; neither is alone."""
    return bool(found.accepted.hypotheses) and score(with_tool(problem, found.start), found.accepted) > LEAST_GAIN


def _beside_tool(
    problem: Problem, base: Fit, hold_out: CrossValidation, without: Collection[str], open_names: Collection[str]
) -> Searched:
    """Causes found with the tool and other open effects free; of these, only those worth their parameters are kept.

    They must also hold on held-out blocks, where errors that other causes put into the tool do not.
    """
    free = _freed(problem, base, open_names)
    of_tool = stay = free.hypotheses
    accepted, rounds = search(problem, free, hold_out, without)
    causes = accepted.hypotheses[len(of_tool) :]
    for h in of_tool:
        rest = fit(problem, accepted.beside(h), accepted)
        held = hold_out(accepted, hold_out(rest, rest.error).error)  # the reference is held out, too
        unsure = held.nats < SURE * held.nats_by_noise or not departs(problem, accepted, h)
        if score(accepted, rest) < LEAST_GAIN or unsure:
            accepted, stay = rest, tuple(other for other in stay if other is not h)
    if stay != of_tool:
        count = len(causes)
        rounds = [*with_first_fits(problem, rounds[:count], accepted, len(stay)), *rounds[count:]]
    # Each effect of the tool has a round of its own; the first one also has the candidates of the causes.
    start, of_stay = base, list[list[Scored]]()
    for i in range(len(stay)):
        wider = fit(problem, stay[: i + 1], start)
        of_stay.append([Scored(wider, score(wider, start))])
        start = wider
    if of_stay and rounds:
        of_stay[0] += rounds[0]
    return Searched(start, accepted, of_stay + rounds)
