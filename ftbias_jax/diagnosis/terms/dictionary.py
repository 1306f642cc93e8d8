"""Library of the grid's whitened terms, computed once, and the gain of each in addition to a fit."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.design_matrix import channels_first
from ftbias_jax.diagnosis.regression.evaluate import whiten_lanes
from ftbias_jax.diagnosis.regression.score_test import Gains, PreparedFit
from ftbias_jax.diagnosis.terms.grid import free_names
from ftbias_jax.diagnosis.thresholds import LEAST_ENTRY, MOST_NUMBERS, PENALTY_PER_PARAMETER, SHARE_PER_NUMBER
from ftbias_jax.model.effects.terms.columns import (
    acts_on_channels,
    channel_series,
    columns,
    count_columns,
    has_point,
    torques,
    vectors_of,
)
from ftbias_jax.model.effects.terms.types import State, Term

ROUNDS = 6
"""Alternating solutions for the coefficients and the point of a force."""
AT_ONE_POINT = (
    ("position", "attraction"),
    ("position", "quadratic"),
    ("position", "surface"),
    ("velocity", "local"),
    ("time", "step"),
    ("time", "wave"),
    ("frequency", "line"),
)
"""Forms with many starting points: their forces initially act at the tool's centre of mass."""
FORCE, TORQUE, ALL = (np.isin(np.arange(6), own) for own in ((0, 1, 2), (3, 4, 5), range(6)))


class Trial(NamedTuple):
    """Term of the grid with M columns: lanes of the library, each of which acts on some channels."""

    term: Term
    lanes: np.ndarray
    """(M,) indices of the lanes."""
    acts: np.ndarray
    """(M, 6) whether a column acts on a channel."""
    arms: int = 0
    """Number of trailing columns, torques of the other columns' forces about each axis of the sensor, if the point is
    free."""


class Ranked(NamedTuple):
    """Term with its merit."""

    merit: float
    """nats after the penalties."""
    term: Term


class Dictionary(NamedTuple):
    """Whitened lanes in single precision."""

    trials: list[Trial]
    white: np.ndarray
    """(6, L, U), channels first."""
    normals: list[np.ndarray]
    """(M, M) inner products of each trial's columns."""


Place = Callable[[tuple[object, ...], Callable[[], np.ndarray]], range]
"""(key of the lanes, function that makes them (U, L, 6)) -> indices of the lanes, which are reused if they exist."""


def make_dictionary(problem: Problem, state: State, terms: list[Term]) -> Dictionary:
    """Whiten the lanes that the terms need; columns that act on different channels share a lane."""
    pieces: list[np.ndarray] = []
    places: dict[tuple[object, ...], range] = {}

    def place(key: tuple[object, ...], make: Callable[[], np.ndarray]) -> range:
        if key not in places:
            pieces.append(np.ascontiguousarray(make().transpose(2, 1, 0), np.float32))
            first = max((lanes.stop for lanes in places.values()), default=0)
            places[key] = range(first, first + pieces[-1].shape[1])
        return places[key]

    trials = [_trial(term, state, place) for term in terms]
    white = np.concatenate([np.zeros((6, 0, len(problem.t)), np.float32), *pieces], 1)
    whiten_lanes(problem, white)
    return Dictionary(trials, white, [_products(white, trial) for trial in trials])


def _trial(term: Term, state: State, place: Place) -> Trial:
    key = (term.drive, term.form, term.frame, term.joint, *((n, *np.ravel(x)) for n, x in term.parameters.items()))
    if acts_on_channels(term):
        lanes = place((*key, "channels"), lambda: channel_series(np, term, state))
        return Trial(term, np.repeat(lanes, 6), np.tile(np.eye(6, dtype=bool), (len(lanes), 1)))
    if term.acts_as == "force" and (term.drive, term.form) in AT_ONE_POINT:
        lanes = place((id(term),), lambda: columns(np, term, state))
        return Trial(term, np.array(lanes), np.tile(ALL, (len(lanes), 1)))
    both = place(key, lambda: np.tile(vectors_of(np, term, state), 2))
    forces = 0 if term.acts_as == "torque" else len(both)
    own = np.concatenate([both[:forces], both[: count_columns(term) - forces]]).astype(int)
    acts = np.where(np.arange(len(own))[:, None] < forces, FORCE, TORQUE)
    if not has_point(term) or term.joint:
        return Trial(term, own, acts)
    arms = place((*key, "arms"), lambda: _arms(vectors_of(np, term, state)))
    return Trial(term, np.append(own, arms), np.append(acts, np.tile(TORQUE, (len(arms), 1)), 0), len(arms))


def _arms(forces: np.ndarray) -> np.ndarray:
    """(U, K, 3) forces -> (U, 3 K, 6) their torques for a lever arm of one metre along each axis of the sensor."""
    found: np.ndarray = torques(np, np.cross(np.eye(3), forces[:, :, None]))
    return found.reshape(len(forces), -1, 6)


def _products(white: np.ndarray, trial: Trial) -> np.ndarray:
    lanes, place = np.unique(trial.lanes, return_inverse=True)
    own = white[:, lanes]
    of_lanes = own @ own.transpose(0, 2, 1)
    both = trial.acts.T[:, :, None] & trial.acts.T[:, None]
    return np.where(both, of_lanes[:, place[:, None], place], 0).sum(0, dtype=float)


def rank(dictionary: Dictionary, prepared_fit: PreparedFit) -> list[Ranked]:
    """Every term of the grid in addition to a fit, best first."""
    pairs = zip(dictionary.trials, _gains(dictionary, prepared_fit), strict=True)
    return sorted((_ranked(trial, prepared) for trial, prepared in pairs), key=lambda ranked: -ranked.merit)


def _gains(dictionary: Dictionary, prepared_fit: PreparedFit) -> list[Gains]:
    """Gains of every trial's columns in addition to a fit, from one product of all lanes with the fit."""
    if not dictionary.trials:
        return []
    fit, white = prepared_fit.fit, dictionary.white
    own = channels_first(np.concatenate([fit.error[None], fit.columns.moving])).astype(np.float32)
    series = channels_first(fit.columns.series).astype(np.float32)
    of_moving, of_series = (white @ x.transpose(0, 2, 1) for x in (own, series))
    lanes, acts = (np.concatenate([getattr(trial, name) for trial in dictionary.trials]) for name in ("lanes", "acts"))
    by_moving = np.einsum("mk,kmf->mf", acts.astype(float), of_moving[:, lanes])
    by_series = (acts[:, None] * of_series[:, lanes].transpose(1, 2, 0)).reshape(len(lanes), -1)
    shared = np.concatenate([by_moving[:, 1:], by_series], 1)
    taken = prepared_fit.information.solve(shared.T).T
    pull = by_moving[:, 0] - taken @ prepared_fit.pull
    ends = np.cumsum([len(trial.lanes) for trial in dictionary.trials])[:-1]
    pieces = zip(dictionary.normals, *(np.split(x, ends) for x in (shared, taken, pull)), strict=True)
    return [Gains(normal - a @ b.T, c, b.T) for normal, a, b, c in pieces]


def merit_of(gain: float, numbers: int) -> float:
    """Merit in nats of a gain with this many free parameters, including times.

    Counting times matters: switching whenever a joint reverses mimics that joint's friction, which has two parameters.
    """
    return gain * (1 - SHARE_PER_NUMBER * numbers) - PENALTY_PER_PARAMETER * numbers


def times_of(term: Term) -> int:
    """Number of times at which a term is switched."""
    return np.size(term.parameters["time"]) if "time" in term.parameters else 0


def _ranked(trial: Trial, prepared: Gains) -> Ranked:
    term, count = trial.term, len(trial.lanes) - trial.arms
    numbers = len(free_names(term)) + times_of(term)
    if trial.arms:
        gain, point, coefficients = _with_point(prepared, count, trial.arms // 3)
        return Ranked(merit_of(gain, numbers + count + 3), _with(term, coefficients, point))
    rows = list(range(count))
    numbers += 3 * has_point(term)
    if count <= 3:
        return Ranked(merit_of(prepared.of(rows), numbers + count), _with(term, prepared.coefficients(rows)))
    gain, chosen = prepared.pursue(rows, MOST_NUMBERS, LEAST_ENTRY)
    chosen = sorted(chosen)
    best = _with(term, prepared.coefficients(chosen), used=tuple(chosen)) if chosen else term
    return Ranked(merit_of(gain, numbers + len(chosen)), best)


def _with(term: Term, coefficients: np.ndarray, point: np.ndarray | None = None, used: tuple[int, ...] = ()) -> Term:
    at = term.point if point is None else point
    return replace(term, used=used, point=at, coefficients=-coefficients)


def _with_point(prepared: Gains, count: int, forces: int) -> tuple[float, np.ndarray, np.ndarray]:
    """Gain, point (3,) m and coefficients (K,) of columns, the first of which are forces at one unknown point.

    The columns are followed by three torques for each of the forces.
    """
    size = count + 3 * forces
    normal, pull = prepared.normal + 1e-9 * np.trace(prepared.normal) * np.eye(size) / size, prepared.pull
    point, gain = np.zeros(3), 0.0
    coefficients = np.zeros(count)
    for _ in range(ROUNDS):
        joined = np.concatenate([np.eye(count), np.kron(np.eye(forces, count), point[:, None])])
        coefficients = -_solve(joined.T @ normal @ joined, joined.T @ pull)
        alone = np.concatenate([coefficients, np.zeros(3 * forces)])
        arms = np.concatenate([np.zeros((count, 3)), np.kron(coefficients[:forces, None], np.eye(3))])
        point = -_solve(arms.T @ normal @ arms, arms.T @ (pull + normal @ alone))
        numbers = alone + arms @ point
        gain = float(-pull @ numbers - numbers @ normal @ numbers / 2)
    return gain, np.clip(point, -1.0, 1.0), coefficients


def _solve(normal: np.ndarray, right: np.ndarray) -> np.ndarray:
    ridge = 1e-10 * max(float(np.trace(normal)), 1e-12)
    return np.linalg.solve(normal + ridge * np.eye(len(normal)), right)
