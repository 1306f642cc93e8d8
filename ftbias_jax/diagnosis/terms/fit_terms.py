"""Terms fitted beside the effects of the catalogue: Gauss-Newton in what is not linear, the rest is solved for."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.design_matrix import Columns, change, information, lay_out, products
from ftbias_jax.diagnosis.regression.evaluate import whitened
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.model.effects.terms.columns import columns, has_point
from ftbias_jax.model.effects.terms.forms import FORMS
from ftbias_jax.model.effects.terms.types import State, Term

MOST_STEPS = 10
ENOUGH = 0.5
"""nats; a step that gains less is the last."""
DAMPINGS = (0.0, 0.1, 3.0)
RELATIVE_STEP = 1e-3
POINT_SCALE = 0.05
"""m."""
RESOLUTION = 0.2
"""Of one over the duration of the logs, in which a frequency is moved."""
LONGEST_STEP = 0.7
"""Of a parameter's scale in one step."""


class Described(NamedTuple):
    """Terms at their best beside the effects of a fit."""

    terms: tuple[Term, ...]
    fit: Fit
    """Its coordinates come first in ``columns.moving``, then each term's coefficients, parameters and point, scaled."""
    scales: tuple[np.ndarray, ...]
    """Of each term's numbers, in that order: their units in the columns."""


class _Place(NamedTuple):
    """One number of a term that is not a coefficient."""

    term: int
    name: str
    """Of the parameter; "" for the point."""
    axis: int
    scale: float
    least: float
    most: float


def fit_terms(
    problem: Problem, state: State, start: Fit, terms: tuple[Term, ...], steps: int = MOST_STEPS
) -> Described:
    """The terms together at their best, to first order in the coordinates of the start.

    Args:
        problem: of the logs.
        state: of all logs end to end.
        start: the effects of the catalogue beside them.
        terms: with parameters and points to start from.
        steps: of Gauss-Newton at most.
    """
    places = _places(terms, float(np.ptp(state.t)))
    now = _solve(problem, state, start, terms)
    for _ in range(steps if places else 0):
        slopes = _slopes(problem, state, now.terms, places)
        best = now
        for step in _steps(start, now, slopes):
            trial = _solve(problem, state, start, _moved(now.terms, places, step))
            best = min(best, trial, key=lambda solved: solved.cost)
            if best.cost < now.cost - ENOUGH:
                break
        gained, now = now.cost - best.cost, best
        if gained < ENOUGH:
            break
    return _described(problem, state, start, now, places)


def _places(terms: tuple[Term, ...], duration: float) -> list[_Place]:
    """Numbers that are not linear; a frequency may move by a part of what the duration (s) tells apart."""
    found = []
    for i, term in enumerate(terms):
        for parameter in FORMS[term.drive, term.form].parameters:
            value = float(term.parameters[parameter.name])
            scale = max(abs(value), 0.2 if parameter.unit in ("m", "1") else 0.02)
            if parameter.name == "frequency" and term.form != "swing":
                scale = RESOLUTION / duration
            found.append(_Place(i, parameter.name, 0, scale, parameter.least, parameter.most))
        if has_point(term):
            found += [_Place(i, "", axis, POINT_SCALE, -1.0, 1.0) for axis in range(3)]
    return found


class _Solved(NamedTuple):
    """Coefficients at given parameters and points."""

    terms: tuple[Term, ...]
    numbers: np.ndarray
    """Of the start's columns and of the terms', in the order of a fit's."""
    white: np.ndarray
    """(K, U, 6) columns of the coefficients, which lower the reading."""
    error: np.ndarray
    cost: float


def _solve(problem: Problem, state: State, start: Fit, terms: tuple[Term, ...]) -> _Solved:
    """Coefficients of the terms and of the start's columns."""
    pieces = [np.asarray(columns(np, term, state)).transpose(1, 0, 2) for term in terms]
    raw = -np.concatenate(pieces)
    if not np.isfinite(raw).all():
        return _Solved(terms, np.zeros(0), raw, start.error, np.inf)
    white = whitened(problem, raw)
    norm = np.sqrt((white**2).sum((1, 2))) + 1e-9
    first, count = len(start.columns.moving), len(white)
    whole = Columns(np.concatenate([start.columns.moving, white / norm[:, None, None]]), start.columns.series)
    # The coordinates of the start have their prior; what is added has none.
    pull = products(lay_out(whole), start.error[None])[0]
    numbers = -information(whole, first).solve(pull[:, None])[:, 0]
    error = start.error + change(whole, numbers)
    numbers[first : first + count] /= norm
    ends = np.cumsum([len(piece) for piece in pieces])[:-1]
    own = np.split(numbers[first : first + count], ends)
    solved = tuple(replace(term, coefficients=c) for term, c in zip(terms, own, strict=True))
    return _Solved(solved, numbers, white, error, float((error**2).sum()) / 2)


def _slopes(problem: Problem, state: State, terms: tuple[Term, ...], places: list[_Place]) -> np.ndarray:
    """(N, U, 6) whitened derivatives of the reading by the numbers that are not linear, per scale."""
    if not places:
        return np.zeros((0, len(problem.t), 6))
    found = []
    stays = [_reading(term, state) for term in terms]
    for i, place in enumerate(places):
        step = np.zeros(len(places))
        step[i] = RELATIVE_STEP
        (here,), (there,) = ((one[place.term],) for one in (terms, _moved(terms, places, step)))
        if there.parameters == here.parameters and (there.point == here.point).all():  # at its upper bound
            step[i] = -RELATIVE_STEP
            there = _moved(terms, places, step)[place.term]
        found.append((_reading(there, state) - stays[place.term]) / step[i])
    return whitened(problem, np.stack(found))


def _reading(term: Term, state: State) -> np.ndarray:
    """(U, 6) what a term adds to the reading."""
    added: np.ndarray = -np.einsum("tkc,k->tc", columns(np, term, state), term.coefficients)
    return added


def _steps(start: Fit, now: _Solved, slopes: np.ndarray) -> list[np.ndarray]:
    """Steps (N,) of the numbers that are not linear, the longest first."""
    norm = np.sqrt((now.white**2).sum((1, 2))) + 1e-9
    moving = np.concatenate([start.columns.moving, now.white / norm[:, None, None], slopes])
    whole, first = Columns(moving, start.columns.series), len(moving) - len(slopes)
    told, pull = information(whole, len(start.columns.moving)), products(lay_out(whole), now.error[None])[0]
    own = np.arange(first, len(moving))
    found = []
    for damping in DAMPINGS:
        stiff = told.moving.copy()
        stiff[own, own] *= 1 + damping
        stiff[own, own] += 1e-9 * np.trace(stiff) / len(stiff)
        step = -told._replace(moving=stiff).solve(pull[:, None])[own, 0]
        found.append(np.clip(step, -LONGEST_STEP, LONGEST_STEP))
    return found


def _described(problem: Problem, state: State, start: Fit, now: _Solved, places: list[_Place]) -> Described:
    """The fit with all columns that the terms' numbers have."""
    slopes = _slopes(problem, state, now.terms, places)
    moving, scales, row = [start.columns.moving], [], 0
    for i, term in enumerate(now.terms):
        count = len(term.coefficients)
        own = [k for k, place in enumerate(places) if place.term == i]
        # A coefficient's column is scaled by its size, so that no prior matters.
        size = np.maximum(np.abs(term.coefficients), 1e-12)
        moving += [now.white[row : row + count] * size[:, None, None], slopes[own]]
        scales.append(np.concatenate([size, [places[k].scale for k in own]]))
        row += count
    columns_of_all = Columns(np.concatenate(moving), start.columns.series)
    first = len(start.columns.moving)
    z, free = start.z.copy(), len(start.free)
    z[list(start.free)] += now.numbers[:free]
    coefficients = start.coefficients + now.numbers[first + len(now.white) :]
    fit = start._replace(
        z=z, coefficients=coefficients, error=now.error, columns=columns_of_all, log_likelihood=-now.cost
    )
    return Described(now.terms, fit, tuple(scales))


def _moved(terms: tuple[Term, ...], places: list[_Place], step: np.ndarray) -> tuple[Term, ...]:
    found = list(terms)
    for place, by in zip(places, step, strict=True):
        term = found[place.term]
        if place.name:
            value = np.clip(float(term.parameters[place.name]) + by * place.scale, place.least, place.most)
            found[place.term] = replace(term, parameters={**term.parameters, place.name: np.asarray(value)})
        else:
            point = np.array(term.point, float)
            point[place.axis] = np.clip(point[place.axis] + by * place.scale, place.least, place.most)
            found[place.term] = replace(term, point=point)
    return tuple(found)
