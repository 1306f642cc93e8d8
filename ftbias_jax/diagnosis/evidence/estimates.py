"""Fitted coordinates and coefficients as parameters of the catalogue, with standard errors."""

from __future__ import annotations

import numpy as np

from ftbias_jax.diagnosis.hypothesis import Hypothesis, hats_of, slope_in_time
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.proposals.crosstalk_posterior import whole_matrix
from ftbias_jax.diagnosis.regression import chain_model
from ftbias_jax.diagnosis.regression.evaluate import believed_motions, whitened
from ftbias_jax.diagnosis.regression.fit import Fit, covariance
from ftbias_jax.diagnosis.result import Numbers

Parameters = dict[str, Numbers]

FORM_ERROR = 0.02
"""Share of what a parameter departs from neutral that a real effect's form may put into it: it is never quite the
catalogue's, and no scatter of the data shows that."""
FORM_ERRORS = {"low_pass": 0.15, "warmup": 0.12, "temperature_drift": 0.1, "bias_jump": 0.05}
"""The same of effects whose form is known less: filters of another order or a moving average with the same delay have
other cutoffs, a second, longer time constant passes for drift, gauges are not linear in temperature, a jump settles."""
TIME_CONSTANT = {"warmup": "tau", "temperature_drift": "lag"}
"""Effects of a slow series, and the name of its time constant."""
SHAPE_ERROR = 0.15
"""Share of a contact's peak that its few hat functions may miss."""
TIME_STDERR = 0.02
"""s; a jump is somewhere between two bins, and the likelihood is not smooth in its time."""
RAMP_STDERR = 0.25
"""Share of a jump's length within which it begins: few lengths are tried."""
START_STDERR, FADING = 0.1, 0.1
"""s of a contact's start and end, and what its end has more, as a share of its length: it may fade."""


def parameters(problem: Problem, fit: Fit, hypothesis: Hypothesis) -> tuple[Parameters, Parameters]:
    """Values and standard errors of one hypothesis of a fit, in the units of the catalogue."""
    if hypothesis.effect == "crosstalk":
        z, whole, of_entries = whole_matrix(problem, fit, hypothesis)
        return _of_coordinates(problem, fit._replace(z=z), whole, of_entries)
    slow = [h for h in fit.hypotheses if h.effect in TIME_CONSTANT]
    further = np.concatenate([fit.columns.moving[:0], *(_by_time_constant(problem, fit, h) for h in slow)])
    try:
        spread = covariance(problem, fit, further)
    except np.linalg.LinAlgError:  # of columns that are no numbers, or all the same: no standard error is known
        spread = np.full((len(fit.free) + len(further) + len(fit.coefficients),) * 2, np.nan)
    if hypothesis.shapes:
        _, of_times, of_series = np.split(np.sqrt(np.diag(spread)), np.cumsum([len(fit.free), len(slow)]))
        of_time = next((float(stderr) for h, stderr in zip(slow, of_times, strict=True) if h is hypothesis), 0.0)
        return _of_series(problem, fit, hypothesis, of_series, of_time)
    own = [fit.free.index(i) for i in hypothesis.free]
    return _of_coordinates(problem, fit, hypothesis, spread[np.ix_(own, own)])


def _by_time_constant(problem: Problem, fit: Fit, h: Hypothesis) -> np.ndarray:
    """(1, U, 6) whitened derivative of the reading by the time constant of a slow series."""
    slope = slope_in_time(problem, h)[:, None] * fit.coefficients[rows_of(fit, h)]
    return whitened(problem, slope[None])


def rows_of(fit: Fit, h: Hypothesis) -> slice:
    """Where a hypothesis has its coefficients."""
    place = next(i for i, other in enumerate(fit.hypotheses) if other is h)
    before = sum(6 * len(other.shapes) for other in fit.hypotheses[:place])
    return slice(before, before + 6 * len(h.shapes))


def _of_coordinates(problem: Problem, fit: Fit, h: Hypothesis, spread: np.ndarray) -> tuple[Parameters, Parameters]:
    """Standard errors from a step of one standard deviation along every principal axis of the covariance (F, F).

    All NaN if the covariance is no number. A direction that changes no parameter, such as the size of gravity, adds
    nothing. A step towards neutral adds the error of the form.
    """
    link, signals = np.asarray(fit.link), problem.parts[0].signals
    unknown = not np.isfinite(spread).all()
    variance, axes = (np.full(len(spread), np.nan), spread) if unknown else np.linalg.eigh(spread)
    z = np.repeat(fit.z[None], len(variance) + 2, 0)
    z[1:-1, list(h.free)] += np.sqrt(np.maximum(variance, 0))[:, None] * axes.T
    z[-1, list(h.free)] *= 1 - FORM_ERRORS.get(h.effect, FORM_ERROR)
    made = [chain_model.to_values(signals, row, link, problem.catalogue) for row in z]
    values, offsets = zip(*made, strict=True)
    if h.effect == "encoder_offset":
        joint = int(h.detail[0])
        at = np.array([float(offset[joint - 1]) for offset in offsets])
        return {"joint": joint, "offset": float(at[0])}, {
            "joint": 0.0,
            "offset": float(np.sqrt(((at[1:] - at[0]) ** 2).sum())),
        }
    found: Parameters = {}
    errors: Parameters = {}
    for name in values[0][h.effect]:
        at = np.stack([np.asarray(value[h.effect][name], float) for value in values])
        found[name], errors[name] = _plain(at[0]), _plain(np.sqrt(((at[1:] - at[0]) ** 2).sum(0)))
    return found, errors


def _of_series(
    problem: Problem, fit: Fit, h: Hypothesis, stderr: np.ndarray, stderr_of_time: float
) -> tuple[Parameters, Parameters]:
    rows = rows_of(fit, h)
    coefficients = fit.coefficients[rows].reshape(-1, 6)
    errors = np.hypot(stderr[rows].reshape(-1, 6), FORM_ERRORS.get(h.effect, FORM_ERROR) * coefficients)
    if h.effect == "contact":
        return _of_contact(problem, h, coefficients, errors)
    name = "per_kelvin" if h.effect == "temperature_drift" else "amplitude"
    found: Parameters = {name: _plain(coefficients[0])}
    spread: Parameters = {name: _plain(errors[0])}
    if h.effect == "bias_jump":
        found["time"], _, found["ramp"] = h.detail
        spread["time"] = float(np.hypot(TIME_STDERR, RAMP_STDERR * h.detail[2]))
        spread["ramp"] = 2 * RAMP_STDERR * h.detail[2]
    if h.effect in TIME_CONSTANT:
        found[TIME_CONSTANT[h.effect]], spread[TIME_CONSTANT[h.effect]] = h.detail[0], stderr_of_time
    return found, spread


def _of_contact(
    problem: Problem, h: Hypothesis, coefficients: np.ndarray, errors: np.ndarray
) -> tuple[Parameters, Parameters]:
    """Events with the force at their peak, base frame: the tool is pushed by minus the change of the reading."""
    events, hats = np.reshape(h.detail, (-1, 4)), hats_of(h)
    ends, motions = np.cumsum(hats)[:-1], believed_motions(problem)
    forces: list[Numbers] = []
    spreads: list[Numbers] = []
    for (log, start, end, _), change, error in zip(
        events, np.split(coefficients, ends), np.split(errors, ends), strict=True
    ):
        peak = int((change[:, :3] ** 2).sum(1).argmax())
        signals, used = problem.parts[int(log)].signals, problem.parts[int(log)].used
        middle = np.searchsorted(np.asarray(signals.t)[:used], start + peak * (end - start) / (len(change) - 1))
        R = np.asarray(motions[int(log)].sensor_rotation)[:, :, min(middle, used - 1)]
        forces.append((-R @ change[peak, :3]).tolist())
        blunt = SHAPE_ERROR * float(np.linalg.norm(change[peak, :3]))
        spreads.append(np.hypot(np.abs(R) @ error[peak, :3], blunt).tolist())
    found: Parameters = {"start": events[:, 1].tolist(), "end": events[:, 2].tolist(), "force": forces}
    start = np.full(len(events), START_STDERR)
    end = start + FADING * (events[:, 2] - events[:, 1])
    return found, {"start": start.tolist(), "end": end.tolist(), "force": spreads}


def _plain(value: np.ndarray) -> Numbers:
    plain: Numbers = np.asarray(value, float).tolist()
    return plain
