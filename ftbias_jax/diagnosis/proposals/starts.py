"""Gain of each effect: by one linearisation if it is smooth at zero, from several starts otherwise."""

from collections.abc import Collection, Sequence
from itertools import product

import numpy as np

from ftbias_jax.diagnosis.hypothesis import (
    Found,
    Hypothesis,
    at_values,
    at_zero,
    movable,
    places_of,
    search_of,
    searched_by,
)
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.proposals.ringing import usual
from ftbias_jax.diagnosis.regression.evaluate import readings, slopes, whitened
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.diagnosis.regression.score_test import PreparedFit, gain_of_each, gains
from ftbias_jax.diagnosis.thresholds import LEAST_ENTRY, MOST_ENTRIES
from ftbias_jax.model.effects.fitting import SMOOTH, ByJoint, Entries, Grid, Linear
from ftbias_jax.model.effects.types import Effect


def smooth_hypotheses(problem: Problem, taken: Collection[str]) -> list[Hypothesis]:
    """Hypotheses that one linearisation evaluates; each joint and each variant of an effect is one of its own."""
    return [h for effect in searched_by(problem, taken, *SMOOTH) for h in _of_smooth(problem, effect)]


def _of_smooth(problem: Problem, effect: Effect) -> list[Hypothesis]:
    match effect.fit.search:
        case ByJoint():
            joints = enumerate(problem.layout.of_effect(effect.name), 1)
            return [at_zero(effect.name, [i])._replace(detail=joint, group=joint) for joint, i in joints]
        case Linear(variants):
            whole = at_zero(effect.name, movable(problem, effect))
            held = [tuple(places_of(problem, effect, **dict(variant)).items()) for variant in variants]
            return [whole._replace(fixed=fixed) for fixed in held]
        case _:
            return [at_zero(effect.name, movable(problem, effect))]


def smooth(
    problem: Problem, prepared_fit: PreparedFit, taken: Collection[str]
) -> tuple[list[Found], dict[Hypothesis, np.ndarray]]:
    """Gains, and for each hypothesis the whitened derivatives (F, U, 6) with respect to its coordinates."""
    wanted = smooth_hypotheses(problem, taken)
    found: list[Found] = []
    columns: dict[Hypothesis, np.ndarray] = {}
    accepted = prepared_fit.fit.hypotheses
    for fixed in dict.fromkeys(h.fixed for h in wanted):
        alike = [h for h in wanted if h.fixed == fixed]
        places = [i for h in alike for i in h.free]
        white = whitened(problem, slopes(problem, alike[0].begin(prepared_fit.fit.z), places))
        prepared, row = gains(prepared_fit, white), iter(range(len(places)))
        for h in alike:
            rows = [next(row) for _ in h.free]
            sparse = isinstance(problem.catalogue[h.effect].fit.search, Entries) or _adds_to_twin(problem, accepted, h)
            gain, chosen = prepared.pursue(rows, MOST_ENTRIES, LEAST_ENTRY) if sparse else (prepared.of(rows), rows)
            few = h._replace(free=tuple(places[i] for i in chosen), start=(0.0,) * len(chosen))
            columns[few] = white[chosen]
            found += [(gain, few)] if chosen else []
    return found, columns


def _adds_to_twin(problem: Problem, accepted: Sequence[Hypothesis], h: Hypothesis) -> bool:
    """Whether an effect with one parameter per channel joins a twin of all channels: then only some channels differ."""
    effect = problem.catalogue[h.effect]
    by_channel = [parameter.shape for parameter in effect.parameters] == [problem.noise_std.shape]
    return by_channel and not {twin.effect for twin in effect.twins}.isdisjoint(other.effect for other in accepted)


def grid_hypotheses(problem: Problem, span: np.ndarray, taken: Collection[str]) -> list[Hypothesis]:
    """Starting points of effects that are fitted from several; span (6,) N, Nm: range of the predicted load."""
    found = []
    for effect in searched_by(problem, taken, Grid):
        load = span if search_of(effect, Grid).per_load else 1.0
        searched = [parameter for parameter in effect.parameters if parameter.starts]
        for starts in product(*(parameter.starts for parameter in searched)):
            values = {p.name: start * load for p, start in zip(searched, starts, strict=True)}
            found.append(at_values(problem, effect, **values))
    held = list(dict.fromkeys(h.fixed for h in found))
    return [h._replace(group=held.index(h.fixed)) for h in found]


def from_starts(problem: Problem, prepared_fit: PreparedFit, taken: Collection[str]) -> list[Found]:
    """Gain of each starting point, unscaled or scaled to fit."""
    now = readings(problem, prepared_fit.fit.z[None])[0]
    wanted = [*grid_hypotheses(problem, np.ptp(now, axis=0), taken), *usual(problem, taken)]
    if not wanted:
        return []
    unscaled, changes = as_they_are(problem, prepared_fit.fit, wanted)
    scaled, _ = gain_of_each(prepared_fit, changes)
    found = list(zip(np.maximum(unscaled, scaled / 2).tolist(), wanted, strict=True))
    for i, h in enumerate(wanted):
        search = problem.catalogue[h.effect].fit.search
        if isinstance(search, Grid) and search.per_load:
            found[i] = (gains(prepared_fit, changes[i] * np.eye(6)[:, None]).of(list(range(6))), h)
    return found


def as_they_are(problem: Problem, accepted: Fit, starts: Sequence[Hypothesis]) -> tuple[np.ndarray, np.ndarray]:
    """(S,) gain of each of S starts without scaling, and (S, U, 6) its whitened change of the reading."""
    made = readings(problem, np.stack([accepted.z, *(h.begin(accepted.z) for h in starts)]))
    changes = whitened(problem, made[1:] - made[0])
    return -(accepted.error * changes).sum((1, 2)) - (changes**2).sum((1, 2)) / 2, changes
