"""Whether a jump is one of the bias: it takes no time, and the new level stays whatever the pose is."""

from __future__ import annotations

import numpy as np

from ftbias_jax.diagnosis.evidence.estimates import rows_of
from ftbias_jax.diagnosis.hypothesis import Change, Hypothesis
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.design_matrix import change
from ftbias_jax.diagnosis.regression.evaluate import readings, sensor_axes, whitened
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.diagnosis.regression.score_test import gains, stand
from ftbias_jax.diagnosis.thresholds import CLOSE, LONGEST_JUMP
from ftbias_jax.model.effects.terms.columns import forces_at, torques


def doubt(problem: Problem, found: Fit, h: Hypothesis) -> str:
    """Why a jump of the bias may be something else."""
    assert isinstance(h.detail, Change)
    if h.detail.ramp > LONGEST_JUMP:
        return f"; or something slower that is not in the catalogue, because it took {h.detail.ramp:.2g} s"
    rest, series = without(found, h)
    prepared_fit = stand(rest)

    def nats_of(columns: np.ndarray) -> float:
        return gains(prepared_fit, columns).of(list(range(len(columns))))

    level = nats_of(series[0] * np.eye(6)[:, None])
    for words, columns in with_the_pose(problem, found, h.shapes[0]).items():
        if nats_of(whitened(problem, columns)) > CLOSE * level:
            return f"; or {words}: the wrist turns too little after the jump to exclude it"
    return ""


def without(found: Fit, h: Hypothesis) -> tuple[Fit, np.ndarray]:
    """A fit without the series of one hypothesis, all else as it was; and these series (E, U, 6)."""
    numbers = rows_of(found, h)
    own = slice(numbers.start // 6, numbers.stop // 6)
    alone = found.columns._replace(moving=found.columns.moving[:0], series=found.columns.series[own])
    rest = found.columns._replace(series=np.delete(found.columns.series, own, 0))
    return found._replace(error=found.error - change(alone, found.coefficients[numbers]), columns=rest), alone.series


def with_the_pose(problem: Problem, found: Fit, series: np.ndarray) -> dict[str, np.ndarray]:
    """What sets in as a series (U,) does and, unlike a bias, follows the pose: words -> columns (K, U, 6) N, Nm."""
    axes = sensor_axes(problem).transpose(1, 0, 2)  # (3, U, 3), each axis of the base in the sensor's coordinates
    down = np.tensordot(np.asarray(problem.parts[0].signals.model.gravity), axes, 1)
    arms = np.cross(np.eye(3)[:, None], down)
    steady, weight = (forces_at(np, np.zeros(3), vectors) for vectors in (axes, down[None]))
    made = {
        "a force that set in then and keeps its direction in the room": [steady, torques(np, axes)],
        "a load that was taken up or lost then": [weight, torques(np, arms)],
        "gauges whose gain changed then": [readings(problem, found.z[None])[0] * np.eye(6)[:, None]],
    }
    return {words: series[:, None] * np.concatenate(pieces) for words, pieces in made.items()}
