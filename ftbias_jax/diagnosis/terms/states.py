"""What the drives see of the problem's logs."""

from __future__ import annotations

import numpy as np

from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.evaluate import readings
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.model.effects.terms.columns import state_of
from ftbias_jax.model.effects.terms.types import State

SHARED = ("gravity", "period")
"""Of all logs, not of a bin."""


def state_of_problem(problem: Problem, fit: Fit) -> State:
    """All logs end to end, (U, ...); the load is the reading that the fit predicts."""
    load = readings(problem, fit.z[None])[0]
    pieces, end = [], 0
    for part, motion in zip(problem.parts, [part.nominal for part in problem.parts], strict=True):
        used, signals = part.used, part.signals
        padded = np.zeros((len(signals.t), 6))
        padded[:used], end = load[end : end + used], end + used
        counts = np.ones(len(padded))
        counts[:used] = np.maximum(problem.samples[end - used : end].max(1), 1)
        period = float(np.median(np.diff(np.asarray(signals.t)[:used])) / np.median(counts[:used]))
        whole = state_of(np, signals, padded, motion, counts, period)
        pieces.append(whole._asdict() | {k: x[:used] for k, x in whole._asdict().items() if k not in SHARED})
    return State(
        **{k: pieces[0][k] if k in SHARED else np.concatenate([piece[k] for piece in pieces]) for k in State._fields}
    )


def tool_point(problem: Problem) -> np.ndarray:
    """(3,) m, sensor frame: the stated centre of mass."""
    theta = np.asarray(problem.parts[0].signals.model.theta)
    center: np.ndarray = theta[1:4] / theta[0]
    return center
