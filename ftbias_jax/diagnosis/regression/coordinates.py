"""Coordinates of effects that state themselves how they are fitted: 0 is neutral or a typical value, 1 a departure.

A parameter has one coordinate for each of its numbers. Where the effect has other parameters that switch it off, a
positive parameter that needs a search is taken by its logarithm; one whose neutral is infinite by its inverse.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from ftbias_jax.model.effects.catalogue import CATALOGUE, neutral_values
from ftbias_jax.model.effects.table import Catalogue
from ftbias_jax.model.effects.types import Effect, EffectValues, Model, Parameter
from ftbias_jax.types import Array

LINEAR, LOGARITHM, INVERSE = "linear", "logarithm", "inverse"
SMALLEST_INVERSE = 1e-6
"""Of the coordinate: a value this many times larger than its scale counts as infinite."""
MOST_LOGARITHM = 12.0
"""A factor of 160,000 from the typical value either way."""


class Block(NamedTuple):
    """Coordinates of one effect within the whole vector; 0 is neutral and 1 a typical departure."""

    effect: str
    parameter: str
    size: int
    unit: float | np.ndarray
    """Of the parameter, per coordinate."""
    least: float | np.ndarray = -np.inf
    most: float | np.ndarray = np.inf
    """Bounds of the coordinates."""


def own_effects(catalogue: Catalogue) -> list[Effect]:
    """The effects of a catalogue that are fitted by what they say of themselves."""
    return [effect for effect in catalogue.values() if effect.name not in CATALOGUE and not why_not_fitted(effect)]


def why_not_fitted(effect: Effect) -> str:
    """Why an effect is not looked for, in words; "" = it is."""
    if effect.hook == "record":
        return "it acts on single samples, and only effects on the mean reading are looked for"
    if any(-1 in parameter.shape for parameter in effect.parameters):
        return "it has events, whose number is not known"
    if not any(np.any(np.asarray(parameter.scale, float) > 0) for parameter in effect.parameters):
        return "none of its parameters has a scale"
    return ""


def strengths(effect: Effect) -> list[Parameter]:
    """Parameters that switch an effect off at their neutral value, whatever the others are."""
    return [p for p in effect.parameters if not p.search and np.any(np.asarray(p.scale, float) > 0)]


def kind_of(effect: Effect, parameter: Parameter) -> str:
    """How a parameter depends on its coordinate."""
    if not parameter.search or not np.any(np.asarray(parameter.scale, float) > 0):
        return LINEAR
    infinite = not callable(parameter.neutral) and bool(np.isinf(np.asarray(parameter.neutral, float)).any())
    positive = bool(np.all(np.asarray(parameter.lower, float) > 0))
    if strengths(effect) and (infinite or positive):
        return LOGARITHM
    return INVERSE if infinite else LINEAR


def own_blocks(catalogue: Catalogue) -> tuple[Block, ...]:
    """Coordinates of all own effects of a catalogue."""
    return tuple(_block(effect, parameter) for effect in own_effects(catalogue) for parameter in effect.parameters)


def _block(effect: Effect, parameter: Parameter) -> Block:
    size = int(np.prod(parameter.shape))
    least, most = (np.full(size, edge) for edge in (-np.inf, np.inf))
    kind, scale = kind_of(effect, parameter), _unit(parameter)
    lower, upper = (_flat(edge, parameter) for edge in (parameter.lower, parameter.upper))
    if kind == LOGARITHM:
        middle = _middle(parameter)
        with np.errstate(divide="ignore"):
            edges = (np.log(np.maximum(edge, 0) / middle) for edge in (lower, upper))
        least, most = (np.clip(edge, -MOST_LOGARITHM, MOST_LOGARITHM) for edge in edges)
    elif kind == INVERSE:
        with np.errstate(divide="ignore"):
            least, most = np.zeros(size), np.where(lower > 0, scale / np.where(lower > 0, lower, 1), np.inf)
    elif not callable(parameter.neutral):
        neutral = _flat(parameter.neutral, parameter)
        least, most = (lower - neutral) / scale, (upper - neutral) / scale
    return Block(effect.name, parameter.name, size, 1.0, least, most)


def own_values(effect: Effect, model: Model, coordinates: dict[str, Array]) -> EffectValues:
    """Values of an effect from its coordinates, never outside of the catalogue's bounds.

    Args:
        effect: an own one.
        model: what the setup states.
        coordinates: (k,) of each parameter.
    """
    neutral = neutral_values(effect, model)
    return {
        parameter.name: _value(effect, parameter, neutral[parameter.name], coordinates[parameter.name])
        for parameter in effect.parameters
    }


def _value(effect: Effect, parameter: Parameter, neutral: Array, z: Array) -> Array:
    z = z.reshape(parameter.shape)
    unit = jnp.asarray(_unit(parameter).reshape(parameter.shape), z.dtype)
    match kind_of(effect, parameter):
        case "logarithm":
            value = jnp.asarray(_middle(parameter).reshape(parameter.shape), z.dtype) * jnp.exp(z)
        case "inverse":
            value = unit / jnp.maximum(z, SMALLEST_INVERSE)
        case _:
            value = neutral + unit * z
    # Not jnp.clip, whose derivative at a bound, where an effect of one sign begins, is half of that inside.
    return jnp.where(
        value < parameter.lower, parameter.lower, jnp.where(value > parameter.upper, parameter.upper, value)
    )


def to_coordinates(effect: Effect, parameter: Parameter, neutral: np.ndarray, value: np.ndarray) -> np.ndarray:
    """(k,) coordinates of a value; the other way than ``own_values``."""
    flat, unit = _flat(value, parameter), _unit(parameter)
    match kind_of(effect, parameter):
        case "logarithm":
            found = np.log(flat / _middle(parameter))
        case "inverse":
            found = unit / flat
        case _:
            found = (flat - np.asarray(neutral, float).ravel()) / unit
    return np.asarray(found, float)


def _flat(value: object, parameter: Parameter) -> np.ndarray:
    return np.broadcast_to(np.asarray(value, float), parameter.shape).ravel()


def _unit(parameter: Parameter) -> np.ndarray:
    """(k,) of the parameter per coordinate; 1 for what is not fitted."""
    scale = _flat(parameter.scale, parameter)
    return np.where(scale > 0, scale, 1.0)


def _middle(parameter: Parameter) -> np.ndarray:
    """(k,) value at coordinate 0 of a parameter that is taken by its logarithm."""
    if not callable(parameter.neutral):
        neutral = _flat(parameter.neutral, parameter)
        if np.all((neutral > 0) & np.isfinite(neutral)):
            return neutral
    return _unit(parameter)
