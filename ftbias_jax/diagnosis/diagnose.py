"""Diagnosis of logs: examine samples, search causes, judge them on held-out blocks, and report what is certain."""

from collections.abc import Callable, Collection, Iterable, Sequence
from pathlib import Path

from ftbias_jax.check.check_setup import require_right
from ftbias_jax.diagnosis.check_effects import typed_errors
from ftbias_jax.diagnosis.evidence.causes import Answer, causes_of, doubt_by, in_order, is_sure, with_statements
from ftbias_jax.diagnosis.evidence.estimates import correlations
from ftbias_jax.diagnosis.evidence.gap import (
    CrossValidation,
    compare,
    differ,
    is_closed,
    is_quiet,
    may_hide_a_gap,
    measure_gap,
    verdict_of,
    worsened,
)
from ftbias_jax.diagnosis.problem import Problem, make_problem
from ftbias_jax.diagnosis.regression import fit as fits
from ftbias_jax.diagnosis.regression.chain_model import compiled_ahead, to_values
from ftbias_jax.diagnosis.regression.coordinates import why_not_fitted
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.diagnosis.report.sentence import disagreement, headline, no_free_motion, note
from ftbias_jax.diagnosis.report.series import show, where
from ftbias_jax.diagnosis.result import Candidate, Diagnosis, FoundTerm
from ftbias_jax.diagnosis.samples.types import Finding, SampleFindings, together
from ftbias_jax.diagnosis.search import enough, gap_of
from ftbias_jax.diagnosis.terms.describe import describe, follows_something
from ftbias_jax.diagnosis.terms.found import found_terms
from ftbias_jax.diagnosis.terms.loads import all_carried
from ftbias_jax.diagnosis.terms.noise import louder, noise_term
from ftbias_jax.diagnosis.terms.select import state_of_problem
from ftbias_jax.diagnosis.terms.spectra import fast_lines
from ftbias_jax.diagnosis.terms.wander import is_all, wander_of, wander_term
from ftbias_jax.diagnosis.thresholds import AS_WELL, USEFUL_SHARE
from ftbias_jax.diagnosis.tool_first import Searched, search_causes, stderr_beside, with_stderr_of_tool
from ftbias_jax.errors import UsageError
from ftbias_jax.filtering.quality.at_rest import rest_in_words, weight_in_bias
from ftbias_jax.io import GivenLog, as_logs, names_of
from ftbias_jax.io.cleaning import Facts, clean, slices, survey, without_long_pauses
from ftbias_jax.io.log import Log
from ftbias_jax.io.write.provenance import provenance, source_of
from ftbias_jax.model.effects.catalogue import check_names
from ftbias_jax.model.effects.fitting import GROWTH, LEVEL
from ftbias_jax.model.effects.terms.parse import TERM
from ftbias_jax.model.effects.types import Effect
from ftbias_jax.model.own_effects import catalogue_of_setup, unobservable_effects
from ftbias_jax.model.params import with_noise_as_known
from ftbias_jax.runtime.jax_config import in_float64
from ftbias_jax.runtime.progress import silent
from ftbias_jax.setup import GivenSetup, Setup, as_setup


@in_float64
def diagnose(
    setup: GivenSetup,
    logs: GivenLog | Iterable[GivenLog],
    names: Sequence[str] = (),
    without: Collection[str] = (),
    effects: Sequence[Effect] = (),
    unchecked: bool = False,
    progress: Callable[[str], None] = silent,
) -> Diagnosis:
    """Diagnose one log, or several logs of one robot together: an effect then has the same parameters in all of them.

    Computes in float64 whatever JAX's setting is, and keeps compiled programs in the user's cache folder (disabled by
    ``FTBIAS_CACHE=off``).

    Args:
        setup: nominal setup of the robot's owner, or its path.
        logs: logs of free motion with the same robot, sensor and tool, or their paths; best as recorded
            (``read_log(..., raw=True)``, as a path is read), because clipped samples are evidence. Samples of axes that
            stand still are left out here and reported in ``repairs``.
        names: names of the logs, one each, for the report; () = "log 1", "log 2", ..., or the names of their files.
        without: effects that may not be named, to see the answer without them.
        effects: user-defined effects, searched in addition to those of the catalogue.
        unchecked: skip the check whether the setup can be right (``check_setup``).
        progress: called with the name of each stage as it begins.

    Raises:
        SetupError, LogError: the logs show a mistake of units, signs or frames, have no wrench, or fit nothing.
        UsageError: no log, an unknown effect, or a faulty effect of your own.
    """
    setup = as_setup(setup, effects)
    with typed_errors(setup.own_effects):
        return explain(setup, as_logs(logs, setup, raw=True), names, without, unchecked, progress)[0]


def explain(
    setup: Setup,
    logs: Sequence[Log],
    names: Sequence[str] = (),
    without: Collection[str] = (),
    unchecked: bool = False,
    progress: Callable[[str], None] = silent,
) -> tuple[Diagnosis, Answer]:
    """Diagnosis together with the fits behind it; arguments as in ``diagnose``, which has read the logs.

    Raises:
        UsageError and others: as in ``diagnose``.
    """
    names = names or names_of(logs)
    if len(names) != len(logs):
        message = f"got {len(logs)} logs and {len(names)} names"
        raise UsageError(message, field="logs", remedy="give a name for each log, or none")
    check_names({*without} - {TERM}, "without", catalogue_of_setup(setup))
    progress("checking the setup")
    facts = [survey(slices(log)) for log in logs]
    as_filtered = map(clean, logs, facts)  # one at a time, each kept no longer than it is used
    with_tool, logs = ready(setup, logs, facts)
    with compiled_ahead(with_tool, logs):
        require_right(setup, as_filtered, "diagnose", unchecked)
        progress("making the logs ready")
        problem, samples = make_problem(with_tool, logs)
    problem, base, found, loud = _examined(problem, logs, samples, without)
    hold_out = CrossValidation(problem)
    before = hold_out(base, base.error)
    quiet = is_quiet(problem, measure_gap(problem, before, before))
    carried = all_carried(problem, base) if not quiet and TERM not in without else None
    excluded = {*without, *unobservable_effects(setup)}
    if carried:
        problem, base, hold_out = carried, fits.base(carried), CrossValidation(carried)
        before = hold_out(base, base.error)
        searched = Searched(base, base, [])
    else:
        searched = search_causes(setup, problem, base, hold_out, excluded, progress)
        settled = _settled(problem, searched.accepted)
        if settled is not problem:
            problem, base, hold_out = settled, fits.base(settled), CrossValidation(settled)
            before = hold_out(base, base.error)
            searched = search_causes(setup, problem, base, hold_out, excluded, progress)
    after = hold_out(searched.accepted, base.error)
    gap = measure_gap(problem, before, after)
    answer = Answer(problem, hold_out, base, found, *searched, before, after, gap, gap.before_sigmas**2 - 1)
    pushed = all(part.touched.all_along for part in problem.parts)
    if (
        TERM not in without
        and (answer.accepted.hypotheses or not quiet or may_hide_a_gap(problem, before.error))
        and (not pushed or follows_something(problem, base, hold_out))
    ):
        progress("trying terms")
        answer = _with_terms(answer, fast_lines(logs, samples))
        if not carried and not pushed and not is_closed(problem, gap):
            answer, wanders = _with_wander(setup, answer, searched, excluded, progress)
            loud += wanders
    progress("writing the report")
    answer, verdict, causes = _judged(answer, loud)
    problem, base = answer.problem, answer.base
    if pushed := pushed and verdict not in ("explained", "described"):  # a push follows no recorded quantity
        answer, verdict, causes = _without_causes(answer)._replace(terms=()), "unknown", ()
    of_tool, of_reading = stderr_beside(setup, problem, answer.accepted)
    causes = tuple(with_stderr_of_tool(problem, cause, answer.accepted, of_tool) for cause in causes)
    causes, ranking = with_statements(answer, causes)
    place = where(problem, before, tuple(dict.fromkeys(cause.stage for cause in causes)))
    by_log = compare(problem, names, answer.accepted if causes else base, before, answer.after)
    worse = worsened(by_log)
    disagree = bool(worse) or (verdict == "partly_explained" and differ(by_log))
    if disagree:
        verdict = "partly_explained"
    diagnosis = Diagnosis(
        verdict=verdict,
        sentence=no_free_motion(answer.gap, max(problem.durations))
        if pushed
        else disagreement(by_log, worse)
        if disagree
        else headline(verdict, answer.gap, in_order(answer, causes), ranking, place),
        causes=causes,
        candidates=ranking,
        gap=answer.gap,
        where=place,
        not_tested=_not_tested(setup, problem, without),
        series=show(problem, base, answer.accepted, before, answer.after),
        logs=tuple(names),
        repairs=tuple((*log.repairs, *part.remarks) for log, part in zip(logs, problem.parts, strict=True)),
        by_log=by_log,
        setup_name=Path(setup.path).name,
        own_effects=setup.own_effects,
        terms=answer.terms,
        correlations=correlations(problem, answer.accepted, causes),
        tool_stderr=of_tool,
        model_stderr=of_reading,
        note=note(setup, rest_in_words(setup, slices(*logs))),
        provenance=provenance(setup, list(map(source_of, logs)), {"without": sorted(without)}, names),
    )
    return diagnosis, answer


def ready(setup: Setup, logs: Sequence[Log], facts: Sequence[Facts]) -> tuple[Setup, list[Log]]:
    """Logs without samples that no fit can use, by the facts of a survey, and the setup with the tool's weight."""
    pairs = zip(logs, facts, strict=True)
    logs = [without_long_pauses(clean(log, known, clipped=False, held=("q", "dq"))) for log, known in pairs]
    with_tool, of_tool = weight_in_bias(setup, slices(*logs))
    return with_tool, [log._replace(repairs=(*log.repairs, *of_tool)) for log in logs]


def _examined(
    problem: Problem, logs: Sequence[Log], samples: Sequence[SampleFindings], without: Collection[str]
) -> tuple[Problem, Fit, tuple[Finding, ...], tuple[FoundTerm, ...]]:
    """Problem, with the variance of a noise term if there is one; nominal model; findings; that noise term."""
    found = tuple(finding for finding in together(samples, problem.catalogue) if finding.effect not in without)
    base = fits.base(problem)
    if TERM in without:
        return problem, base, found, ()
    state = state_of_problem(problem, base)
    term = noise_term(problem, logs, samples, state, found)
    if term is None:
        return problem, base, found, ()
    problem = louder(problem, term, state)
    # Growing noise has no constant size, and replaces the growth that the catalogue would name.
    return problem, fits.base(problem), tuple(one for one in found if one.sign not in (LEVEL, GROWTH)), (term,)


def _settled(problem: Problem, found: Fit) -> Problem:
    """Problem without the time in which the found effects had not settled, if anything else is left to explain.

    The transient of a lag or of an oscillation at the beginning of a log would otherwise be a cause of its own.
    """
    if len(found.hypotheses) < 2 and gap_of(problem, found) <= enough(problem, found):
        return problem
    values = to_values(problem.parts[0].signals, found.z, catalogue=problem.catalogue)
    return problem.settled({h.effect: values[h.effect] for h in found.hypotheses if h.effect in values})


def _with_terms(answer: Answer, lines: Sequence[float]) -> Answer:
    """Answer with terms that describe what the catalogue does not explain; lines: Hz, spectral lines of the samples."""
    problem, hold_out, accepted, found = answer.problem, answer.hold_out, answer.accepted, len(answer.found)
    causes = len(accepted.hypotheses) + found
    verdict = verdict_of(problem, answer.gap, causes, found, is_sure(problem, accepted))
    outcome = describe(problem, hold_out, answer.start, accepted, answer.rounds, verdict == "explained", lines)
    described = outcome.description
    if described is None:
        return answer._replace(doubt=doubt_by(outcome.rivals))
    after = hold_out(described.fit, answer.base.error)
    gap = measure_gap(problem, answer.before, after)
    terms = found_terms(problem, described, gap)
    return answer._replace(accepted=described.kept, rounds=described.rounds, after=after, gap=gap, terms=terms)


def _with_wander(
    setup: Setup, answer: Answer, searched: Searched, without: Collection[str], progress: Callable[[str], None]
) -> tuple[Answer, tuple[FoundTerm, ...]]:
    """Answer with a wandering bias and its term, if that gains more than the terms found beside the searched causes."""
    problem, seconds = answer.problem, max(answer.problem.duration, 1e-9)
    beside, causes = searched.accepted, searched.accepted.hypotheses
    steady = tuple(h for h in causes if not problem.catalogue[h.effect].goes_by_clock)
    if steady != causes:  # the others are slow themselves and are searched after it
        beside = fits.fit(problem, steady, answer.base) if steady else answer.base
    wander, by_causes = wander_of(problem, beside), answer.hold_out(beside, answer.base.error)
    if wander is None or wander.nats / seconds < AS_WELL * (answer.after.nats - by_causes.nats):
        return answer, ()
    progress("trying a bias that wanders")
    wide = problem.wandering(wander.density)
    base, hold_out = fits.base(wide), CrossValidation(wide)
    again = search_causes(setup, wide, base, hold_out, without)
    if not is_all(wander, wide, base, again.accepted, hold_out):
        return answer, ()
    after = hold_out(again.accepted, base.error)
    gap = measure_gap(wide, answer.before, after)
    share = max(gap.shrink - measure_gap(problem, answer.before, by_causes).shrink, 0.0)
    wandering = Answer(wide, hold_out, base, answer.found, *again, answer.before, after, gap, answer.total)
    return wandering, (wander_term(wander, seconds, share),)


def _judged(answer: Answer, loud: tuple[FoundTerm, ...]) -> tuple[Answer, str, tuple[Candidate, ...]]:
    """Answer without what fails on held-out blocks, the verdict, and the causes that it names."""
    problem, found = answer.problem, answer.found
    causes = causes_of(answer)
    names = {finding.effect for finding in found}
    of_samples = tuple(cause for cause in causes if cause.effect in names)
    if answer.gap.shrink < USEFUL_SHARE:
        causes = of_samples
        answer = answer._replace(accepted=answer.base) if answer.terms else _without_causes(answer)
    answer = answer._replace(terms=(*answer.terms, *loud))
    sure = not any(cause.doubt for cause in causes if cause.effect not in names)
    verdict = verdict_of(problem, answer.gap, len(causes), len(found), sure, len(answer.terms))
    return answer, verdict, of_samples if verdict in ("unknown", "none") else causes


def _without_causes(answer: Answer) -> Answer:
    """Answer with the nominal model, so that none of the gap is explained."""
    gap = measure_gap(answer.problem, answer.before, answer.before)
    return answer._replace(accepted=answer.base, after=answer.before, gap=gap)


def _not_tested(setup: Setup, problem: Problem, without: Collection[str]) -> tuple[tuple[str, str], ...]:
    """(effect, reason) for each effect that is not tested on the logs."""
    reasons = [(name, "left out on request") for name in without]
    reasons += [(name, "the setup has it already") for name in with_noise_as_known(setup).effects]
    reasons += [(name, reason) for name, reason in unobservable_effects(setup).items() if name not in without]
    for name, effect in problem.catalogue.items():
        reasons += [(name, f"no {need} was recorded") for need in effect.needs if need not in problem.recorded]
    for effect in problem.catalogue.own:
        reasons += [(effect.name, reason) for reason in [why_not_fitted(effect)] if reason]
    return tuple(reasons)
