"""Readings of the model, their derivatives and the whitening on all bins of all logs."""

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np

from ftbias_jax.diagnosis.problem import Part, Problem
from ftbias_jax.diagnosis.regression import chain_model
from ftbias_jax.diagnosis.regression.whitening import Whitener
from ftbias_jax.model.kinematics.arm_batch import ArmMotion
from ftbias_jax.types import Array

STEP = 1e-6
"""Step of finite differences in typical departures: neither curvature nor rounding matters, and unlike derivatives in
forward mode they need no program of their own, which would take longest of all to compile."""
LANES = 64
"""Number of columns that are whitened together: the products of more do not fit into the processor's cache."""
MOTIONS = 8
"""Number of arm motions that are cached while readings are computed."""


def readings(problem: Problem, z: np.ndarray) -> np.ndarray:
    """(C, P) coordinates -> (C, U, 6) N, Nm: noise-free readings."""
    joints = problem.layout.of_joints

    def of_log(part: Part) -> np.ndarray:
        @lru_cache(MOTIONS)
        def motion(*offsets: float) -> ArmMotion:
            if not any(offsets):
                return part.nominal
            at = np.zeros(z.shape[1])
            at[joints] = offsets
            return chain_model.motion(part.signals, problem.known, at, catalogue=problem.catalogue)

        arguments = part.signals, problem.known
        reading = chain_model.reading.prepare(*arguments, part.nominal, z[0], catalogue=problem.catalogue)
        found = [reading(*arguments, motion(*row[joints]), row) for row in z]
        return np.stack([np.asarray(one)[: part.used] for one in found])

    return np.concatenate([of_log(part) for part in problem.parts], axis=1)


def with_and_without(problem: Problem, z: np.ndarray, free: Sequence[int]) -> np.ndarray:
    """(2, U, 6) N, Nm: readings at z (P,), and with the coordinates in ``free`` set to neutral."""
    both = np.stack([z, z])
    both[1, list(free)] = 0
    return readings(problem, both)


def slopes(problem: Problem, z: np.ndarray, places: Sequence[int]) -> np.ndarray:
    """(F, U, 6) N, Nm: derivatives of the reading at z (P,) with respect to these coordinates, within their bounds."""
    at, row = np.array(places), np.arange(len(places))
    most = problem.layout.most
    moved = np.repeat(z[None], len(at) + 1, 0)
    moved[row, at] += np.where(z[at] + STEP <= most[at], STEP, -STEP)
    *made, here = readings(problem, moved)
    steps = moved[row, at] - z[at]
    return (np.stack(made) - here) / steps[:, None, None]


def whitened(problem: Problem, columns: np.ndarray) -> np.ndarray:
    """Whiten columns (C, U, 6) N, Nm into innovations of each log's bias filter, in standard deviations.

    Columns (C, U, 1) are the same in every channel.
    """
    return _over_logs(problem, [part.whiten for part in problem.parts], columns)


def whitened_single(problem: Problem, columns: Sequence[np.ndarray]) -> np.ndarray:
    """Whiten C columns (U, 6) N, Nm, or (U, 1) if the same in every channel, in single precision."""
    filters = [part.whiten.single() for part in problem.parts]
    white = np.zeros((len(columns), len(problem.t), 6), np.float32)
    for first in range(0, len(columns), LANES):
        few = np.stack(columns[first : first + LANES], dtype=np.float32)
        white[first : first + LANES] = _over_logs(problem, filters, few)
    return white


def whiten_lanes(problem: Problem, lanes: np.ndarray) -> None:
    """Whiten columns (6, C, U), channels first, in place and in single precision."""
    filters = [part.whiten.single() for part in problem.parts]
    ends = np.cumsum([part.used for part in problem.parts])[:-1]
    for first in range(0, lanes.shape[1], LANES):
        for whiten, piece in zip(filters, np.split(lanes[:, first : first + LANES], ends, axis=2), strict=True):
            piece[:] = whiten.by_channel(piece)


def _over_logs(problem: Problem, filters: Sequence[Whitener], columns: np.ndarray) -> np.ndarray:
    pieces = np.split(columns, np.cumsum([part.used for part in problem.parts])[:-1], axis=1)
    white = [whiten(piece) for whiten, piece in zip(filters, pieces, strict=True)]
    return white[0] if len(white) == 1 else np.concatenate(white, axis=1)


def whitened_series(problem: Problem, shapes: Sequence[np.ndarray]) -> np.ndarray:
    """(E, U, 6) whitened series from E series (U,) that are the same in every channel."""
    if not shapes:
        return np.zeros((0, len(problem.t), 6))
    return whitened(problem, np.stack(shapes)[:, :, None])


def over_bins(problem: Problem, of: Callable[[Part], Array]) -> np.ndarray:
    """(U, ...): the arrays (B, ...) of all logs without their padding, concatenated."""
    return np.concatenate([np.asarray(of(part))[: part.used] for part in problem.parts])


def measured(problem: Problem) -> np.ndarray:
    """(U, 6) N, Nm: mean readings of the bins."""
    return over_bins(problem, lambda part: part.wrench.wrench)


def sensor_axes(problem: Problem) -> np.ndarray:
    """(U, 3, 3) rotation from the sensor to the base at the nominal joint positions."""
    return over_bins(problem, lambda part: np.moveaxis(np.asarray(part.nominal.sensor_rotation), 2, 0))
