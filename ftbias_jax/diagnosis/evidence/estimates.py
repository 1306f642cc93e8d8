"""Fitted coordinates and coefficients as parameters of the catalogue, with standard errors and their correlations."""

from collections.abc import Mapping, Sequence

import numpy as np

from ftbias_jax.diagnosis.evidence.forms import spread_by_other_forms
from ftbias_jax.diagnosis.hypothesis import Change, Hypothesis, Slow, moments, neutral_of
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.proposals.entries import entries_of, whole_matrix
from ftbias_jax.diagnosis.regression import chain_model
from ftbias_jax.diagnosis.regression.coordinates import strengths
from ftbias_jax.diagnosis.regression.evaluate import whitened
from ftbias_jax.diagnosis.regression.fit import Fit, covariance
from ftbias_jax.diagnosis.regression.series import shaped, slope_in_time
from ftbias_jax.diagnosis.result import Candidate, Numbers
from ftbias_jax.diagnosis.thresholds import SURE
from ftbias_jax.model.effects.fitting import ByJoint, Entries, Settling, Step, Touches
from ftbias_jax.model.effects.statements import Estimate, amount
from ftbias_jax.model.effects.types import Effect
from ftbias_jax.model.wrench.inertia import without_round_off

Parameters = dict[str, Numbers]

FORM_ERROR = 0.02
"""Model-form error of a parameter as a share of its departure from neutral: a real effect never has exactly the
catalogue's form, and the scatter of the data does not reveal that."""
SHAPE_ERROR = 0.15
"""Share of a contact's peak force that its few tent basis functions may miss."""
TIME_STDERR = 0.02
"""s, standard error of a jump's time: it lies between two bins, and the likelihood is not smooth in it."""
RAMP_STDERR = 0.25
"""Standard error of a jump's start as a share of its length, because few lengths are tried."""
START_STDERR, END_STDERR_SHARE = 0.1, 0.1
"""s, standard error of a contact's start and end; share of its length that its end has more, as it may fade."""


def parameters(
    problem: Problem, fit: Fit, hypothesis: Hypothesis, either: bool = False
) -> tuple[Parameters, Parameters]:
    """Values and standard errors of one hypothesis of a fit, in the units of the catalogue.

    With ``either``, the errors also cover other models: beside a matrix, the difference between a fit of few of its
    entries and of all; beside other effects, the change of the values if these have another form.
    """
    few = entries_of(problem, fit)
    if few is not None and not hypothesis.shapes:
        whole = whole_matrix(problem, fit, few)
        h = whole.matrix if hypothesis is few else hypothesis
        told, other = (whole.fit, fit) if whole.worth_its_parameters else (fit, whole.fit)
        values, errors = _of_coordinates(problem, told, h, whole.spread(h))
        if either and h is hypothesis:
            others, _ = _of_coordinates(problem, other, h, whole.spread(h))
            errors = {
                name: _plain(np.hypot(error, np.subtract(values[name], others[name]))) for name, error in errors.items()
            }
        return values, errors
    slow = [h for h in fit.hypotheses if isinstance(h.detail, Slow)]
    further = np.concatenate([fit.columns.moving[:0], *(_by_time_constant(problem, fit, h) for h in slow)])
    try:
        spread = covariance(problem, fit, further)
    except np.linalg.LinAlgError:  # columns are NaN or identical, so no standard error is known
        spread = np.full((len(fit.free) + len(further) + len(fit.coefficients),) * 2, np.nan)
    if hypothesis.shapes:
        _, of_times, of_series = np.split(np.sqrt(np.diag(spread)), np.cumsum([len(fit.free), len(slow)]))
        of_time = next((float(stderr) for h, stderr in zip(slow, of_times, strict=True) if h is hypothesis), 0.0)
        return _of_series(problem, fit, hypothesis, of_series, of_time)
    by_forms = spread_by_other_forms(problem, fit, hypothesis) if either else 0.0
    return _of_coordinates(problem, fit, hypothesis, fit.spread(hypothesis, spread) + by_forms)


def departs(problem: Problem, found: Fit, h: Hypothesis) -> bool:
    """Whether any strength of an effect certainly differs from its neutral value, which may be that of the setup."""
    effect, (values, stderr) = problem.catalogue[h.effect], parameters(problem, found, h)
    search = effect.fit.search
    switches = [effect.parameter(search.force)] if isinstance(search, Touches) else strengths(effect)
    off = [
        np.abs(values[one.name] - neutral_of(problem, effect, one.name)) <= SURE * np.asarray(stderr[one.name], float)
        for one in switches
    ]
    return not off or not all(map(np.all, off))


def form_error(problem: Problem, effect: str) -> float:
    """Model-form error of an effect's parameters as a share of their departure from neutral."""
    stated = problem.catalogue[effect].fit.form_error
    return FORM_ERROR if stated is None else stated


def _by_time_constant(problem: Problem, fit: Fit, h: Hypothesis) -> np.ndarray:
    """(1, U, 6) whitened derivative of the reading with respect to the time constant of a slow series."""
    slope = slope_in_time(problem, h)[:, None] * fit.coefficients[rows_of(fit, h)]
    return whitened(problem, slope[None])


def rows_of(fit: Fit, h: Hypothesis) -> slice:
    """Slice of the coefficients that belong to a hypothesis."""
    place = next(i for i, other in enumerate(fit.hypotheses) if other is h)
    before = sum(6 * len(other.shapes) for other in fit.hypotheses[:place])
    return slice(before, before + 6 * len(h.shapes))


def _of_coordinates(problem: Problem, fit: Fit, h: Hypothesis, spread: np.ndarray) -> tuple[Parameters, Parameters]:
    """Values, and standard errors from steps of one standard deviation along the principal axes of covariance (F, F).

    All errors are NaN if the covariance is not finite. A direction that changes no parameter, such as the magnitude of
    gravity, adds nothing. The direction along an axis with the larger change counts, because the other may end at a
    bound. A step towards neutral adds the model-form error.
    """
    signals = problem.parts[0].signals
    unknown = not np.isfinite(spread).all()
    variance, axes = (np.full(len(spread), np.nan), spread) if unknown else np.linalg.eigh(spread)
    step = np.sqrt(np.maximum(variance, 0))[:, None] * axes.T
    z = np.repeat(fit.z[None], 2 * len(step) + 2, 0)
    z[1:-1, list(h.free)] += np.concatenate([step, -step])
    z[-1, list(h.free)] *= 1 - form_error(problem, h.effect)
    told = chain_model.to_values.prepare(signals, fit.z, catalogue=problem.catalogue)
    values = [told(signals, row)[h.effect] for row in z]
    effect = problem.catalogue[h.effect]
    search, of_time = effect.fit.search, moments(problem, effect)
    found: Parameters = {}
    errors: Parameters = {}
    for name in values[0]:
        at = np.stack([np.asarray(value[name], float) for value in values])
        if isinstance(h.detail, int):
            at = at[:, h.detail - 1]
        off = np.abs(at[1:] - at[0])
        if name in of_time:  # a later point in time is no less certain
            off[-1] = TIME_STDERR
        elif effect.parameter(name).is_vector:  # the form error of a vector is not aligned with its axes
            off[-1] = np.linalg.norm(off[-1])
        either = np.maximum(*np.split(off[:-1], 2))
        found[name], errors[name] = _plain(at[0]), _plain(np.sqrt((either**2).sum(0) + off[-1] ** 2))
    if isinstance(h.detail, int) and isinstance(search, ByJoint):
        found[search.number] = h.detail
    return found, errors


def _of_series(
    problem: Problem, fit: Fit, h: Hypothesis, stderr: np.ndarray, stderr_of_time: float
) -> tuple[Parameters, Parameters]:
    rows = rows_of(fit, h)
    coefficients = fit.coefficients[rows].reshape(-1, 6)
    errors = np.hypot(stderr[rows].reshape(-1, 6), form_error(problem, h.effect) * coefficients)
    effect = problem.catalogue[h.effect]
    if isinstance(effect.fit.search, Touches):
        return _of_events(problem, h, effect.fit.search, coefficients, errors)
    (strength,) = strengths(effect)
    found: Parameters = {strength.name: _plain(coefficients[0])}
    spread: Parameters = {strength.name: _plain(errors[0])}
    match effect.fit.search, h.detail:
        case Step(time, ramp), Change(at, _, length):
            found |= {time: at, ramp: length}
            spread |= {time: float(np.hypot(TIME_STDERR, RAMP_STDERR * length)), ramp: 2 * RAMP_STDERR * length}
        case Settling(time), Slow(time_constant):
            found, spread = found | {time: time_constant}, spread | {time: stderr_of_time}
    return found, spread


def _of_events(
    problem: Problem, h: Hypothesis, search: Touches, coefficients: np.ndarray, errors: np.ndarray
) -> tuple[Parameters, Parameters]:
    """Events with their peak force in the base frame: the tool is pushed by minus the change of the reading."""
    events = shaped(h)
    ends = np.cumsum([one.series for one in events])[:-1]
    forces: list[Numbers] = []
    spreads: list[Numbers] = []
    for (event, _), change, error in zip(events, np.split(coefficients, ends), np.split(errors, ends), strict=True):
        part, peak = problem.parts[event.log], int((change[:, :3] ** 2).sum(1).argmax())
        when = event.start + peak * (event.end - event.start) / (len(change) - 1)
        middle = min(int(np.searchsorted(np.asarray(part.signals.t)[: part.used], when)), part.used - 1)
        R = np.asarray(part.nominal.sensor_rotation)[:, :, middle]
        forces.append((-R @ change[peak, :3]).tolist())
        blunt = SHAPE_ERROR * float(np.linalg.norm(change[peak, :3]))
        spreads.append(np.hypot(np.abs(R) @ error[peak, :3], blunt).tolist())
    starts, stops = (np.array([one.event[side] for one in events], float) for side in (1, 2))
    of_start = np.full(len(events), START_STDERR)
    of_end = of_start + END_STDERR_SHARE * (stops - starts)
    return (
        {search.start: starts.tolist(), search.end: stops.tolist(), search.force: forces},
        {search.start: of_start.tolist(), search.end: of_end.tolist(), search.force: spreads},
    )


def _plain(value: np.ndarray) -> Numbers:
    return np.asarray(value, float).tolist()


def correlations(problem: Problem, fit: Fit, causes: Sequence[Candidate]) -> np.ndarray:
    """(P, P) correlations between the errors of all numbers of the causes, in the order of their parameters.

    They serve to draw samples from the posterior: a Laplace approximation with the covariance of the joint fit of all
    causes, mapped from coordinates to parameters to first order. Parameters that were not fitted with the others, and
    entries of a matrix, are taken as independent.
    """
    try:
        spread = covariance(problem, fit)
    except np.linalg.LinAlgError:
        spread = np.zeros((len(fit.free) + len(fit.coefficients),) * 2)
    rows = [np.zeros((0, len(spread)))]
    for cause in causes:
        own = [h for h in fit.hypotheses if h.effect == cause.effect and _joint(h) == cause.parameters.get("joint")]
        rows += [_derivatives(problem, fit, own[0] if own else None, cause, name, spread) for name in cause.parameters]
    slopes = np.concatenate(rows)
    joint = slopes @ spread @ slopes.T
    std = np.sqrt(np.maximum(np.diag(joint), 0))
    known = np.isfinite(std) & (std > 0)
    scaled = np.where(np.outer(known, known), joint / np.where(known, std, 1)[:, None] / np.where(known, std, 1), 0.0)
    np.fill_diagonal(scaled, 1.0)
    return scaled


def _joint(h: Hypothesis) -> int | None:
    return h.detail if isinstance(h.detail, int) else None


def _derivatives(
    problem: Problem, fit: Fit, h: Hypothesis | None, cause: Candidate, name: str, spread: np.ndarray
) -> np.ndarray:
    """(N, K) derivatives of one parameter's numbers with respect to the free coordinates and coefficients of a fit."""
    count, effect = np.size(cause.parameters[name]), problem.catalogue[cause.effect]
    slopes = np.zeros((count, len(spread)))
    if h is None or isinstance(effect.fit.search, Entries | Touches):
        return slopes
    if h.shapes:
        if name == strengths(effect)[0].name:
            first = len(fit.free) + rows_of(fit, h).start
            slopes[:, first : first + count] = np.eye(count)
        return slopes
    joint = _joint(h)
    told = chain_model.to_values.prepare(problem.parts[0].signals, fit.z, catalogue=problem.catalogue)

    def numbers(z: np.ndarray) -> np.ndarray:
        value = np.asarray(told(problem.parts[0].signals, z)[cause.effect][name], float)
        return np.ravel(value if joint is None else value[joint - 1])

    for i in () if name == "joint" else h.free:
        k = fit.free.index(i)
        step = np.zeros_like(fit.z)
        step[i] = max(np.sqrt(spread[k, k]), 1e-6)
        slopes[:, k] = (numbers(fit.z + step) - numbers(fit.z - step)) / (2 * step[i])
    return slopes


def with_nominal(problem: Problem, candidate: Candidate) -> Candidate:
    """A candidate with the values that any section of the setup states of its parameters, and a sentence with both.

    The tool's mass is stated in [tool] and gravity in [robot]; no key states a gain.
    """
    if candidate.effect not in problem.catalogue:
        return candidate
    entry, known = problem.catalogue[candidate.effect], problem.known.get(candidate.effect, {})
    of_setup = (p.name for p in entry.parameters if callable(p.neutral) and not p.optional)
    stated = {name: neutral_of(problem, entry, name) for name in of_setup} | known
    found = [name for name in candidate.parameters if name in stated]
    nominal = {name: without_round_off(np.asarray(stated[name], float)) for name in found}
    statement = statement_of(entry, candidate, nominal)
    return candidate._replace(nominal={name: value.tolist() for name, value in nominal.items()}, statement=statement)


def statement_of(entry: Effect, candidate: Candidate, nominal: Mapping[str, np.ndarray]) -> str:
    """Sentence with the estimates, from the effect's own statement or else its explanation and its first parameter."""
    estimates = {}
    for name, value in candidate.parameters.items():
        values = np.asarray(value, float)
        errors = np.asarray(candidate.stderr.get(name, np.nan), float)
        unknown = np.full(values.shape, np.nan)
        errors = errors if errors.shape == values.shape else unknown
        estimates[name] = Estimate(values, errors, nominal.get(name, unknown))
    if entry.statement is not None:
        return entry.statement(estimates)
    first = entry.parameters[0]
    if first.name not in estimates or estimates[first.name].value.size != 1:
        return entry.explanation
    unit = "" if first.unit == "1" else f" {first.unit}"
    return amount(f"{entry.explanation} ({first.name} {{value}}{unit}{{setup}})", first.name)(estimates)
