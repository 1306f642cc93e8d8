"""Gauges that are not linear: over the loads of one log, their curve may look like another gain."""

import numpy as np

from ftbias_jax.diagnosis.hypothesis import Hypothesis
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.evaluate import whitened, with_and_without
from ftbias_jax.diagnosis.regression.fit import Fit, base, fit
from ftbias_jax.diagnosis.regression.score_test import gains, prepare_fit
from ftbias_jax.diagnosis.thresholds import LEAST_DIFFERENCE


def doubt(problem: Problem, found: Fit, h: Hypothesis) -> str:
    """Why the gains of a fit may be a curve: in place of them, the squares of the loads explain the log as well."""
    rest = found.beside(h)
    prepared = prepare_fit(fit(problem, rest, found) if rest else base(problem))
    with_it, load = with_and_without(problem, found.z, h.free)
    change = with_it - load
    moved = np.flatnonzero(np.abs(change).max(0))

    def nats_of(series: np.ndarray) -> float:
        columns = whitened(problem, series * np.eye(6)[moved][:, None])
        return gains(prepared, columns).of(list(range(len(moved))))

    if nats_of(change * load) < nats_of(change) - LEAST_DIFFERENCE:
        return ""
    return "; or gauges that are not linear: the square of the load explains the log as well"
