"""Several logs of one robot side by side: which has the gap, and whether they agree on its cause."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ftbias_jax.diagnosis.evidence.cross_validation import HeldOut, excess_by_channel
from ftbias_jax.diagnosis.evidence.estimates import parameters
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.design_matrix import Columns, change, step_and_gain
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.diagnosis.result import LogGap


def compare(
    problem: Problem, names: Sequence[str], accepted: Fit, before: HeldOut, after: HeldOut
) -> tuple[LogGap, ...]:
    """What each log says by itself, held out without and with the causes fitted to all; nothing for a single log."""
    if len(problem.parts) < 2:
        return ()
    found = []
    for log, name in enumerate(names):
        own = problem.log == log
        first, last = (_sigmas(problem, held.error, own) for held in (before, after))
        alone, gain = _alone(accepted, own)
        values = {h.effect: parameters(problem, alone, h) for h in accepted.hypotheses}
        gain_per_second = gain / max(problem.durations[log], 1e-9)
        said = {effect: value for effect, (value, _) in values.items()}
        stderr = {effect: error for effect, (_, error) in values.items()}
        found.append(LogGap(name, first, last, gain_per_second, said, stderr))
    return tuple(found)


def _sigmas(problem: Problem, error: np.ndarray, own: np.ndarray) -> float:
    """Rms of a log's innovations in noise sigmas."""
    few = problem._replace(variance=problem.variance[own], samples=problem.samples[own])
    return float(np.sqrt(1 + max(float(excess_by_channel(few, error[own]).mean()), 0.0)))


def _alone(accepted: Fit, own: np.ndarray) -> tuple[Fit, float]:
    """The causes fitted to one log's bins (U,), to first order around the fit to all, and the nats this gains there."""
    columns, error = Columns(*(x * own[:, None] for x in accepted.columns)), accepted.error * own[:, None]
    step, gain = step_and_gain(columns, error)
    z, moving = accepted.z.copy(), len(accepted.free)
    z[list(accepted.free)] += step[:moving]
    coefficients = accepted.coefficients + step[moving:]
    error = error + change(columns, step)
    return accepted._replace(z=z, coefficients=coefficients, columns=columns, error=error), gain
