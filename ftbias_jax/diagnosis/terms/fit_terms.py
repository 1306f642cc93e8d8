"""Fit of terms together with effects of the catalogue: Gauss-Newton for nonlinear parameters, exact for the rest."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.design_matrix import Columns, change
from ftbias_jax.diagnosis.regression.evaluate import whitened
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.diagnosis.regression.score_test import PreparedFit, gains
from ftbias_jax.model.effects.terms.columns import added, columns, has_point
from ftbias_jax.model.effects.terms.forms import FORMS
from ftbias_jax.model.effects.terms.types import State, Term

MOST_STEPS = 10
ENOUGH = 0.5
"""nats; the iteration ends with a step that gains less."""
DAMPINGS = (0.0, 0.1, 3.0)
"""Damping factors of the nonlinear parameters, from the last one that worked, or from 0 if no step is too long."""
RELATIVE_STEP = 1e-3
POINT_SCALE = 0.05
"""m, scale of a point's coordinates."""
LOCAL = ("time", "takes")
"""Parameters that only the bins at a switching time constrain."""
TIME_SCALE = 0.02
"""s, scale of times: one or two bins."""
RESOLUTION = 0.2
"""Scale of a frequency, as a multiple of one over the duration of the logs."""
LONGEST_STEP = 0.7
"""Longest step, in scales of a parameter."""


class Solved(NamedTuple):
    """Terms at given parameters and points, with the best coefficients beside a fit."""

    terms: tuple[Term, ...]
    error: np.ndarray
    """(U, 6) remaining innovations, in standard deviations."""
    log_likelihood: float
    """nats, as of a fit."""
    white: np.ndarray
    """(K, U, 6) columns of the coefficients, which lower the reading."""
    step: np.ndarray
    """(S,) change of the fit's own parameters."""


class Described(NamedTuple):
    """Terms at their optimum, fitted together with the effects of a fit."""

    terms: tuple[Term, ...]
    fit: Fit
    """Its coordinates come first in ``columns.moving``, then each term's coefficients, parameters and point, scaled."""
    scales: tuple[np.ndarray, ...]
    """Scales in the columns of each term's numbers, in that order."""
    local_stderr: tuple[dict[str, np.ndarray], ...]
    """s, of each term's ``LOCAL`` parameters, which have no columns: other blocks do not predict switching times."""


class _Place(NamedTuple):
    """Component of a term that is not a coefficient."""

    term: int
    name: str
    """Name of the parameter; "" for the point."""
    axis: int
    """Axis of the point, or index in a list."""
    scale: float
    least: float
    most: float


def improve(
    problem: Problem,
    state: State,
    prepared_fit: PreparedFit,
    terms: tuple[Term, ...],
    steps: int = MOST_STEPS,
    enough: float = 0.0,
) -> Solved:
    """Terms improved jointly, to first order in the parameters of the fit beside them.

    Makes at most this many Gauss-Newton steps from the current parameters and points; the last one gains less than a
    share ``enough`` of the total gain.
    """
    places = _places(terms, float(np.ptp(state.t)))
    now, level = _solve(problem, state, prepared_fit, terms), 0
    for _ in range(steps if places else 0):
        least = max(ENOUGH, enough * (now.log_likelihood - prepared_fit.fit.log_likelihood))
        reduced = _reduced(prepared_fit, now, _slopes(problem, state, now.terms, places))
        free, promised = _step(*reduced, 0.0)
        if promised < least:
            break
        least_level = level if np.abs(free).max() > LONGEST_STEP else 0
        best = now
        for level in range(least_level, len(DAMPINGS)):
            step = np.clip(_step(*reduced, DAMPINGS[level])[0], -LONGEST_STEP, LONGEST_STEP)
            trial = _solve(problem, state, prepared_fit, _moved(now.terms, places, step))
            best = max(best, trial, key=lambda solved: solved.log_likelihood)
            gained = trial.log_likelihood - now.log_likelihood
            if gained > least:
                break
        gained, now = best.log_likelihood - now.log_likelihood, best
        if gained < least:
            break
    return now


def fit_terms(problem: Problem, state: State, prepared_fit: PreparedFit, terms: tuple[Term, ...]) -> Described:
    """Terms fitted to convergence, with everything that a fit has. Arguments as in ``improve``."""
    now = improve(problem, state, prepared_fit, terms)
    return _described(problem, state, prepared_fit.fit, now, _places(terms, float(np.ptp(state.t))))


def _places(terms: tuple[Term, ...], duration: float) -> list[_Place]:
    """Nonlinear parameters; the scale of a frequency is a fraction of the resolution over the duration (s)."""
    found = []
    for i, term in enumerate(terms):
        for parameter in FORMS[term.drive, term.form].parameters:
            for k, value in enumerate(np.ravel(term.parameters[parameter.name])):
                scale = max(abs(float(value)), 0.2 if parameter.unit in ("m", "1") else 0.02)
                if parameter.name == "frequency" and term.form != "swing":
                    scale = RESOLUTION / duration
                elif parameter.several:
                    scale = TIME_SCALE
                found.append(_Place(i, parameter.name, k, scale, parameter.least, parameter.most))
        if has_point(term):
            found += [_Place(i, "", axis, POINT_SCALE, -1.0, 1.0) for axis in range(3)]
    return found


def _solve(problem: Problem, state: State, prepared_fit: PreparedFit, terms: tuple[Term, ...]) -> Solved:
    """Coefficients of the terms, and the resulting change of the fit's own parameters."""
    pieces = [np.asarray(columns(np, term, state)).transpose(1, 0, 2) for term in terms]
    raw, start = -np.concatenate(pieces), prepared_fit.fit
    if not np.isfinite(raw).all():
        return Solved(terms, start.error, -np.inf, raw, np.zeros(len(prepared_fit.pull)))
    white = whitened(problem, raw)
    norm = np.sqrt(np.einsum("kuc,kuc->k", white, white)) + 1e-9
    prepared = gains(prepared_fit, white / norm[:, None, None])
    numbers = prepared.coefficients(list(range(len(white))))
    step = prepared_fit.step - prepared.taken @ numbers
    error = start.error + change(start.columns, step) + np.tensordot(numbers / norm, white, 1)
    own = np.split(numbers / norm, np.cumsum([len(piece) for piece in pieces])[:-1])
    solved = tuple(replace(term, coefficients=c) for term, c in zip(terms, own, strict=True))
    return Solved(solved, error, -float(error.ravel() @ error.ravel()) / 2, white, step)


def _slopes(problem: Problem, state: State, terms: tuple[Term, ...], places: list[_Place]) -> np.ndarray:
    """(N, U, 6) whitened derivatives of the reading with respect to the nonlinear parameters, per scale."""
    if not places:
        return np.zeros((0, len(problem.t), 6))
    found = []
    stays = [added(np, term, state) for term in terms]
    for place in places:
        here, by = terms[place.term], RELATIVE_STEP
        there = _moved(terms, [place], [by])[place.term]
        same = [np.array_equal(there.parameters[name], here.parameters[name]) for name in here.parameters]
        if all(same) and (there.point == here.point).all():  # at its upper bound
            by = -RELATIVE_STEP
            there = _moved(terms, [place], [by])[place.term]
        found.append((added(np, there, state) - stays[place.term]) / by)
    return whitened(problem, np.stack(found))


def _reduced(prepared_fit: PreparedFit, now: Solved, slopes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Normal matrix (N, N) and gradient of the slopes after projecting out the linear parameters, and their power."""
    norm = np.sqrt(np.einsum("kuc,kuc->k", now.white, now.white)) + 1e-9
    prepared = gains(prepared_fit.at(now.error), np.concatenate([now.white / norm[:, None, None], slopes]))
    K, normal, pull = len(norm), prepared.normal, prepared.pull
    taken = np.linalg.solve(normal[:K, :K] + 1e-8 * np.eye(K), normal[:K, K:])
    power = np.einsum("nuc,nuc->n", slopes, slopes)
    return normal[K:, K:] - normal[K:, :K] @ taken, pull[K:] - taken.T @ pull[:K], power


def _step(normal: np.ndarray, pull: np.ndarray, power: np.ndarray, damping: float) -> tuple[np.ndarray, float]:
    """Step (N,) of the nonlinear parameters, and the predicted gain in nats."""
    ridge = 1e-9 * power.mean() + 1e-12
    step = -np.linalg.solve(normal + np.diag(damping * power + ridge), pull)
    return step, float(-pull @ step - step @ normal @ step / 2)


def _described(problem: Problem, state: State, start: Fit, now: Solved, places: list[_Place]) -> Described:
    slopes = _slopes(problem, state, now.terms, places)
    # At the edge of a bin the slope is zero, so a time is known to within a bin at best.
    width, power = np.median(np.diff(state.t)), np.einsum("nuc,nuc->n", slopes, slopes)
    formal = np.array([place.scale for place in places]) / np.sqrt(power + 1e-12)
    sure = np.hypot(width / np.sqrt(12), np.minimum(formal, width))
    moving, scales, late, row = [start.columns.moving], [], [], 0
    for i, term in enumerate(now.terms):
        count = len(term.coefficients)
        there = [k for k, place in enumerate(places) if place.term == i]
        own = [k for k in there if places[k].name not in LOCAL]
        timed = {name: [k for k in there if places[k].name == name] for name in LOCAL if name in term.parameters}
        # A coefficient's column is scaled by its size, so that its prior has no influence.
        size = np.maximum(np.abs(term.coefficients), 1e-12)
        moving += [now.white[row : row + count] * size[:, None, None], slopes[own]]
        scales.append(np.concatenate([size, [places[k].scale for k in own]]))
        late.append({name: sure[rows] for name, rows in timed.items()})
        row += count
    columns_of_all = Columns(np.concatenate(moving), start.columns.series)
    z, free, first = start.z.copy(), len(start.free), len(start.columns.moving)
    z[list(start.free)] += now.step[:free]
    coefficients = start.coefficients + now.step[first:]
    fit = start._replace(
        z=z, coefficients=coefficients, error=now.error, columns=columns_of_all, log_likelihood=now.log_likelihood
    )
    return Described(now.terms, fit, tuple(scales), tuple(late))


def _moved(terms: tuple[Term, ...], places: list[_Place], step: Sequence[float] | np.ndarray) -> tuple[Term, ...]:
    found = list(terms)
    for place, by in zip(places, step, strict=True):
        term = found[place.term]
        if place.name:
            values = np.array(term.parameters[place.name], float)
            values.flat[place.axis] = np.clip(values.flat[place.axis] + by * place.scale, place.least, place.most)
            ascending = np.sort(values) if values.ndim else values
            found[place.term] = replace(term, parameters={**term.parameters, place.name: ascending})
        else:
            point = np.array(term.point, float)
            point[place.axis] = np.clip(point[place.axis] + by * place.scale, place.least, place.most)
            found[place.term] = replace(term, point=point)
    return tuple(found)
