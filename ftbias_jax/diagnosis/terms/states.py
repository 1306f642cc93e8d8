"""What the drives see of the problem's logs."""

from __future__ import annotations

import numpy as np

from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.evaluate import readings
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.diagnosis.samples.bins import fill_up
from ftbias_jax.model.effects.terms.columns import state_of
from ftbias_jax.model.effects.terms.types import State

SHARED = ("gravity", "period")
"""Of all logs, not of a bin."""


def state_of_problem(problem: Problem, fit: Fit) -> State:
    """All logs end to end, (U, ...); the load is the reading that the fit predicts."""
    load = readings(problem, fit.z[None])[0]
    pieces, first = [], 0
    for part in problem.parts:
        own, size = slice(first, first + part.used), len(part.signals.t)
        first += part.used
        counts = fill_up(np.maximum(problem.samples[own].max(1), 1.0), size, 1.0)
        period = float(np.median(np.diff(np.asarray(part.signals.t)[: part.used])) / np.median(counts[: part.used]))
        whole = state_of(np, part.signals, fill_up(load[own], size, 0.0), part.nominal, counts, period)
        pieces.append(State(*(x if k in SHARED else x[: part.used] for k, x in whole._asdict().items())))
    pairs = zip(State._fields, zip(*pieces, strict=True), strict=True)
    return State(*(of_parts[0] if name in SHARED else np.concatenate(of_parts) for name, of_parts in pairs))
