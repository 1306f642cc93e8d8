"""The model and the whitening on all bins of all logs, in pieces of fixed size so that few programs are compiled."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache, partial

import jax
import jax.numpy as jnp
import numpy as np
from jax.stages import Lowered

from ftbias_jax.diagnosis.problem import Part, Problem
from ftbias_jax.diagnosis.regression import chain_model
from ftbias_jax.filtering.likelihood import WrenchProblem, whiten
from ftbias_jax.model.effects.catalogue import CATALOGUE
from ftbias_jax.model.effects.table import Catalogue
from ftbias_jax.model.effects.types import Signals, Values
from ftbias_jax.model.kinematics.arm_batch import ArmMotion
from ftbias_jax.types import Array

LANES = 4
"""Readings or derivatives that one call works out."""
WHITE_LANES = (8, 32)
"""Series that one call whitens, if there are few and if there are many."""


def lower_programs(
    signals: Signals, wrench: WrenchProblem, known: Values, catalogue: Catalogue = CATALOGUE
) -> Iterator[Lowered]:
    """The programs that the functions below call, ready to be compiled, the longest first.

    Args:
        signals: of one log; of series, shapes are enough.
        wrench: of one log; of series, shapes are enough.
        known: effects that the setup knows of.
        catalogue: that has the effects.
    """
    bins, n = signals.q.shape

    def of(*shape: int) -> jax.ShapeDtypeStruct:
        return jax.ShapeDtypeStruct(shape, signals.q.dtype)

    size = chain_model.size(n, catalogue)
    one, many = of(size), of(LANES, size)
    moving = jax.eval_shape(partial(chain_model.motion, catalogue=catalogue), signals, known, one)
    yield chain_model.slopes.lower(signals, known, moving, one, many, (moving,) * LANES, catalogue)
    yield chain_model.motion_slopes.lower(signals, known, one, catalogue)
    yield chain_model.readings.lower(signals, known, (moving,) * LANES, many, catalogue)
    yield chain_model.motion.lower(signals, known, one, catalogue)
    yield chain_model.to_values.lower(signals, one, catalogue)
    for lanes in WHITE_LANES:
        yield whiten.lower(wrench, of(lanes, bins, 6))


def readings(problem: Problem, z: np.ndarray) -> np.ndarray:
    """(C, P) coordinates -> (C, U, 6) N, Nm: noise-free readings."""
    joints = chain_model.of_joints(problem.joints, problem.catalogue)

    def of_log(part: Part) -> np.ndarray:
        @lru_cache(LANES)
        def motion(*offsets: float) -> ArmMotion:
            at = np.zeros(z.shape[1])
            at[joints] = offsets
            moving: ArmMotion = chain_model.motion(part.signals, problem.known, at, problem.catalogue)
            return moving

        def some(z: np.ndarray) -> Array:
            moving = tuple(motion(*offsets) for offsets in z[:, joints])
            return chain_model.readings(part.signals, problem.known, moving, z, problem.catalogue)

        return in_pieces(some, LANES, z)[:, : part.used]

    return np.concatenate([of_log(part) for part in problem.parts], axis=1)


def slopes(problem: Problem, z: np.ndarray, places: Sequence[int]) -> np.ndarray:
    """(F, U, 6) N, Nm: derivatives of the reading at z (P,) by the coordinates at these places."""
    joints = chain_model.of_joints(problem.joints, problem.catalogue)

    def of_log(part: Part) -> np.ndarray:
        signals, known, catalogue = part.signals, problem.known, problem.catalogue
        moving = chain_model.motion(signals, known, z, catalogue)
        still = jax.tree.map(lambda x: jnp.asarray(np.zeros(x.shape, x.dtype)), moving)
        by_joint = chain_model.motion_slopes(signals, known, z, catalogue) if np.isin(places, joints).any() else ()
        change = dict(zip(joints, by_joint, strict=False))

        def some(places: np.ndarray) -> Array:
            changes = tuple(change.get(place, still) for place in places)
            directions = np.eye(len(z))[places]
            return chain_model.slopes(signals, known, moving, z, directions, changes, catalogue)

        return in_pieces(some, LANES, np.array(places))[:, : part.used]

    return np.concatenate([of_log(part) for part in problem.parts], axis=1)


def believed_motions(problem: Problem) -> list[ArmMotion]:
    """How the arm moves in each log, if the joints are where the setup believes; B samples, with the padding."""
    z = np.zeros(chain_model.size(problem.joints, problem.catalogue))
    return [chain_model.motion(part.signals, problem.known, z, problem.catalogue) for part in problem.parts]


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
        found.append(np.asarray(function(*piece))[: count - first])
    return np.concatenate(found)
