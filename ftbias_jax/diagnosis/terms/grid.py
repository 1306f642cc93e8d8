"""Grid of candidate terms for a problem: every form of every drive, with its parameters on a grid.

Candidates from the spectrum of the innovations are added: spectral lines in time, and in the angle of a joint.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.diagnosis.terms.spectra import lines, multiples
from ftbias_jax.diagnosis.terms.switches import switches
from ftbias_jax.diagnosis.thresholds import LEAST_TURN, LEAST_WARMING
from ftbias_jax.model.effects.terms.columns import has_point
from ftbias_jax.model.effects.terms.forms import FORMS
from ftbias_jax.model.effects.terms.types import State, Term
from ftbias_jax.types import Array

OSCILLATIONS = tuple((f, z) for f in np.geomspace(0.4, 14.0, 13) for z in (0.04, 0.3))
"""Hz and damping ratios."""
SPEEDS, TURNS = (0.005, 0.05), (0.01, 0.1)
"""m/s and rad/s below which dry friction gives way."""
CENTRES = 5
"""Number of candidate origins of a field along every axis of the base."""
REGIONS, RADII = 24, (0.12, 0.3)
"""Number of positions on the tool's path where a region may be centred, and radii as shares of the path's extent."""
REFERENCES = (0.0, 0.5, 1.0)
"""Quantiles of the temperature at which gauges may be right."""
QUANTILES = (0.3, 0.6, 0.85)
"""Quantiles of the tool's positions along a normal, beyond which a wall begins."""
LINEAR_DRIVES = ("position", "velocity", "acceleration")
"""Drives by the sensor's position, which is unknown where only its orientation is recorded."""
ENTRIES = 7
"""Number of entries of a recorded pose that includes the position."""
FORCE, TORQUE, SENSOR, JOINT = ("base", "force"), ("base", "torque"), ("sensor", "wrench"), ("joint", "torque")
"""Frame of a term, and what it acts as."""
EACH = (FORCE, TORQUE, SENSOR)
"""Scalars along the axes of the base, as forces and as torques, and along those of the sensor."""
SWITCHED = {
    "sensor": ("time", "step", (SENSOR,)),
    "force": ("time", "step", (FORCE,)),
    "torque": ("time", "step", (TORQUE,)),
    "payload": ("acceleration", "payload", (FORCE,)),
}
"""What may be switched on and off -> drive, form, frame, and what the term acts as."""
PICK_UP_TIME = 0.05
"""s, starting value of the time in which a load is taken up: a fit can shorten it, but a step would have no slope."""


def make_term(
    drive: str,
    form: str,
    frame: str,
    acts_as: str,
    joint: int = 0,
    parameters: Mapping[str, Array] | None = None,
    point: np.ndarray | None = None,
) -> Term:
    """Term without coefficients."""
    at = np.zeros(3) if point is None else point
    numbers = {name: np.squeeze(np.asarray(value, float)) for name, value in (parameters or {}).items()}
    return Term(drive, form, frame, acts_as, joint, (), numbers, at, np.zeros(0))


def make_grid(problem: Problem, state: State, point: np.ndarray, fit: Fit, fast: Sequence[float] = ()) -> list[Term]:
    """All terms to try, with forces that act at a point (3,) m, sensor frame, initially.

    The residual of a fit is searched for further terms, in addition to ``fast``, lines of the individual samples in Hz.
    """
    terms = (*_slow(problem), *_of_places(state), *_of_joints(problem, state), *_vectors(state), *_channels(problem))
    shifts = state.q.shape[1] or problem.joints == ENTRIES
    found = [term for term in terms if shifts or term.drive not in LINEAR_DRIVES]
    return _at(point, found) + terms_from_residual(problem, state, point, fit, fast)


def terms_from_residual(
    problem: Problem, state: State, point: np.ndarray, fit: Fit, fast: Sequence[float] = ()
) -> list[Term]:
    """Terms suggested by the residual of a fit: lines in time, lines in joint angles, switching. Arguments as above."""
    found = [*_terms("frequency", "line", EACH, _each("frequency", [*fast, *lines(problem, fit.error)]))]
    for joint, multiple in multiples(state, fit.error):
        found += _terms("joint_angle", "harmonic", EACH, [{"multiple": multiple}], joint)
    return _at(point, [*found, *of_switches(problem, state, fit)])


def of_switches(problem: Problem, state: State, fit: Fit, names: Collection[str] = SWITCHED) -> Iterator[Term]:
    """Terms for switching on and off that the residual of a fit suggests, restricted to these names of ``SWITCHED``."""
    for name, times in switches(problem, state, fit, names):
        takes = {"takes": PICK_UP_TIME} if name == "payload" else {}
        yield from _terms(*SWITCHED[name], [{"time": times, **takes}])


def _at(point: np.ndarray, terms: Iterable[Term]) -> list[Term]:
    return [replace(term, point=point) if has_point(term) else term for term in terms]


def _terms(
    drive: str,
    form: str,
    places: Sequence[tuple[str, str]],
    grid: Iterable[Mapping[str, Array]] = ({},),
    joint: int = 0,
) -> Iterator[Term]:
    """Form with every set of parameters of a grid, in each frame and as whatever it may act."""
    for parameters in grid:
        for frame, acts_as in places:
            yield make_term(drive, form, frame, acts_as, joint, parameters)


def _each(name: str, values: Iterable[float]) -> list[dict[str, float]]:
    return [{name: float(value)} for value in values]


def _slow(problem: Problem) -> Iterator[Term]:
    longest = max(problem.durations)
    yield from _terms("constant", "steady", (FORCE, TORQUE, ("base", "wrench")))
    yield from _terms("time", "linear", EACH)
    yield from _terms("time", "quadratic", EACH)
    yield from _terms("time", "exponential", EACH, _each("time_constant", np.geomspace(longest / 60, longest, 7)))
    yield from _terms("time", "wave", EACH, _each("frequency", np.array([0.7, 1.2, 2.0, 3.0, 4.5]) / longest))
    yield from _terms("time", "step", (FORCE, SENSOR), _each("time", np.linspace(0, longest, 22)[1:-1]))
    if np.ptp(problem.temperature) > LEAST_WARMING:
        for lag in _each("lag", (0.0, longest / 30, longest / 8)):
            yield from _terms("temperature", "linear", (SENSOR, FORCE), [lag])
            yield from _terms("temperature", "quadratic", (SENSOR,), [lag])
            yield from _terms("temperature", "gradient", (SENSOR,), [lag] if lag["lag"] else [])


def _of_places(state: State) -> Iterator[Term]:
    yield from _terms("position", "linear", EACH)
    yield from _terms("position", "quadratic", EACH)
    yield from _terms("orientation", "map", (SENSOR,))
    for dip, turn in ((0.0, np.pi), (0.8, 2 * np.pi), (-0.8, 2 * np.pi)):
        for heading in np.arange(4) * turn / 4:
            flat = np.cos(dip) * np.array([np.cos(heading), np.sin(heading)])
            yield from _terms("orientation", "field", (SENSOR,), [_vector((*flat, np.sin(dip)))])
    for signs in product((1.0, -1.0, 0.0), repeat=3):
        if not any(signs):
            continue
        normal = np.array(signs) / np.linalg.norm(signs)
        along = state.position @ normal
        width, offsets = float(np.ptp(along)) + 0.02, np.quantile(along, QUANTILES).tolist()
        walls = [_vector(normal) | {"offset": offset, "length": 0.03 * width} for offset in offsets]
        yield from _terms("position", "surface", (FORCE,), walls)
        if np.abs(normal).max() == 1:
            wide = _vector(normal) | {"offset": offsets[-1], "length": width / 3}
            yield from _terms("position", "barrier", (FORCE,), [*walls, wide])


def _vector(numbers: Iterable[float]) -> dict[str, float]:
    return dict(zip("xyz", map(float, numbers), strict=True))


def _of_joints(problem: Problem, state: State) -> Iterator[Term]:
    count = state.q.shape[1]  # 0 if the sensor's pose is recorded
    for j in range(1, count + 1):
        if np.ptp(state.q[:, j - 1]) < LEAST_TURN:
            continue
        yield from _terms("joint_angle", "linear", (*EACH, JOINT), joint=j)
        yield from _terms("joint_angle", "cubic", (*EACH, JOINT), joint=j)
        yield from _terms("joint_velocity", "viscous", (*EACH, JOINT), joint=j)
        yield from _terms("joint_velocity", "quadratic", (*EACH, JOINT), joint=j)
        yield from _terms("joint_velocity", "friction", (JOINT,), [{"speed": 0.05}], j)
        yield from _terms("joint_velocity", "friction", EACH, _each("speed", TURNS), j)
        yield from _terms("joint_angle", "harmonic", (*EACH, JOINT), _each("multiple", (1.0, 2.0, 3.0, 4.0)), j)
    for j in range(count + 1 if count else 0):
        taus = max(problem.durations) * np.array([0.05, 0.3, 3.0])
        yield from _terms("joint_velocity", "heat", (SENSOR,), _each("time_constant", taus), j)


def _vectors(state: State) -> Iterator[Term]:
    in_sensor, turned = (("sensor", "force"),), (("sensor", "torque"),)
    for place in (FORCE, TORQUE):
        for name in ("linear", "quadratic"):
            yield from _terms("velocity", name, (place,))
            yield from _terms("angular_velocity", name, (place,))
        for slow, turn in zip(SPEEDS, TURNS, strict=True):
            yield from _terms("velocity", "coulomb", (place,), [{"speed": slow}])
            yield from _terms("angular_velocity", "coulomb", (place,), [{"speed": turn}])
        yield from _terms("acceleration", "linear", (place,))
    for name in ("linear", "quadratic", "gyroscopic"):
        yield from _terms("angular_velocity", name, turned)
    yield from _terms("acceleration", "linear", in_sensor)
    yield from _terms("velocity", "linear", in_sensor)
    yield from _terms("angular_velocity", "coulomb", turned, _each("speed", TURNS))
    yield from _terms("acceleration", "turning", turned)
    swings = [{"frequency": float(frequency), "damping_ratio": damping} for frequency, damping in OSCILLATIONS]
    yield from _terms("acceleration", "swing", (FORCE,), swings)
    yield from _terms("acceleration", "trailing", (FORCE,), _each("lag", (0.03, 0.1, 0.3, 1.0)))
    yield from _terms("position", "spring", (FORCE,))
    low, high = state.position.min(0), state.position.max(0)
    room = 0.4 * (high - low) + 0.1
    centres = np.stack(np.meshgrid(*np.linspace(low - room, high + room, CENTRES).T), -1).reshape(-1, 3)
    fields = [_vector(centre) | {"power": 2.0, "core": 0.1} for centre in centres]
    yield from _terms("position", "attraction", (FORCE,), fields)
    extent = float(np.linalg.norm(high - low))
    for radius in (share * extent for share in RADII if extent > 0):  # the tool may rotate without translating
        regions = [_vector(place) | {"radius": radius, "edge": radius / 3} for place in _visited(state.position)]
        yield from _terms("velocity", "local", (FORCE,), regions)


def _visited(positions: np.ndarray) -> list[np.ndarray]:
    """Positions (3,) chosen from (U, 3), each as far as possible from the previous ones."""
    chosen, distance = [positions[0]], np.full(len(positions), np.inf)
    for _ in range(REGIONS - 1):
        distance = np.minimum(distance, ((positions - chosen[-1]) ** 2).sum(1))
        chosen.append(positions[distance.argmax()])
    return chosen


def _channels(problem: Problem) -> Iterator[Term]:
    longest, channels = max(problem.durations), (SENSOR,)
    for name in ("square", "signed_square", "cube", "size"):
        yield from _terms("load", name, channels)
    yield from _terms("load_time", "linear", channels)
    taus = np.geomspace(longest / 20, longest, 4)
    yield from _terms("load_time", "exponential", channels, _each("time_constant", taus))
    yield from _terms("load_time", "wave", channels, _each("frequency", np.array([1.0, 2.0, 4.0]) / longest))
    yield from _terms("load_time", "step", channels, _each("time", np.linspace(0, longest, 12)[1:-1]))
    if np.ptp(problem.temperature) > LEAST_WARMING:
        for lag in _each("lag", (0.0, longest / 10)):
            yield from _terms("temperature", "sensitivity", channels, [lag])
            for reference in _each("reference", np.quantile(problem.temperature, REFERENCES)):
                yield from _terms("temperature", "calibrated", channels, [lag | reference])
                yield from _terms("temperature", "compensated", channels, [lag | reference])


def free_names(term: Term) -> tuple[str, ...]:
    """Names of the nonlinear parameters of the form, except switching times."""
    return tuple(own.name for own in FORMS[term.drive, term.form].parameters if not own.several)
