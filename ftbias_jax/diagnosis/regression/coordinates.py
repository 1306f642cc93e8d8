"""Coordinates of effects as their entries state them: 0 is neutral or a typical value, 1 a typical departure.

A parameter has one coordinate for each of its numbers; an offset of one joint has one for each joint. An entry may
state how its parameter follows from them (``fitting.Coordinate``). Where it does not, and the effect has other
parameters that switch it off, a positive parameter that needs a search is taken by its logarithm; one whose neutral is
infinite by its inverse.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from ftbias_jax.model.effects.catalogue import neutral_values
from ftbias_jax.model.effects.fitting import (
    BY_COORDINATES,
    INVERSE,
    LINEAR,
    LOGARITHM,
    ByJoint,
    Coordinate,
    Samples,
)
from ftbias_jax.model.effects.table import Catalogue
from ftbias_jax.model.effects.types import Effect, EffectValues, Model, Parameter
from ftbias_jax.types import Array

SMALLEST_INVERSE = 1e-6
"""Of the coordinate: a value this many times larger than its scale counts as infinite."""
MOST_LOGARITHM = 12.0
"""A factor of 160,000 from the typical value either way."""
AS_STATED = Coordinate()


class Block(NamedTuple):
    """Coordinates of one effect within the whole vector."""

    effect: str
    parameter: str
    size: int
    least: np.ndarray
    most: np.ndarray
    """(size,) bounds of the coordinates."""


def fitted_effects(catalogue: Catalogue) -> list[Effect]:
    """The effects of a catalogue that are fitted in coordinates."""
    return [effect for effect in catalogue.searched_by(*BY_COORDINATES) if not why_not_fitted(effect)]


def why_not_fitted(effect: Effect) -> str:
    """Why an effect is not looked for, in words; "" = it is."""
    if isinstance(effect.fit.search, Samples):
        return ""
    if effect.hook == "record":
        return "it acts on single samples, and only effects on the mean reading are looked for"
    if not isinstance(effect.fit.search, BY_COORDINATES):
        return ""
    if any(-1 in parameter.shape for parameter in effect.parameters):
        return "it has events, whose number is not known"
    if not any(can_move(parameter).any() for parameter in effect.parameters):
        return "none of its parameters has a scale"
    return ""


def strengths(effect: Effect) -> list[Parameter]:
    """Parameters that switch an effect off at their neutral value, whatever the others are."""
    return [p for p in effect.parameters if not p.search and can_move(p).any()]


def can_move(parameter: Parameter) -> np.ndarray:
    """(k,) bool: which of its numbers are fitted."""
    moving: np.ndarray = _flat(_scale(parameter), parameter) > 0
    return moving


def kind_of(effect: Effect, parameter: Parameter) -> str:
    """How a parameter depends on its coordinate."""
    if parameter.coordinate is not None:
        return parameter.coordinate.transformation
    if not parameter.search or not can_move(parameter).any():
        return LINEAR
    infinite = not callable(parameter.neutral) and bool(np.isinf(np.asarray(parameter.neutral, float)).any())
    positive = bool(np.all(np.asarray(parameter.lower, float) > 0))
    if strengths(effect) and (infinite or positive):
        return LOGARITHM
    return INVERSE if infinite else LINEAR


def blocks(n: int, catalogue: Catalogue) -> tuple[Block, ...]:
    """Coordinates of all effects of a catalogue that are fitted in coordinates, for an arm with n joints."""
    return tuple(
        _block(effect, parameter, n)
        for effect in fitted_effects(catalogue)
        for parameter in effect.parameters
        if not _is_number(effect, parameter)
    )


def _is_number(effect: Effect, parameter: Parameter) -> bool:
    """Whether a parameter says which joint, and so has no coordinate."""
    return isinstance(effect.fit.search, ByJoint) and parameter.name == effect.fit.search.number


def _block(effect: Effect, parameter: Parameter, n: int) -> Block:
    size = n if isinstance(effect.fit.search, ByJoint) else int(np.prod(parameter.shape))
    least, most = (np.full(size, edge) for edge in (-np.inf, np.inf))
    kind, scale = kind_of(effect, parameter), _unit(parameter)
    lower, upper = limits_of(parameter)
    if kind == LOGARITHM:
        middle = _middle(parameter)
        with np.errstate(divide="ignore"):
            edges = (np.log(np.maximum(edge, 0) / middle) for edge in (lower, upper))
        least, most = (np.clip(edge, -MOST_LOGARITHM, MOST_LOGARITHM) for edge in edges)
    elif kind == INVERSE:
        least, most = scale / upper, np.where(lower > 0, scale / np.where(lower > 0, lower, 1), np.inf)
    elif _knows_zero(parameter):
        zero = _zero(parameter)
        least, most = (np.broadcast_to((edge - zero) / scale, size) for edge in (lower, upper))
    return Block(effect.name, parameter.name, size, least, most)


def values_at(effect: Effect, model: Model, coordinates: dict[str, Array], n: int = 0) -> EffectValues:
    """Values of an effect from its coordinates, never outside of what its entry calls plausible.

    Args:
        effect: of the catalogue.
        model: what the setup states.
        coordinates: (k,) of each parameter.
        n: joints of the arm; an effect of one joint gets them all, each with its offset.
    """
    neutral = neutral_values(effect, model)
    values = {}
    for parameter in effect.parameters:
        if _is_number(effect, parameter):
            values[parameter.name] = jnp.arange(1, n + 1).astype(neutral[parameter.name].dtype)
        else:
            values[parameter.name] = _value(effect, parameter, neutral[parameter.name], coordinates[parameter.name])
    return effect.fit.told(values, model) if effect.fit.told else values


def _value(effect: Effect, parameter: Parameter, neutral: Array, z: Array) -> Array:
    z = z if isinstance(effect.fit.search, ByJoint) else z.reshape(parameter.shape)
    unit = _shaped(_unit(parameter), parameter, z)
    match kind_of(effect, parameter):
        case "logarithm":
            value = _shaped(_middle(parameter), parameter, z) * jnp.exp(z)
        case "inverse":
            value = unit / jnp.maximum(z, SMALLEST_INVERSE)
        case _:
            stated = (parameter.coordinate or AS_STATED).zero
            value = (neutral if stated is None else stated) + unit * z
    lower, upper = (_shaped(edge, parameter, z) for edge in limits_of(parameter))
    # Not jnp.clip, whose derivative at a bound, where an effect of one sign begins, is half of that inside.
    return jnp.where(value < lower, lower, jnp.where(value > upper, upper, value))


def to_coordinates(
    effect: Effect, parameter: Parameter, neutral: np.ndarray | float, value: np.ndarray | float
) -> np.ndarray:
    """(k,) coordinates of a value; the other way than ``values_at``."""
    flat, unit = _flat(value, parameter), _unit(parameter)
    match kind_of(effect, parameter):
        case "logarithm":
            found = np.log(flat / _middle(parameter))
        case "inverse":
            found = unit / flat
        case _:
            zero = _zero(parameter) if _knows_zero(parameter) else _flat(neutral, parameter)
            found = (flat - zero) / unit
    return np.asarray(found, float)


def limits_of(parameter: Parameter) -> tuple[np.ndarray, np.ndarray]:
    """(k,), (k,): least and greatest plausible value."""
    given = parameter.coordinate or AS_STATED
    lower = parameter.lower if given.lower is None else given.lower
    upper = parameter.upper if given.upper is None else given.upper
    return _flat(lower, parameter), _flat(upper, parameter)


def _scale(parameter: Parameter) -> float | Array:
    given = (parameter.coordinate or AS_STATED).scale
    return parameter.scale if given is None else given


def _knows_zero(parameter: Parameter) -> bool:
    """Whether its value at coordinate 0 does not depend on what the setup states."""
    return (parameter.coordinate or AS_STATED).zero is not None or not callable(parameter.neutral)


def _zero(parameter: Parameter) -> np.ndarray:
    given = (parameter.coordinate or AS_STATED).zero
    return _flat(parameter.neutral if given is None else given, parameter)


def _flat(value: object, parameter: Parameter) -> np.ndarray:
    return np.broadcast_to(np.asarray(value, float), parameter.shape).ravel()


def _shaped(flat: np.ndarray, parameter: Parameter, z: Array) -> Array:
    return jnp.asarray(flat.reshape(parameter.shape), z.dtype)


def _unit(parameter: Parameter) -> np.ndarray:
    """(k,) of the parameter per coordinate; 1 for what is not fitted."""
    scale = _flat(_scale(parameter), parameter)
    return np.where(scale > 0, scale, 1.0)


def _middle(parameter: Parameter) -> np.ndarray:
    """(k,) value at coordinate 0 of a parameter that is taken by its logarithm."""
    if not callable(parameter.neutral):
        neutral = _flat(parameter.neutral, parameter)
        if np.all((neutral > 0) & np.isfinite(neutral)):
            return neutral
    return _unit(parameter)
