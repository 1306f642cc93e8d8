"""Causes and candidates of a search in parameters and words, each judged on blocks that its fit has not seen."""

from __future__ import annotations

from typing import cast

import numpy as np

from ftbias_jax.diagnosis.candidates import Scored
from ftbias_jax.diagnosis.evidence.cross_validation import HeldOut, Judge, gap_removed
from ftbias_jax.diagnosis.evidence.doubts import doubt_of
from ftbias_jax.diagnosis.evidence.estimates import Parameters, parameters
from ftbias_jax.diagnosis.evidence.twins import twins_of
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.fit import Fit, fit
from ftbias_jax.diagnosis.result import Candidate
from ftbias_jax.diagnosis.samples.types import Finding
from ftbias_jax.diagnosis.thresholds import LEADS
from ftbias_jax.model.effects.fitting import Samples
from ftbias_jax.model.effects.table import Catalogue
from ftbias_jax.model.effects.types import Effect

CANDIDATES = 12


def causes_of(
    problem: Problem,
    hold_out: Judge,
    base: Fit,
    accepted: Fit,
    rounds: list[list[Scored]],
    found: tuple[Finding, ...],
    total: float,
    rivals: str = "",
    of_tool: int = 0,
) -> tuple[Candidate, ...]:
    """Accepted hypotheses with their twins, and what was read off the samples; the larger gap first.

    Each cause is judged by what it removes beside those before it. The first ``of_tool`` were fitted beside all others:
    they come last, and are judged by what the answer loses without them.
    """
    of_mean, previous = list[Candidate](), base
    pairs = list(zip(rounds, accepted.hypotheses, strict=False))
    for scored, hypothesis in (*pairs[of_tool:], *pairs[:of_tool]):
        twins = twins_of(problem, base, accepted, hypothesis, scored)
        values, stderr = parameters(problem, accepted, hypothesis)
        better, worse = scored[0].fit, previous
        if hypothesis in accepted.hypotheses[:of_tool]:
            rest = tuple(h for h in accepted.hypotheses if h is not hypothesis)
            better, worse = accepted, fit(problem, rest, accepted)
        held, shrink = _judged(problem, hold_out, better, worse, total)
        named = _candidate(problem.catalogue[hypothesis.effect], values, stderr, held, shrink, twins)
        doubt = doubt_of(problem, accepted, hypothesis) or rivals
        of_mean.append(named._replace(explanation=named.explanation + doubt, doubt=doubt.removeprefix("; ")))
        previous = scored[0].fit
    of_samples = [_of_finding(problem.catalogue, finding, problem.duration) for finding in found]
    if total < LEADS**2:
        return tuple(of_samples + of_mean)
    return tuple(sorted(of_mean + of_samples, key=lambda cause: not _comes_first(problem.catalogue[cause.effect])))


def _comes_first(effect: Effect) -> bool:
    """Whether what samples show of an effect is told before what explains the mean reading, however large that is.

    What is cut off is missing from the mean reading, too, and much else can look like that. Noise that changes over
    the log is what all else is judged by.
    """
    return isinstance(effect.fit.search, Samples) and effect.fit.search.first


def _judged(problem: Problem, hold_out: Judge, better: Fit, worse: Fit, total: float) -> tuple[HeldOut, float]:
    """A fit on blocks it has not seen, and the share of the whole gap that it removes there beyond another fit."""
    held = hold_out(better, worse.error)
    return held, gap_removed(problem, worse.error, held.error) / max(total, 1e-12)


def _candidate(
    entry: Effect, values: Parameters, stderr: Parameters, held: HeldOut, shrink: float, twins: tuple[str, ...] = ()
) -> Candidate:
    words = {twin.effect: twin.separate_by for twin in entry.twins}
    return Candidate(
        effect=entry.name,
        stage=entry.stage,
        indistinguishable_from=twins,
        separate_by=tuple(words.get(twin, "") for twin in twins),
        parameters=values,
        stderr=stderr,
        held_out_gain=held.nats,
        held_out_gain_stderr=held.nats_stderr,
        shrink=float(np.clip(shrink, 0, 1)),
        explanation=entry.explanation,
        remedy=entry.remedy,
        units={parameter.name: parameter.unit for parameter in entry.parameters},
    )


def _of_finding(catalogue: Catalogue, finding: Finding, duration: float) -> Candidate:
    gain = finding.nats / max(duration, 1e-9)
    nothing = np.zeros((0, 6))
    scatter = np.sqrt(2 * max(finding.nats, 0)) if finding.nats_stderr is None else finding.nats_stderr
    held = HeldOut(nothing, gain, scatter / max(duration, 1e-9))
    values, stderr = cast(Parameters, finding.parameters), cast(Parameters, finding.stderr)
    candidate = _candidate(catalogue[finding.effect], values, stderr, held, 0.0)
    return candidate._replace(explanation=f"{candidate.explanation}: {finding.sentence}")


def ranking_of(
    problem: Problem,
    hold_out: Judge,
    base: Fit,
    rounds: list[list[Scored]],
    found: tuple[Finding, ...],
    total: float,
) -> tuple[Candidate, ...]:
    """Everything that was fitted by itself, best first, with its paired difference to the best."""
    ranked = [_of_finding(problem.catalogue, finding, problem.duration) for finding in found]
    fitted = [
        (scored, *_judged(problem, hold_out, scored.fit, base, total))
        for scored in (rounds[0][:CANDIDATES] if rounds else [])
    ]
    best = max((held for _, held, _ in fitted), key=lambda held: held.nats, default=None)
    for scored, held, shrink in fitted:
        values, stderr = parameters(problem, scored.fit, scored.hypothesis)
        paired = hold_out(scored.fit, best.error) if best else held
        candidate = _candidate(problem.catalogue[scored.hypothesis.effect], values, stderr, held, shrink)
        ranked.append(candidate._replace(behind=-paired.nats, behind_stderr=paired.nats_stderr))
    return tuple(sorted(ranked, key=lambda candidate: -candidate.held_out_gain))
