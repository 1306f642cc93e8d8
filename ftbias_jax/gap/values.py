"""Fitted coordinates and coefficients as parameters of the catalogue, with standard errors."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from ftbias_jax.gap import model
from ftbias_jax.gap.fit import Fit, covariance
from ftbias_jax.gap.hypotheses import SHAPE, Hypothesis
from ftbias_jax.gap.problem import Problem
from ftbias_jax.gap.types import Numbers
from ftbias_jax.screws import sensor_pose

Parameters = dict[str, Numbers]


def parameters(problem: Problem, fit: Fit, hypothesis: Hypothesis) -> tuple[Parameters, Parameters]:
    """Values and standard errors of one hypothesis of a fit, in the units of the catalogue."""
    stderr = np.sqrt(np.diag(covariance(problem, fit))) if fit.degrees else np.zeros(0)
    if hypothesis.shapes:
        return _of_series(problem, fit, hypothesis, stderr[len(fit.free) :])
    return _of_coordinates(problem, fit, hypothesis, dict(zip(fit.free, stderr, strict=False)))


def _of_coordinates(
    problem: Problem, fit: Fit, h: Hypothesis, stderr: dict[int, float]
) -> tuple[Parameters, Parameters]:
    spread = np.zeros(len(fit.z))
    spread[list(stderr)] = list(stderr.values())
    link = jnp.asarray(fit.link)
    values, offsets = model.to_values(problem.signals, jnp.asarray(fit.z), link)
    if h.effect == "encoder_offset":
        joint = int(h.detail[0])
        error = float(spread[h.free[0]] * 0.01)
        return {"joint": joint, "offset": float(offsets[joint - 1])}, {"joint": 0.0, "offset": error}
    shifted, _ = model.to_values(problem.signals, jnp.asarray(fit.z + spread), link)
    found: Parameters = {name: _plain(value) for name, value in values[h.effect].items()}
    errors: Parameters = {
        name: _plain(np.abs(np.asarray(shifted[h.effect][name]) - np.asarray(value)))
        for name, value in values[h.effect].items()
    }
    return found, errors


def _of_series(problem: Problem, fit: Fit, h: Hypothesis, stderr: np.ndarray) -> tuple[Parameters, Parameters]:
    before = sum(6 * len(other.shapes) for other in fit.hypotheses[: fit.hypotheses.index(h)])
    rows = slice(before, before + 6 * len(h.shapes))
    coefficients = fit.coefficients[rows].reshape(-1, 6)
    errors = stderr[rows].reshape(-1, 6)
    if h.effect == "contact":
        return _of_contact(problem, h, coefficients, errors)
    name = "per_kelvin" if h.effect == "temperature_drift" else "amplitude"
    found: Parameters = {name: _plain(coefficients[0])}
    spread: Parameters = {name: _plain(errors[0])}
    key = {"bias_jump": "time", "warmup": "tau"}.get(h.effect)
    if key:
        found[key], spread[key] = float(h.detail[0]), 0.02 if key == "time" else 0.2 * float(h.detail[0])
    return found, spread


def _of_contact(
    problem: Problem, h: Hypothesis, coefficients: np.ndarray, errors: np.ndarray
) -> tuple[Parameters, Parameters]:
    """Events with the force at their peak, base frame: the tool is pushed by minus the change of the reading."""
    events = np.reshape(h.detail, (-1, 2))
    t = np.asarray(problem.signals.t)
    forces: list[Numbers] = []
    spreads: list[Numbers] = []
    for (start, end), change, error in zip(
        events, coefficients.reshape(len(events), SHAPE, 6), errors.reshape(len(events), SHAPE, 6), strict=True
    ):
        peak = int((change[:, :3] ** 2).sum(1).argmax())
        middle = start + (peak + 1) * (end - start) / (SHAPE + 1)
        R, _ = sensor_pose(
            problem.signals.model.arm, problem.signals.q[int(np.searchsorted(t, middle).clip(0, len(t) - 1))]
        )
        forces.append((-np.asarray(R) @ change[peak, :3]).tolist())
        spreads.append((np.abs(np.asarray(R)) @ error[peak, :3]).tolist())
    starts, ends = events.T.tolist()
    width: Numbers = [0.1] * len(starts)
    return {"start": starts, "end": ends, "force": forces}, {"start": width, "end": width, "force": spreads}


def _plain(value: np.ndarray) -> Numbers:
    plain: Numbers = np.asarray(value, float).tolist()
    return plain
