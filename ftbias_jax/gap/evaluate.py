"""The model and the whitening on all bins of all logs, in pieces of fixed size so that few programs are compiled."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax.stages import Lowered

from ftbias_jax.effects.types import Signals, Values
from ftbias_jax.gap import model
from ftbias_jax.gap.problem import Part, Problem
from ftbias_jax.likelihood import WrenchProblem, whiten
from ftbias_jax.types import Array

LANES = 4
"""Readings or derivatives that one call works out."""
WHITE_LANES = (8, 32)
"""Series that one call whitens, if there are few and if there are many."""


def lower_programs(signals: Signals, wrench: WrenchProblem, known: Values) -> Iterator[Lowered]:
    """The programs that the functions below call, ready to be compiled, the longest first.

    Args:
        signals, wrench: of one log; of series, shapes are enough. known: effects that the setup knows of.
    """
    bins, n = signals.q.shape

    def of(*shape: int) -> jax.ShapeDtypeStruct:
        return jax.ShapeDtypeStruct(shape, signals.q.dtype)

    one, many = of(model.size(n)), of(LANES, model.size(n))
    for derivative in (model.slopes, model.slopes_at_pose):
        yield derivative.lower(signals, known, one, of(), many)
    for reading in (model.predict_many, model.predict_at_pose):
        yield reading.lower(signals, known, many, of(LANES))
    for lanes in WHITE_LANES:
        yield whiten.lower(wrench, of(lanes, bins, 6))


def readings(problem: Problem, z: np.ndarray, link: np.ndarray) -> np.ndarray:
    """(C, P) coordinates, (C,) links -> (C, U, 6) N, Nm: noise-free readings."""

    offsets = z[:, model.coordinates(problem.joints, "encoder_offset")]
    program = model.predict_at_pose if (offsets == offsets[0]).all() else model.predict_many

    def of_log(part: Part) -> np.ndarray:
        def some(z: Array, link: Array) -> Array:
            return program(part.signals, problem.known, z, link)

        return in_pieces(some, LANES, z, link)[:, : part.used]

    return np.concatenate([of_log(part) for part in problem.parts], axis=1)


def slopes(problem: Problem, z: np.ndarray, link: float, places: Sequence[int]) -> np.ndarray:
    """(F, U, 6) N, Nm: derivatives of the reading at z (P,) by the coordinates at these places."""
    place, moving = np.array(places), np.isin(places, model.coordinates(problem.joints, "encoder_offset"))
    found = np.empty((len(place), len(problem.t), 6))
    for program, some in ((model.slopes, moving), (model.slopes_at_pose, ~moving)):
        if some.any():
            found[some] = _slopes(problem, z, link, program, np.eye(len(z))[place[some]])
    return found


def _slopes(
    problem: Problem, z: np.ndarray, link: float, program: Callable[..., Array], directions: np.ndarray
) -> np.ndarray:
    """(F, P) directions -> (F, U, 6)."""

    def of_log(part: Part) -> np.ndarray:
        def some(directions: Array) -> Array:
            return program(part.signals, problem.known, jnp.asarray(z), jnp.asarray(link, z.dtype), directions)

        return in_pieces(some, LANES, directions)[:, : part.used]

    return np.concatenate([of_log(part) for part in problem.parts], axis=1)


def whitened(problem: Problem, columns: np.ndarray) -> np.ndarray:
    """(C, U, 6) N, Nm -> the same as innovations of each log's bias filter, in standard deviations."""
    ends = np.cumsum([part.used for part in problem.parts])
    lanes = next((lanes for lanes in WHITE_LANES if lanes >= len(columns)), WHITE_LANES[-1])

    def of_log(part: Part, end: int) -> np.ndarray:
        room = part.signals.t.shape[0] - part.used
        own = np.pad(columns[:, end - part.used : end], ((0, 0), (0, room), (0, 0)))
        return in_pieces(lambda some: whiten(part.wrench, some), lanes, own)[:, : part.used]

    return np.concatenate([of_log(part, int(end)) for part, end in zip(problem.parts, ends, strict=True)], axis=1)


def whitened_series(problem: Problem, shapes: Sequence[np.ndarray]) -> np.ndarray:
    """(U,) series -> (E, U, 6): each of them the same in every channel, whitened."""
    if not shapes:
        return np.zeros((0, len(problem.t), 6))
    return whitened(problem, np.repeat(np.stack(shapes)[:, :, None], 6, 2))


def measured(problem: Problem) -> np.ndarray:
    """(U, 6) N, Nm: mean readings of the bins."""
    return np.concatenate([np.asarray(part.wrench.wrench)[: part.used] for part in problem.parts])


def in_pieces(function: Callable[..., Array], lanes: int, *arrays: np.ndarray) -> np.ndarray:
    """A function of (lanes, ...) arrays on (C, ...) arrays, C > 0; the last piece is filled up with repetitions."""
    count = len(arrays[0])
    found = []
    for first in range(0, count, lanes):
        piece = (np.resize(array[first : first + lanes], (lanes, *array.shape[1:])) for array in arrays)
        found.append(np.asarray(function(*(jnp.asarray(array) for array in piece)))[: count - first])
    return np.concatenate(found)
