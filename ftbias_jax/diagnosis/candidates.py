"""Candidate causes of one round: every effect fitted together with the causes accepted so far."""

from collections.abc import Callable, Collection
from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis import thresholds
from ftbias_jax.diagnosis.evidence.estimates import parameters
from ftbias_jax.diagnosis.evidence.gap import nats_of_joints
from ftbias_jax.diagnosis.hypothesis import Found, Hypothesis, penalty
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.proposals import ringing, searched, series, starts
from ftbias_jax.diagnosis.proposals.pulls import pulls
from ftbias_jax.diagnosis.proposals.series import Dictionary
from ftbias_jax.diagnosis.proposals.touches import touches
from ftbias_jax.diagnosis.regression.fit import Fit, first_order, fit
from ftbias_jax.diagnosis.regression.score_test import prepare_fit
from ftbias_jax.model.effects.fitting import SMOOTH, Grid


class Scored(NamedTuple):
    """Hypothesis fitted together with the accepted ones."""

    fit: Fit
    nats: float
    """Penalised gain in log-likelihood over the accepted hypotheses alone."""

    @property
    def hypothesis(self) -> Hypothesis:
        """The hypothesis that was added."""
        return self.fit.hypotheses[-1]


def score(better: Fit, worse: Fit) -> float:
    """Gain of one fit over another in nats, after the penalty for its additional parameters."""
    return (
        better.log_likelihood
        - worse.log_likelihood
        - thresholds.PENALTY_PER_PARAMETER * (better.degrees - worse.degrees)
    )


def candidates(
    problem: Problem,
    dictionary: Callable[[], Dictionary],
    accepted: Fit,
    without: Collection[str] = (),
    all_smooth: bool = False,
) -> list[Scored]:
    """All effects that are not accepted yet, each fitted together with the accepted ones; best first.

    Effects in ``without`` are not proposed. ``dictionary`` returns the whitened series that may be proposed. With
    ``all_smooth``, weak smooth effects are included to first order, so that the ranking is complete.
    """
    unseen = {name for name, effect in problem.catalogue.items() if not problem.recorded.issuperset(effect.needs)}
    taken = {h.effect for h in accepted.hypotheses} | set(without) | set(problem.known) | unseen
    prepared_fit = prepare_fit(accepted)
    found, columns = starts.smooth(problem, prepared_fit, taken)
    for make in (starts.from_starts, ringing.loose, pulls, searched.best_starts):
        found += make(problem, prepared_fit, taken)
    found += series.best_series(problem, dictionary(), accepted, taken)
    smooth = np.concatenate([accepted.columns.moving, *columns.values()])
    found += touches(problem, dictionary(), accepted, taken, smooth)
    best: dict[tuple[str, int], Found] = {}
    for gain, h in found:
        penalised, key = gain - penalty(h), (h.effect, h.group)
        if penalised > thresholds.LEAST_GAIN and (key not in best or penalised > best[key][0]):
            best[key] = (penalised, h)
    top = max((gain for gain, _ in best.values()), default=0.0)
    fits: list[Fit] = []
    for gain, h in best.values():
        if gain > (thresholds.WORTH_FITTING if _is_smooth(problem, h) else thresholds.WORTH_SEARCHING) * top:
            fits.append(fit(problem, (*accepted.hypotheses, h), accepted, thresholds.ROUGHLY, thresholds.ROUGH_STEPS))
        elif all_smooth and _is_smooth(problem, h):
            fits.append(first_order(accepted, h, columns[h]))
    polished = _polish(problem, accepted, [Scored(one, score(one, accepted)) for one in fits])
    return _without_idle_forms(problem, _best_of_each(problem, polished))


def _is_smooth(problem: Problem, h: Hypothesis) -> bool:
    """Whether the derivative at zero strength determines the effect completely."""
    return isinstance(problem.catalogue[h.effect].fit.search, SMOOTH)


def _polish(problem: Problem, accepted: Fit, scored: list[Scored]) -> list[Scored]:
    """Fit the best candidates to convergence; best first."""
    top = max((s.nats for s in scored), default=0.0)

    def polished(s: Scored) -> Scored:
        near = (
            thresholds.POLISHED
            if _is_smooth(problem, s.hypothesis) or s.hypothesis.shapes
            else thresholds.POLISHED_SEARCHED
        )
        end = _end(problem, s.fit) if s.fit.free and s.nats > near * top else s.fit
        return Scored(end, score(end, accepted))

    by_joints = nats_of_joints(problem)

    def merit(s: Scored) -> float:
        nats = s.nats - by_joints * _is_other_form(problem, s.hypothesis)
        return -nats * problem.catalogue[s.hypothesis.effect].fit.credit

    return sorted(map(polished, scored), key=merit)


def _is_other_form(problem: Problem, h: Hypothesis) -> bool:
    """Whether an effect is not in its usual form, such as a filter of another order.

    Some form always fits errors of the joints, so it ranks first only if it gains more than these errors can cause.
    """
    return isinstance(problem.catalogue[h.effect].fit.search, Grid) and any(value for _, value in h.fixed)


def _end(problem: Problem, rough: Fit) -> Fit:
    """Converged fit, with more or one fewer free parameters if the effect has such a form and gains by it."""
    end = fit(problem, rough.hypotheses, rough)
    for form in (ringing.freed, ringing.sagging):
        other = form(problem, end)
        if other is not None:
            trial = fit(problem, (*rough.hypotheses[:-1], other), end)
            end = trial if score(trial, end) > 0 else end
    return end


def _without_idle_forms(problem: Problem, scored: list[Scored]) -> list[Scored]:
    """Drop general forms of other candidates that gain no more than chance over them or have no certain parameter."""
    nats = {s.hypothesis.effect: s.nats for s in scored}

    def is_idle(s: Scored) -> bool:
        effect = problem.catalogue[s.hypothesis.effect]
        if effect.fit.extends not in nats:
            return False
        if s.nats < nats[effect.fit.extends] + thresholds.LEAST_GAIN:
            return True
        value, stderr = parameters(problem, s.fit, s.hypothesis)
        own = [p.name for p in effect.parameters if not p.optional]
        return all(np.abs(value[name]) < thresholds.SURE * np.asarray(stderr[name]) for name in own)

    return [s for s in scored if not is_idle(s)]


def _best_of_each(problem: Problem, scored: list[Scored]) -> list[Scored]:
    """Best start of every effect, and of every joint and every form where these are hypotheses of their own."""
    best: dict[tuple[str, int], Scored] = {}
    for s in scored:
        of, group = s.hypothesis.detail, s.hypothesis.group
        own = of if isinstance(of, int) else group * isinstance(problem.catalogue[s.hypothesis.effect].fit.search, Grid)
        best.setdefault((s.hypothesis.effect, own), s)
    return list(best.values())
