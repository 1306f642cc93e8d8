"""The grid's terms whitened once, and what each of them gains beside a fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.evaluate import whitened_single
from ftbias_jax.diagnosis.regression.score_test import Gains, Standing, gains
from ftbias_jax.diagnosis.terms.grid import free_names
from ftbias_jax.diagnosis.thresholds import LEAST_ENTRY, MOST_NUMBERS, NATS_PER_DEGREE, SHARE_PER_NUMBER
from ftbias_jax.model.effects.terms.columns import columns, has_point
from ftbias_jax.model.effects.terms.types import State, Term

ROUNDS = 6
"""Of solving for the coefficients and the point of a force in turns."""
AT_ONE_POINT = (
    ("position", "attraction"),
    ("position", "quadratic"),
    ("time", "step"),
    ("time", "wave"),
    ("frequency", "line"),
)
"""Forms with many starting points: at first their forces act at the tool's centre of mass."""
FORCE, TORQUE, ALL = slice(0, 3), slice(3, 6), slice(0, 6)


class Column(NamedTuple):
    """Part of a whitened lane."""

    lane: int
    channels: slice


class Trial(NamedTuple):
    """One term of the grid."""

    term: Term
    columns: tuple[Column, ...]
    arms: tuple[Column, ...]
    """Torques of the force of every column about the three axes of the sensor, where its point is free; three each."""


class Ranked(NamedTuple):
    """A term with what it gains."""

    merit: float
    """nats after the penalties."""
    gain: float
    """nats."""
    term: Term


class Library(NamedTuple):
    """Whitened lanes in single precision."""

    trials: list[Trial]
    white: np.ndarray
    """(L, U, 6)."""


def make_library(problem: Problem, state: State, terms: list[Term]) -> Library:
    """Whiten what the terms need, several columns in one lane where their channels differ."""
    lanes: list[np.ndarray] = []
    places: dict[tuple[object, ...], int] = {}

    def place(key: tuple[object, ...], series: np.ndarray) -> int:
        """The first lane of series (U, L, 6), which may be there already."""
        if key not in places:
            places[key] = len(lanes)
            lanes.extend(series.transpose(1, 0, 2))
        return places[key]

    return Library([_trial(term, columns(np, term, state), place) for term in terms], whitened_single(problem, lanes))


def _trial(term: Term, whole: np.ndarray, place: Callable[[tuple[object, ...], np.ndarray], int]) -> Trial:
    """A term whose columns (U, K, 6) have found their lanes."""
    K, unique = whole.shape[1], (id(term),)
    key = (term.drive, term.form, term.frame, term.joint, *((n, float(x)) for n, x in term.parameters.items()))
    if term.frame == "sensor" and term.acts_as == "wrench":  # a channel each
        first = place(key, whole.reshape(len(whole), -1, 6, 6).sum(3))
        own = tuple(Column(first + i, slice(k, k + 1)) for i in range(K // 6) for k in range(6))
        return Trial(term, own, ())
    if term.acts_as == "force" and (term.drive, term.form) in AT_ONE_POINT:
        first = place(unique, whole)
        return Trial(term, tuple(Column(first + k, ALL) for k in range(K)), ())
    forces = K // 2 if term.acts_as == "wrench" else 0 if term.acts_as == "torque" else K
    vectors = whole[:, :forces, FORCE] if forces else whole[:, :, TORQUE]
    first = place(key, np.concatenate([vectors, vectors], 2))
    own = tuple(Column(first + k, FORCE if k < forces else TORQUE) for k in range(vectors.shape[1]))
    own += tuple(Column(first + k, TORQUE) for k in range(K - len(own)))
    if not has_point(term) or term.joint:
        return Trial(term, own, ())
    start = place((*key, "arms"), _arms(vectors))
    return Trial(term, own, tuple(Column(start + i, TORQUE) for i in range(3 * vectors.shape[1])))


def _arms(forces: np.ndarray) -> np.ndarray:
    """(U, K, 3) forces -> (U, 3 K, 6) their torques about a metre along each axis of the sensor."""
    found = np.zeros((*forces.shape[:2], 3, 6))
    for axis in range(3):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        found[:, :, axis, 3 + first], found[:, :, axis, 3 + second] = -forces[:, :, second], forces[:, :, first]
    return found.reshape(len(forces), -1, 6)


def rank(library: Library, standing: Standing) -> list[Ranked]:
    """Every term of the grid beside a fit, best first."""
    found = [_judge(library, standing, trial) for trial in library.trials]
    return sorted(found, key=lambda ranked: -ranked.merit)


def merit_of(gain: float, numbers: int) -> float:
    """nats that count of a gain by so many free numbers."""
    return gain * (1 - SHARE_PER_NUMBER * numbers) - NATS_PER_DEGREE * numbers


def _judge(library: Library, standing: Standing, trial: Trial) -> Ranked:
    prepared = gains(standing, _columns(library, (*trial.columns, *trial.arms)))
    term, count = trial.term, len(trial.columns)
    numbers = len(free_names(term))
    if trial.arms:
        gain, point, coefficients = _with_point(prepared, count, len(trial.arms) // 3)
        best = _with(term, coefficients, point)
        return Ranked(merit_of(gain, numbers + count + 3), gain, best)
    rows = list(range(count))
    numbers += 3 * has_point(term)
    if count <= 3:
        gain = prepared.of(rows)
        return Ranked(merit_of(gain, numbers + count), gain, _with(term, prepared.coefficients(rows)))
    gain, chosen = prepared.pursue(rows, MOST_NUMBERS, LEAST_ENTRY)
    chosen = sorted(chosen)
    best = _with(term, prepared.coefficients(chosen), used=tuple(chosen)) if chosen else term
    return Ranked(merit_of(gain, numbers + len(chosen)), gain, best)


def _with(term: Term, coefficients: np.ndarray, point: np.ndarray | None = None, used: tuple[int, ...] = ()) -> Term:
    at = term.point if point is None else point
    return replace(term, used=used, point=at, coefficients=-coefficients)


def _columns(library: Library, wanted: tuple[Column, ...]) -> np.ndarray:
    """(M, U, 6)."""
    found = np.zeros((len(wanted), *library.white.shape[1:]), np.float32)
    for row, (lane, channels) in zip(found, wanted, strict=True):
        row[:, channels] = library.white[lane][:, channels]
    return found


def _with_point(prepared: Gains, count: int, forces: int) -> tuple[float, np.ndarray, np.ndarray]:
    """Gain, point (3,) m and coefficients (K,) of forces that act at one unknown point.

    Args:
        prepared: of K columns, then of three torques for each of the forces.
        count: K.
        forces: how many of the columns are forces, the first ones.
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
    solved: np.ndarray = np.linalg.solve(normal + ridge * np.eye(len(normal)), right)
    return solved
