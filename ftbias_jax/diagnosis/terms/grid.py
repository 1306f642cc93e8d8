"""The terms that are tried on a problem: every form of every drive, with its parameters on a grid."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.terms.peaks import lines, multiples
from ftbias_jax.diagnosis.thresholds import LEAST_TURN, LEAST_WARMING
from ftbias_jax.model.effects.terms.columns import has_point
from ftbias_jax.model.effects.terms.forms import FORMS
from ftbias_jax.model.effects.terms.types import State, Term

SWINGS = tuple((f, z) for f in np.geomspace(0.4, 14.0, 13) for z in (0.04, 0.3))
"""Hz and shares of critical damping."""
SPEEDS, TURNS = (0.005, 0.05), (0.01, 0.1)
"""m/s and rad/s below which dry friction gives way."""
POWERS = (2.0,)
"""Of the distance by which a field falls."""
CENTRES = 5
"""Places along every axis of the base where a field may come from."""
REFERENCES = (0.0, 0.5, 1.0)
"""Quantiles of the temperature at which gauges may be right."""
QUANTILES = (0.3, 0.6, 0.85)
"""Of the tool's places along a normal, beyond which a wall begins."""


def make_term(
    drive: str,
    form: str,
    frame: str,
    acts_as: str,
    joint: int = 0,
    parameters: Mapping[str, float] | None = None,
    point: np.ndarray | None = None,
) -> Term:
    """A term without coefficients."""
    at = np.zeros(3) if point is None else point
    numbers = {name: np.asarray(value, float) for name, value in (parameters or {}).items()}
    return Term(drive, form, frame, acts_as, joint, (), numbers, at, np.zeros(0))


def make_grid(
    problem: Problem, state: State, point: np.ndarray, error: np.ndarray, fast: Sequence[float] = ()
) -> list[Term]:
    """All terms to try.

    Args:
        problem: of the logs.
        state: of all logs end to end.
        point: (3,) m, sensor frame, where forces act at first.
        error: (U, 6) innovations that remain, for what stands out in their spectrum.
        fast: Hz of lines in the single samples.
    """
    rows = (*_slow(problem), *_of_places(state), *_of_joints(problem, state), *_vectors(state), *_channels(problem))
    shifts = state.q.shape[1] or problem.joints == ENTRIES
    found = _made([row for row in rows if shifts or row[0] not in LINEAR_DRIVES], point)
    return found + of_spectra(problem, state, point, error, fast)


def of_spectra(
    problem: Problem, state: State, point: np.ndarray, error: np.ndarray, fast: Sequence[float] = ()
) -> list[Term]:
    """The terms that stand out in what remains: lines in time and in the angles of joints. Arguments as above."""
    rows = list(_lines([*fast, *lines(problem, error)]))
    for joint, multiple in multiples(state, error):
        rows += _both("joint_angle", "harmonic", joint, {"multiple": multiple})
    return _made(rows, point)


def _made(rows: Sequence[Row], point: np.ndarray) -> list[Term]:
    found = [make_term(*row) for row in rows]
    return [replace(term, point=point) if has_point(term) else term for term in found]


LINEAR_DRIVES = ("position", "velocity", "acceleration")
"""Of the sensor's place; not known where only its orientation is recorded."""
ENTRIES = 7
"""Of a recorded pose with the place."""
Row = tuple[str, str, str, str, int, dict[str, float]]
"""Drive, form, frame, what it acts as, joint, and parameters."""


def _both(drive: str, form: str, joint: int = 0, parameters: dict[str, float] | None = None) -> Iterator[Row]:
    """Scalars along the axes of the base, as forces and as torques, and along those of the sensor."""
    for frame, acts_as in (("base", "force"), ("base", "torque"), ("sensor", "wrench")):
        yield drive, form, frame, acts_as, joint, parameters or {}


def _slow(problem: Problem) -> Iterator[Row]:
    longest = max(problem.durations)
    yield "constant", "steady", "base", "force", 0, {}
    yield "constant", "steady", "base", "torque", 0, {}
    yield "constant", "steady", "base", "wrench", 0, {}
    yield from _both("time", "linear")
    yield from _both("time", "quadratic")
    for tau in np.geomspace(longest / 60, longest, 7):
        yield from _both("time", "exponential", 0, {"time_constant": tau})
    for periods in (0.7, 1.2, 2.0, 3.0, 4.5):
        yield from _both("time", "wave", 0, {"frequency": periods / longest})
    for time in np.linspace(0, longest, 22)[1:-1]:
        yield "time", "step", "base", "force", 0, {"time": time}
        yield "time", "step", "sensor", "wrench", 0, {"time": time}
    if np.ptp(problem.temperature) > LEAST_WARMING:
        for lag in (0.0, longest / 30, longest / 8):
            yield "temperature", "linear", "sensor", "wrench", 0, {"lag": lag}
            yield "temperature", "linear", "base", "force", 0, {"lag": lag}
            yield "temperature", "quadratic", "sensor", "wrench", 0, {"lag": lag}
            if lag:
                yield "temperature", "gradient", "sensor", "wrench", 0, {"lag": lag}


def _of_places(state: State) -> Iterator[Row]:
    for name in ("linear", "quadratic"):
        yield from _both("position", name)
    yield "orientation", "map", "sensor", "wrench", 0, {}
    for dip, headings in ((0.0, 4), (0.8, 4), (-0.8, 4)):
        for heading in np.arange(headings) * 2 * np.pi / headings / (1 if dip else 2):
            flat = np.cos(dip) * np.array([np.cos(heading), np.sin(heading)])
            direction = dict(zip("xyz", (float(flat[0]), float(flat[1]), float(np.sin(dip))), strict=True))
            yield "orientation", "field", "sensor", "wrench", 0, direction
    for sign in (1.0, -1.0):
        for axis in range(3):
            normal = dict(zip("xyz", (np.eye(3)[axis] * sign).tolist(), strict=True))
            along = sign * state.position[:, axis]
            width = float(np.ptp(along)) + 0.02
            for quantile in QUANTILES:
                offset = float(np.quantile(along, quantile))
                yield "position", "barrier", "base", "force", 0, {**normal, "offset": offset, "length": 0.03 * width}
            yield "position", "barrier", "base", "force", 0, {**normal, "offset": offset, "length": width / 3}


def _about_joint(form: tuple[str, str], joint: int, **parameters: float) -> Row:
    return *form, "joint", "torque", joint, parameters


def _of_joints(problem: Problem, state: State) -> Iterator[Row]:
    count = state.q.shape[1]  # none, if the sensor's pose is recorded
    if not count:
        return
    for j in range(1, count + 1):
        if np.ptp(state.q[:, j - 1]) < LEAST_TURN:
            continue
        yield from _both("joint_angle", "linear", j)
        yield from _both("joint_angle", "cubic", j)
        yield _about_joint(("joint_angle", "linear"), j)
        yield _about_joint(("joint_angle", "cubic"), j)
        yield _about_joint(("joint_velocity", "viscous"), j)
        yield _about_joint(("joint_velocity", "quadratic"), j)
        yield _about_joint(("joint_velocity", "friction"), j, speed=0.05)
        for multiple in (1.0, 2.0, 3.0, 4.0):
            yield from _both("joint_angle", "harmonic", j, {"multiple": multiple})
            yield _about_joint(("joint_angle", "harmonic"), j, multiple=multiple)
        yield from _both("joint_velocity", "viscous", j)
        yield from _both("joint_velocity", "quadratic", j)
        for speed in TURNS:
            yield from _both("joint_velocity", "friction", j, {"speed": speed})
    for j in range(count + 1):
        for tau in max(problem.durations) * np.array([0.05, 0.3, 3.0]):
            yield "joint_velocity", "heat", "sensor", "wrench", j, {"time_constant": float(tau)}


def _lines(frequencies: Sequence[float]) -> Iterator[Row]:
    for frequency in frequencies:
        yield from _both("frequency", "line", 0, {"frequency": frequency})


def _vectors(state: State) -> Iterator[Row]:
    for acts_as in ("force", "torque"):
        for name in ("linear", "quadratic"):
            yield "velocity", name, "base", acts_as, 0, {}
            yield "angular_velocity", name, "base", acts_as, 0, {}
        for slow, turn in zip(SPEEDS, TURNS, strict=True):
            yield "velocity", "coulomb", "base", acts_as, 0, {"speed": slow}
            yield "angular_velocity", "coulomb", "base", acts_as, 0, {"speed": turn}
        yield "acceleration", "linear", "base", acts_as, 0, {}
    for name in ("linear", "quadratic", "gyroscopic"):
        yield "angular_velocity", name, "sensor", "torque", 0, {}
    yield "acceleration", "linear", "sensor", "force", 0, {}
    yield "velocity", "linear", "sensor", "force", 0, {}
    for turn in TURNS:
        yield "angular_velocity", "coulomb", "sensor", "torque", 0, {"speed": turn}
    yield "acceleration", "turning", "sensor", "torque", 0, {}
    for frequency, damping_ratio in SWINGS:
        numbers = {"frequency": float(frequency), "damping_ratio": damping_ratio}
        yield "acceleration", "swing", "base", "force", 0, numbers
    for lag in (0.03, 0.1, 0.3, 1.0):
        yield "acceleration", "trailing", "base", "force", 0, {"lag": lag}
    yield "position", "spring", "base", "force", 0, {}
    low, high = state.position.min(0), state.position.max(0)
    room = 0.4 * (high - low) + 0.1
    for place in np.stack(np.meshgrid(*np.linspace(low - room, high + room, CENTRES).T), -1).reshape(-1, 3):
        for power in POWERS:
            centre = dict(zip("xyz", place.tolist(), strict=True))
            yield "position", "attraction", "base", "force", 0, {**centre, "power": power, "core": 0.1}


def _channels(problem: Problem) -> Iterator[Row]:
    longest = max(problem.durations)
    for name in ("square", "signed_square", "cube", "size"):
        yield "load", name, "sensor", "wrench", 0, {}
    yield "load_time", "linear", "sensor", "wrench", 0, {}
    for tau in np.geomspace(longest / 20, longest, 4):
        yield "load_time", "exponential", "sensor", "wrench", 0, {"time_constant": float(tau)}
    for periods in (1.0, 2.0, 4.0):
        yield "load_time", "wave", "sensor", "wrench", 0, {"frequency": periods / longest}
    for time in np.linspace(0, longest, 12)[1:-1]:
        yield "load_time", "step", "sensor", "wrench", 0, {"time": float(time)}
    if np.ptp(problem.temperature) > LEAST_WARMING:
        for lag in (0.0, longest / 10):
            yield "temperature", "sensitivity", "sensor", "wrench", 0, {"lag": lag}
            for share in REFERENCES:
                numbers = {"lag": lag, "reference": float(np.quantile(problem.temperature, share))}
                yield "temperature", "calibrated", "sensor", "wrench", 0, numbers
                yield "temperature", "compensated", "sensor", "wrench", 0, numbers


def free_names(term: Term) -> tuple[str, ...]:
    """Names of the parameters in which the form is not linear."""
    return tuple(parameter.name for parameter in FORMS[term.drive, term.form].parameters)
