"""Fit coordinates of the effects in the catalogue: 0 is neutral or a typical value, 1 a typical departure.

A parameter has one coordinate for each of its numbers; an offset of one joint has one for each joint. An entry may
state how its parameter follows from them (``fitting.Coordinate``). Otherwise a searched parameter that is positive, or
whose neutral value is infinite, has a logarithmic coordinate if other parameters switch the effect off, and an inverse
one if its neutral value is infinite and none does; all others are linear.
"""

from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from ftbias_jax.model.effects.catalogue import CATALOGUE, Catalogue, neutral_values
from ftbias_jax.model.effects.fitting import BY_COORDINATES, INVERSE, LINEAR, LOGARITHM, ByJoint, Coordinate, Samples
from ftbias_jax.model.effects.types import Effect, EffectValues, Model, Parameter
from ftbias_jax.types import Array

SMALLEST_INVERSE = 1e-6
"""Least inverse coordinate: a value larger than its scale by the reciprocal of this counts as infinite."""
MOST_LOGARITHM = 12.0
"""Largest logarithmic coordinate: a factor of 160,000 from the typical value either way."""
AS_STATED = Coordinate()
LAYOUTS = 16
"""Number of pairs of joint count and catalogue whose coordinates are cached."""


class Scale(NamedTuple):
    """How a parameter depends on its k coordinates."""

    kind: str
    """``linear``, ``logarithm`` or ``inverse``."""
    zero: np.ndarray | None
    """(k,) value at coordinate 0; None = neutral, which depends on what the setup states."""
    unit: np.ndarray
    """(k,) change of the parameter per coordinate; 1 for numbers that are not fitted."""
    lower: np.ndarray
    """(k,) least plausible value."""
    upper: np.ndarray


class Layout(NamedTuple):
    """Positions of the coordinates of a catalogue's effects in one vector (P,)."""

    slices: Mapping[tuple[str, str], slice]
    """(effect, parameter) -> slice of its coordinates."""
    least: np.ndarray
    """(P,) lower bounds of the coordinates; ``most`` holds the upper bounds."""
    most: np.ndarray
    of_joints: np.ndarray
    """Indices of the coordinates that change only the motion of the arm, from which all else is computed."""

    @property
    def size(self) -> int:
        """Number of coordinates P."""
        return len(self.least)

    def of_effect(self, effect: str) -> np.ndarray:
        """Indices of all coordinates of an effect."""
        own = [np.arange(s.start, s.stop) for (name, _), s in self.slices.items() if name == effect]
        return np.concatenate([np.zeros(0, int), *own])


@lru_cache(LAYOUTS)
def layout(n: int, catalogue: Catalogue = CATALOGUE) -> Layout:
    """Coordinates of all effects that are fitted in them, for an arm with n joints, in the catalogue's order."""
    slices: dict[tuple[str, str], slice] = {}
    bounds = [np.zeros((2, 0))]
    for effect in fitted_effects(catalogue):
        by_joint = isinstance(effect.fit.search, ByJoint)
        for parameter in (p for p in effect.parameters if not _is_number(effect, p)):
            size = n if by_joint else int(np.prod(parameter.shape))
            start = sum(pair.shape[1] for pair in bounds)
            slices[effect.name, parameter.name] = slice(start, start + size)
            bounds.append(np.stack([np.broadcast_to(edge, size) for edge in bounds_of(scale_of(effect, parameter))]))
    least, most = np.concatenate(bounds, 1)
    whole = Layout(slices, least, most, np.zeros(0, int))
    joints = [whole.of_effect(effect.name) for effect in catalogue.searched_by(ByJoint)]
    return whole._replace(of_joints=np.concatenate([whole.of_joints, *joints]))


def bounds_of(scale: Scale) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper bounds of the coordinates."""
    kind, zero, unit, lower, upper = scale
    if kind == LOGARITHM:
        with np.errstate(divide="ignore"):
            least, most = (np.log(np.maximum(edge, 0) / zero) for edge in (lower, upper))
        return np.clip(least, -MOST_LOGARITHM, MOST_LOGARITHM), np.clip(most, -MOST_LOGARITHM, MOST_LOGARITHM)
    if kind == INVERSE:
        return unit / upper, np.where(lower > 0, unit / np.where(lower > 0, lower, 1), np.inf)
    if zero is None:
        return np.full_like(unit, -np.inf), np.full_like(unit, np.inf)
    return (lower - zero) / unit, (upper - zero) / unit


def fitted_effects(catalogue: Catalogue) -> list[Effect]:
    """The effects of a catalogue that are fitted in coordinates."""
    return [effect for effect in catalogue.searched_by(*BY_COORDINATES) if not why_not_fitted(effect)]


def why_not_fitted(effect: Effect) -> str:
    """Why an effect is not searched for, in words; "" = it is."""
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


def is_moment(parameter: Parameter, seconds: float) -> bool:
    """Whether a parameter is a point in time of a log of this many seconds: a searched time from 0 to the log's end."""
    searched = parameter.search and parameter.unit == "s" and not parameter.shape and bool(can_move(parameter).any())
    return searched and not parameter.starts and bool(np.all(parameter.lower <= 0 and parameter.upper >= seconds))


def can_move(parameter: Parameter) -> np.ndarray:
    """(k,) bool: which numbers of a parameter are fitted."""
    given = (parameter.coordinate or AS_STATED).scale
    return _flat(parameter.scale if given is None else given, parameter) > 0


def scale_of(effect: Effect, parameter: Parameter) -> Scale:
    """How a parameter of an effect depends on its coordinates."""
    given, neutral = parameter.coordinate or AS_STATED, parameter.neutral
    scale, zero, lower, upper = (
        stated if own is None else own
        for own, stated in (
            (given.scale, parameter.scale),
            (given.zero, neutral),
            (given.lower, parameter.lower),
            (given.upper, parameter.upper),
        )
    )
    unit, at = _flat(scale, parameter), None if callable(zero) else _flat(zero, parameter)
    kind, unit = given.transformation, np.where(unit > 0, unit, 1.0)
    if parameter.coordinate is None and parameter.search and can_move(parameter).any():
        infinite = at is not None and bool(np.isinf(at).any())
        positive = bool(np.all(np.asarray(parameter.lower, float) > 0))
        kind = LOGARITHM if strengths(effect) and (infinite or positive) else INVERSE if infinite else LINEAR
    if kind == LOGARITHM and (at is None or not np.all((at > 0) & np.isfinite(at))):
        at = unit
    return Scale(kind, at, unit, _flat(lower, parameter), _flat(upper, parameter))


def _is_number(effect: Effect, parameter: Parameter) -> bool:
    """Whether a parameter is the number of the joint, which has no coordinate."""
    return isinstance(effect.fit.search, ByJoint) and parameter.name == effect.fit.search.number


def values_at(effect: Effect, model: Model, coordinates: dict[str, Array], n: int = 0) -> EffectValues:
    """Values of an effect from its coordinates, clipped to what its entry states as plausible.

    An effect of one joint gets all n joints of the arm, each with its own offset.
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
    scale = scale_of(effect, parameter)
    unit, lower, upper = (jnp.asarray(x.reshape(parameter.shape), z.dtype) for x in scale[2:])
    zero = neutral if scale.zero is None else jnp.asarray(scale.zero.reshape(parameter.shape), z.dtype)
    match scale.kind:
        case "logarithm":
            value = zero * jnp.exp(z)
        case "inverse":
            value = unit / jnp.maximum(z, SMALLEST_INVERSE)
        case _:
            value = zero + unit * z
    # Not jnp.clip: its derivative at a bound, where an effect of one sign begins, is half of that inside.
    return jnp.where(value < lower, lower, jnp.where(value > upper, upper, value))


def to_coordinates(
    effect: Effect, parameter: Parameter, neutral: np.ndarray | float, value: np.ndarray | float
) -> np.ndarray:
    """(k,) coordinates of a value: the inverse of ``values_at``."""
    flat, scale = _flat(value, parameter), scale_of(effect, parameter)
    zero = _flat(neutral, parameter) if scale.zero is None else scale.zero
    match scale.kind:
        case "logarithm":
            return np.asarray(np.log(flat / zero))
        case "inverse":
            return np.asarray(scale.unit / flat)
        case _:
            return np.asarray((flat - zero) / scale.unit)


def _flat(value: object, parameter: Parameter) -> np.ndarray:
    return np.broadcast_to(np.asarray(value, float), parameter.shape).ravel()
