"""Every effect fitted on top of those accepted so far."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis import hypothesis as hyp
from ftbias_jax.diagnosis.hypothesis import Hypothesis
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.proposals import bias_changes, contact, flexibility
from ftbias_jax.diagnosis.proposals.cables import cables
from ftbias_jax.diagnosis.proposals.own import own
from ftbias_jax.diagnosis.regression import chain_model
from ftbias_jax.diagnosis.regression.dictionary import Found, Library
from ftbias_jax.diagnosis.regression.evaluate import readings, slopes, whitened
from ftbias_jax.diagnosis.regression.fit import Fit, first_order, fit, keep
from ftbias_jax.diagnosis.regression.score_test import Standing, gain_of_each, gains, stand

LEAST_GAIN = 12.0
"""nats beyond the penalty; white noise reaches it in one log of thousands."""
WORTH_FITTING = 0.5
"""Share of the best preliminary gain from which on a smooth effect is fitted in full: its own is nearly exact."""
WORTH_SEARCHING = 0.15
"""The same of other effects, whose gain may grow much while they are fitted."""
ROUGHLY = 0.03
"""Share of its whole gain; the last step of a first fit gains less."""
ROUGH_STEPS = 4
POLISHED, POLISHED_SEARCHED = 0.85, 0.5
"""Shares of the best gain from which on a fit is brought to its end: of a smooth effect, and of another one."""
HANDICAP = {"crosstalk": 0.95, "contact": 0.8}
"""Share of their gain that counts when effects are ranked that can take nearly any shape: a structured explanation
nearly as good as theirs comes first."""
MOST_LEAKS = 12
"""Entries of the crosstalk matrix that may be named."""
LEAST_LEAK = 0.01
"""Share of the gain that each of them must add."""


class Scored(NamedTuple):
    """A hypothesis fitted together with the accepted ones."""

    fit: Fit
    gain: float
    """nats over the accepted ones alone, after the penalty."""

    @property
    def hypothesis(self) -> Hypothesis:
        """The one that was added."""
        return self.fit.hypotheses[-1]


def score(better: Fit, worse: Fit) -> float:
    """nats that one fit gains over another, after the penalty."""
    return better.log_likelihood - worse.log_likelihood - hyp.NATS_PER_DEGREE * (better.degrees - worse.degrees)


def candidates(problem: Problem, library: Library, accepted: Fit, without: Collection[str] = ()) -> list[Scored]:
    """Every effect that is not accepted yet, fitted on top of the accepted ones; best first.

    While nothing is accepted, weak smooth effects are there too, to first order: they make the ranking whole.
    """
    taken = {h.effect for h in accepted.hypotheses} | set(without) | set(problem.known)
    standing = stand(accepted)
    found, columns = _smooth(problem, standing, taken)
    found += _grid(problem, standing, taken)
    if flexibility.EFFECT not in taken:
        found += flexibility.loose(problem, standing)
    if "cable" not in taken:
        found += cables(problem, standing)
    found += own(problem, standing, taken)
    for make in (bias_changes.slow, bias_changes.jump):
        found += make(problem, library, accepted, taken)
    smooth = np.concatenate([accepted.columns.moving, *columns.values()])
    found += contact.contacts(problem, library, accepted, taken, smooth)
    best: dict[tuple[str, float], Found] = {}
    for i, (gain, h) in enumerate(found):
        penalised, key = gain - hyp.penalty(h), (h.effect, _start(i, h))
        if penalised > LEAST_GAIN and (key not in best or penalised > best[key][0]):
            best[key] = (penalised, h)
    top = max((gain for gain, _ in best.values()), default=0.0)
    fits = [
        first_order(accepted, h, columns[h])
        if gain <= _worth(h) * top
        else fit(problem, (*accepted.hypotheses, h), accepted, ROUGHLY, ROUGH_STEPS)
        for gain, h in best.values()
        if gain > _worth(h) * top or (h.effect in hyp.SMOOTH and not accepted.hypotheses)
    ]
    return _best_of_each(_polish(problem, accepted, [Scored(one, score(one, accepted)) for one in fits]))


def _start(number: int, h: Hypothesis) -> float:
    """What tells starting points of one effect apart that are all fitted."""
    if h.effect == flexibility.EFFECT:
        return flexibility.start_of(h)
    return float(number) if h.each else _joint(h)


def _joint(h: Hypothesis) -> float:
    """The number of the joint that a hypothesis speaks of; 0 if it speaks of none."""
    return h.detail[0] if h.effect == "encoder_offset" else 0.0


def _worth(h: Hypothesis) -> float:
    """Share of the best preliminary gain from which on a hypothesis is fitted in full."""
    return WORTH_FITTING if h.effect in hyp.SMOOTH else WORTH_SEARCHING


def _polish(problem: Problem, accepted: Fit, scored: list[Scored]) -> list[Scored]:
    """The best ones fitted to the end; best first."""
    top = max((s.gain for s in scored), default=0.0)
    ends = (_end(problem, s.fit) if s.fit.free and s.gain > _near(s.hypothesis) * top else s.fit for s in scored)
    return sorted((Scored(one, score(one, accepted)) for one in ends), key=lambda scored: -_merit(scored))


def _near(h: Hypothesis) -> float:
    """Share of the best gain from which on a fit is brought to its end."""
    return POLISHED if h.effect in hyp.SMOOTH or h.shapes else POLISHED_SEARCHED


def _end(problem: Problem, rough: Fit) -> Fit:
    """A fit brought to its end, with more numbers free where an effect has a more general form and gains by it."""
    end = fit(problem, rough.hypotheses, rough)
    general = flexibility.freed(problem, end)
    if general is None:
        return end
    freer = fit(problem, (*rough.hypotheses[:-1], general), end)
    return freer if score(freer, end) > 0 else end


def _merit(scored: Scored) -> float:
    return scored.gain * HANDICAP.get(scored.hypothesis.effect, 1.0)


def _best_of_each(scored: list[Scored]) -> list[Scored]:
    """One start of every effect, and one of every joint."""
    best: dict[tuple[str, float], Scored] = {}
    for s in scored:
        best.setdefault((s.hypothesis.effect, _joint(s.hypothesis)), s)
    return list(best.values())


def _smooth(
    problem: Problem, standing: Standing, taken: Collection[str]
) -> tuple[list[Found], dict[Hypothesis, np.ndarray]]:
    """Gains, and for each hypothesis the whitened derivatives (F, U, 6) by its coordinates."""
    n = problem.joints
    wanted = [h for h in hyp.smooth_hypotheses(n) if h.effect not in taken]
    if "crosstalk" not in taken:
        leaks = chain_model.coordinates(n, "crosstalk").tolist()
        wanted.append(Hypothesis("crosstalk", tuple(leaks), (0.0,) * len(leaks)))
    found: list[Found] = []
    columns: dict[Hypothesis, np.ndarray] = {}
    for fixed in dict.fromkeys(h.fixed for h in wanted):
        alike = [h for h in wanted if h.fixed == fixed]
        places = [i for h in alike for i in h.free]
        white = whitened(problem, slopes(problem, keep(standing.fit.z, alike[0]), standing.fit.link, places))
        prepared, row = gains(standing, white), iter(range(len(places)))
        for h in alike:
            rows = [next(row) for _ in h.free]
            sparse = h.effect == "crosstalk"
            gain, chosen = prepared.pursue(rows, MOST_LEAKS, LEAST_LEAK) if sparse else (prepared.of(rows), rows)
            few = h._replace(free=tuple(places[i] for i in chosen), start=(0.0,) * len(chosen))
            columns[few] = white[chosen]
            found += [(gain, few)] if chosen else []
    return found, columns


def _grid(problem: Problem, standing: Standing, taken: Collection[str]) -> list[Found]:
    """Gain of each starting point, as it is or scaled to fit."""
    accepted = standing.fit
    now = readings(problem, accepted.z[None], np.array([accepted.link]))[0]
    wanted = [*hyp.grid_hypotheses(problem, np.ptp(now, axis=0)), *flexibility.usual(problem)]
    wanted = [h for h in wanted if h.effect not in taken]
    if not wanted:
        return []
    z = np.stack([keep(accepted.z, h) for h in wanted])
    for row, h in zip(z, wanted, strict=True):
        row[list(h.free)] = h.start
    changes = whitened(problem, readings(problem, z, np.full(len(z), accepted.link)) - now)
    scaled, _ = gain_of_each(standing, changes)
    found = []
    for i, (h, change) in enumerate(zip(wanted, changes, strict=True)):
        if h.effect == "hysteresis":
            channels = change[None] * np.eye(6)[:, None]
            found.append((gains(standing, channels).of(list(range(6))), h))
        else:
            as_it_is = float(-(accepted.error * change).sum() - (change**2).sum() / 2)
            found.append((max(as_it_is, float(scaled[i]) / 2), h))
    return found
