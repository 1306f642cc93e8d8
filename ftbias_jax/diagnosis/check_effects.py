"""Check of user-defined effects: whether they can be simulated, filtered and diagnosed; one sentence per fault."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.diagnosis.proposals.searched import Extent, apart, starts_together
from ftbias_jax.diagnosis.regression.coordinates import (
    bounds_of,
    scale_of,
    strengths,
    to_coordinates,
    values_at,
    why_not_fitted,
)
from ftbias_jax.errors import FtbiasError, LogError, UsageError
from ftbias_jax.model.effects import compose
from ftbias_jax.model.effects.catalogue import CATALOGUE, neutral_values, typical_values
from ftbias_jax.model.effects.fitting import Entries, Grid, Linear, Starts
from ftbias_jax.model.effects.types import Effect, EffectValues, Model, Parameter, Record, Signals, motion_of
from ftbias_jax.model.kinematics.screws import make_arm
from ftbias_jax.model.own_effects import fault_of
from ftbias_jax.model.wrench.tool_wrench import tool_parameters
from ftbias_jax.runtime.jax_config import in_float64
from ftbias_jax.setup.robots import STANDARD_GRAVITY, built_in_robot
from ftbias_jax.types import Array

RATE, SECONDS, LONGEST = 50.0, 8.0, 100.0
"""Hz, and s, of the motion on which effects are tried; s at most, where a search starts at later times."""
NEUTRAL = 1e-9
"""N, Nm; a switched-off effect that changes the reading by more has a fault."""
SEEN = 1e-6
"""N, Nm; an effect of typical size that changes the reading by less does nothing."""
STEP = 1e-4
"""Step of a coordinate in the central differences that derivatives are compared with."""
AGREE, CORNERS = 0.5, 0.2
"""Share of its size by which a derivative may differ from the difference, and share of samples that may differ by more:
at a corner the derivative is one-sided, whereas a rounded number has no derivative anywhere."""

CHECKED = (Linear, Entries, Grid, Starts)
"""Searches that need derivatives with respect to all coordinates."""

WITHOUT_SLOPE = "at neutral the reading does not depend on it: mark it search=True, or give it another neutral value"
NOT_FINITE = "the reading is NaN or infinite"
WITHOUT_NUMBER = "it uses a traced JAX value as a plain number: use jnp.where instead of if, and jnp instead of numpy"
FromPython = (jax.errors.ConcretizationTypeError, jax.errors.TracerArrayConversionError)
"""Exceptions of JAX where code needs a concrete number."""


@in_float64
def check_effects(effects: Sequence[Any]) -> list[str]:
    """Faults of effects, one sentence each; [] = all can be used.

    Args:
        effects: ``Effect`` objects, such as ``load_effects`` returns.
    """
    known, faults = set(CATALOGUE), list[str]()
    for effect in effects:
        fault = fault_of(effect, known)
        faults += [fault] if fault else [f"effect {effect.name!r}: {words}" for words in _faults(effect, effects)]
        known |= {effect.name} if isinstance(effect, Effect) else set()
    return faults


@contextmanager
def typed_errors(effects: Sequence[Any]) -> Iterator[None]:
    """Context in which an exception raised by faulty effects, or by a singular linear system, becomes a typed error.

    Raises:
        UsageError: an effect is not finite, which no fit would notice; or an exception was raised, and one of the
            effects has a fault.
        LogError: a linear system has no solution.
    """
    remedy = "run ftbias effects check FILE.py"
    for fault in check_effects(effects):
        if NOT_FINITE in fault:
            raise UsageError(fault, field="effects", remedy=remedy)
    try:
        yield
    except FtbiasError:
        raise
    except Exception as error:  # the caller's code may raise anything
        if faults := check_effects(effects):
            raise UsageError(faults[0], field="effects", remedy=remedy) from error
        if not isinstance(error, np.linalg.LinAlgError):
            raise
        message = f"the log cannot be diagnosed, because a linear system is singular: {error}"
        values = "check its values with ftbias info: a stream may be constant, or far beyond its range"
        raise LogError(message, remedy=values) from error


def _faults(effect: Effect, effects: Sequence[Any]) -> list[str]:
    names = {"none", *CATALOGUE, *(one.name for one in effects if isinstance(one, Effect))}
    faults = [f"its twin {twin.effect!r} is no effect" for twin in effect.twins if twin.effect not in names]
    signals = _motion(_seconds(effect))
    needed = {need: signals.temperature for need in effect.needs if need != "temperature"}
    signals = signals._replace(columns=needed)
    try:
        return faults + (_of_recording if effect.hook == "record" else _of_reading)(effect, signals)
    except FromPython:
        return [*faults, WITHOUT_NUMBER]
    except Exception as error:  # the caller's code: whatever it raises is reported
        return [*faults, f"its code raises {type(error).__name__}: {' '.join(str(error).split())[:200]}"]


def _seconds(effect: Effect) -> float:
    """Duration of a motion that covers the latest stated start; effects that state no start fit into any motion."""
    latest = [float(np.max(p.starts)) for p in effect.parameters if p.search and p.unit == "s" and p.starts]
    return float(np.clip(1.25 * max(latest, default=0.0), SECONDS, LONGEST))


@lru_cache
def _motion(seconds: float) -> Signals:
    """Panda that moves all its joints, with every signal that an effect may need; computed once per duration."""
    robot = built_in_robot("panda", STANDARD_GRAVITY)
    t = np.linspace(0, seconds, round(RATE * seconds))
    phase, rate = t[:, None] * (0.7 + 0.13 * np.arange(7)) + np.arange(7), 0.7 + 0.13 * np.arange(7)
    q = np.array([0.0, -0.6, 0.0, -2.0, 0.0, 1.8, 0.8]) + 0.5 * np.sin(phase)
    arm = make_arm(jnp.asarray(robot.screws), jnp.asarray(robot.flange_translation), jnp.asarray(robot.flange_rotation))
    theta = tool_parameters(jnp.asarray(0.9), jnp.array([0.01, -0.005, 0.06]), jnp.array([2e-3, 0, 0, 2e-3, 0, 1e-3]))
    signals = Signals(
        t=jnp.asarray(t),
        q=jnp.asarray(q),
        dq=jnp.asarray(0.5 * rate * np.cos(phase)),
        ddq=jnp.asarray(-0.5 * rate**2 * np.sin(phase)),
        temperature=jnp.asarray(25 + np.sin(t)),
        model=Model(arm, jnp.asarray(robot.gravity), theta),
    )
    return signals._replace(motion=jax.jit(motion_of)(signals))


@lru_cache
def _nominal(seconds: float) -> Array:
    """(T, 6) reading without any effect."""
    return jax.jit(compose.tool_wrenches)(_motion(seconds))


def _starts(effect: Effect, neutral: EffectValues, signals: Signals, seconds: float) -> list[EffectValues]:
    """Values of the parameters that need a search, at all its starts for a log of this motion."""
    extent = Extent(seconds, apart(np.asarray(signals.path.position)))
    stated = {name: np.asarray(value) for name, value in neutral.items()}
    return [
        {name: jnp.asarray(value) for name, value in start.items()} for start in starts_together(effect, stated, extent)
    ]


def _of_reading(effect: Effect, signals: Signals) -> list[str]:
    seconds = _seconds(effect)
    nominal = _nominal(seconds)
    predict = jax.jit(partial(_predict, effect, signals))
    if wrong := _wrong_type(effect, signals, nominal):
        return [wrong]
    model = signals.model
    neutral = neutral_values(effect, model)
    starts = _starts(effect, neutral, signals, seconds)
    off = [("switched off, at a start of its search", start) for start in starts if strengths(effect)]
    for words, start in (("at neutral", {}), *off):
        change = np.abs(np.asarray(predict(neutral | start) - nominal)).max()
        if not np.isfinite(change):
            return [f"{words} {NOT_FINITE}; neutral values must change nothing"]
        if change > NEUTRAL:
            return [f"{words} it changes the reading by {change:.2g} N or Nm; neutral values must change nothing"]
    typical = typical_values(effect, model)
    changes = [np.abs(np.asarray(predict(typical | start) - nominal)).max() for start in ({}, *starts)]
    if not np.isfinite(changes).all():
        return [f"with typical values (neutral plus scale) {NOT_FINITE}"]
    if max(changes) < SEEN:
        return ["typical values (neutral plus scale) change nothing at any start: give its parameters a scale"]
    derived = isinstance(effect.fit.search, CHECKED) and not why_not_fitted(effect)
    clearest = [start for _, start in sorted(zip(changes[1:], starts, strict=True), key=lambda one: -one[0])]
    return _of_slopes(effect, signals, clearest) if derived else []


def _predict(effect: Effect, signals: Signals, values: EffectValues) -> Array:
    own, catalogue = {effect.name: values}, {effect.name: effect}
    if not effect.transform:  # the tool's wrench stays as it is
        return compose.read(signals, own, _nominal(_seconds(effect)), catalogue)
    return compose.predict(signals, own, catalogue)


def _wrong_type(effect: Effect, signals: Signals, wrench: Array) -> str:
    values = typical_values(effect, signals.model)
    if effect.transform:
        moved = jax.eval_shape(effect.transform, values, signals)
        if not isinstance(moved, Signals):
            return f"its transform returns {type(moved).__name__}, and must return signals._replace(...)"
    if effect.reading:
        reading = jax.eval_shape(effect.reading, values, signals, wrench)
        if getattr(reading, "shape", None) != wrench.shape:
            made = f"the shape {reading.shape}" if hasattr(reading, "shape") else type(reading).__name__
            return f"its reading returns {made}, and must return an array (T, 6) like the wrench it gets"
    return ""


def _of_slopes(effect: Effect, signals: Signals, starts: list[EffectValues]) -> list[str]:
    """Faults of the derivatives: they must be finite, agree with differences, and show each parameter at some start."""
    model = signals.model
    neutral = {name: np.asarray(value) for name, value in neutral_values(effect, model).items()}
    reading: Callable[[Any], Array] = jax.jit(lambda z: _predict(effect, signals, values_at(effect, model, z)))
    scales = {p.name: np.broadcast_to(np.asarray(p.scale, float), p.shape).ravel() for p in effect.parameters}
    still = {p.name for p in effect.parameters if scales[p.name].any() and not p.search}
    for start in starts:
        at = {
            p.name: np.zeros(neutral[p.name].size)
            if p.name not in start
            else _inside(effect, p, to_coordinates(effect, p, neutral[p.name], np.asarray(start[p.name])))
            for p in effect.parameters
        }
        on = at | {p.name: np.full(neutral[p.name].size, 0.5) for p in strengths(effect)}
        for parameter in effect.parameters:
            name = parameter.name
            for i in np.flatnonzero(scales[name]):
                z = on if parameter.search else at
                direction = {other: np.zeros_like(x) for other, x in z.items()}
                direction[name][i] = 1.0
                slope = np.asarray(jax.jvp(reading, (z,), (direction,))[1])
                ahead, behind = (reading({k: x + step * direction[k] for k, x in z.items()}) for step in (STEP, -STEP))
                difference = np.asarray(ahead - behind) / (2 * STEP)
                if fault := _fault_of_slope(slope, difference):
                    return [f"{name if not parameter.shape else f'number {i + 1} of {name}'}: {fault}"]
                if np.abs([slope, difference]).max() > SEEN:
                    still.discard(name)
        if not still:
            break
    return [f"{p.name}: {WITHOUT_SLOPE}" for p in effect.parameters if p.name in still]


def _inside(effect: Effect, parameter: Parameter, z: np.ndarray) -> np.ndarray:
    """Coordinates (k,) of a start, slightly inside its bounds, because values rounded beyond have no derivative."""
    least, most = bounds_of(scale_of(effect, parameter))
    return np.clip(z, least + 2 * STEP, most - 2 * STEP)


def _fault_of_slope(slope: np.ndarray, difference: np.ndarray) -> str:
    if not np.isfinite(slope).all():
        return "its derivative of the reading is not finite where a fit begins (0/0, or a root of 0): use jnp.where"
    size = max(np.abs(slope).max(), np.abs(difference).max())
    # Clipped at a bound, the difference is half of the derivative inside.
    off = np.minimum(np.abs(difference - slope), np.abs(difference - slope / 2))
    if size > SEEN and (off > AGREE * size).any(1).mean() > CORNERS:
        return "the reading is not differentiable by it; a whole number, which is rounded, needs scale=0, search=True"
    return ""


def _of_recording(effect: Effect, signals: Signals) -> list[str]:
    wrench = _nominal(_seconds(effect))
    noise = 0.01 * jax.random.normal(jax.random.key(0), wrench.shape)
    recorded = Record(signals.t, wrench + noise, noise, signals.dq)
    assert effect.recording is not None
    for values_of in (neutral_values, typical_values):
        values = values_of(effect, signals.model)
        made = jax.jit(effect.recording)(values, jax.random.key(1), recorded)
        if not isinstance(made, Record) or made.wrench.shape != wrench.shape:
            return ["its recording must return record._replace(...) with a wrench (T, 6)"]
        if values_of is neutral_values and not np.abs(np.asarray(made.wrench - recorded.wrench)).max() < NEUTRAL:
            return ["at neutral it changes samples; neutral values must change nothing"]
    return []
