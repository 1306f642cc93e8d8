"""Catalogue of the built-in effects, in the order in which they act, and checks of their parameter values.

A new effect needs one entry at the position where it acts: simulator, fit, report and tests read this catalogue. Values
may also belong to a catalogue with user-defined effects beside the built-in ones.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from functools import partial
from typing import Any

import jax.numpy as jnp
import jax.tree_util
import numpy as np

from ftbias_jax.errors import FtbiasError, SetupError, UsageError
from ftbias_jax.model.effects import bias, environment, kinematics, sampling, sensor, tool
from ftbias_jax.model.effects.terms.parse import TERM, MakeError, parse_terms
from ftbias_jax.model.effects.types import Effect, EffectValues, Model, Parameter, Values
from ftbias_jax.setup.fields import nearest, show
from ftbias_jax.types import Array


class Catalogue(Mapping[str, Effect]):
    """Name -> effect, in the order in which they act; two catalogues are equal if they consist of the same entries."""

    def __init__(self, effects: Iterable[Effect], own: tuple[Effect, ...] = ()) -> None:
        self._entries = {effect.name: effect for effect in effects}
        self.own = own
        """The user-defined effects."""

    def __getitem__(self, name: str) -> Effect:
        return self._entries[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)

    def __repr__(self) -> str:
        """Names of the built-in effects, or the object's address if there are user-defined ones (equal by identity)."""
        return object.__repr__(self) if self.own else f"Catalogue({', '.join(self)})"

    # Entries are compared by identity, so functions compiled for one catalogue serve another with the same entries.

    def __hash__(self) -> int:
        return hash(tuple(map(id, self._entries.values())))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Catalogue) or len(self) != len(other):
            return False
        return all(mine is its for mine, its in zip(self.values(), other.values(), strict=True))

    def searched_by(self, *searches: type) -> tuple[Effect, ...]:
        """The entries whose fit uses one of these search classes of ``fitting``."""
        return tuple(effect for effect in self.values() if isinstance(effect.fit.search, searches))

    def adding(self, own: Iterable[Effect]) -> Catalogue:
        """The catalogue with further effects, each inserted after the first contiguous group of its stage."""
        own = tuple(own)
        entries = list(self.values())
        for effect in own:
            stages = [entry.stage for entry in entries]
            first = stages.index(effect.stage)
            after = next((i for i in range(first, len(stages)) if stages[i] != effect.stage), len(stages))
            entries.insert(after, effect)
        return Catalogue(entries, (*self.own, *own))


@jax.tree_util.register_pytree_node_class
class OwnValues(dict[str, EffectValues]):
    """Values of effects that include user-defined ones, together with the catalogue that defines them."""

    def __init__(self, values: Values, catalogue: Catalogue) -> None:
        super().__init__(values)
        self.catalogue = catalogue

    def tree_flatten(self) -> tuple[tuple[EffectValues, ...], tuple[tuple[str, ...], Catalogue]]:
        """Flatten for JAX: the values are the leaves, names and catalogue are static."""
        names = tuple(sorted(self))
        return tuple(self[name] for name in names), (names, self.catalogue)

    @classmethod
    def tree_unflatten(cls, known: tuple[tuple[str, ...], Catalogue], values: Iterable[EffectValues]) -> OwnValues:
        """Rebuild from the static part and the leaves."""
        names, catalogue = known
        return cls(dict(zip(names, values, strict=True)), catalogue)


CATALOGUE = Catalogue(
    (
        *tool.EFFECTS,
        *kinematics.EFFECTS,
        *environment.FLEXIBILITY,
        *environment.EFFECTS,
        *kinematics.MOUNTING,
        *sensor.EFFECTS,
        *bias.EFFECTS,
        *sensor.DELAY,
        *sampling.EFFECTS,
    )
)
"""The built-in effects in physical order, from those that act at the tool to those that act on single samples."""


def values_of(values: Values, catalogue: Catalogue) -> Values:
    """The values, bundled with the catalogue if the built-in one does not define all of their effects."""
    return dict(values) if all(name in CATALOGUE or name == TERM for name in values) else OwnValues(values, catalogue)


def catalogue_of(values: Values) -> Catalogue:
    """The catalogue that values belong to."""
    return values.catalogue if isinstance(values, OwnValues) else CATALOGUE


def neutral_values(effect: Effect, model: Model, events: int = 1) -> EffectValues:
    """Values at which the effect does nothing, for ``events`` events where a parameter's shape leaves it open."""
    return {parameter.name: _neutral(parameter, model, events) for parameter in effect.parameters}


def typical_values(effect: Effect, model: Model) -> EffectValues:
    """Values of typical size: neutral plus scale, and the scale itself where neutral is infinite."""

    def typical(parameter: Parameter) -> Array:
        neutral = _neutral(parameter, model, 1)
        return jnp.where(jnp.isfinite(neutral), neutral, 0) + jnp.asarray(parameter.scale, neutral.dtype)

    return {parameter.name: typical(parameter) for parameter in effect.parameters}


def complete(effect: Effect, values: EffectValues, model: Model) -> EffectValues:
    """The values with omitted parameters at neutral, all in the precision of the model."""
    dtype = model.theta.dtype
    given = {name: jnp.asarray(value, dtype) for name, value in values.items()}
    events = [given[p.name].shape[0] for p in effect.parameters if p.name in given and -1 in p.shape]
    return neutral_values(effect, model, events[0] if events else 1) | given


def check_values(
    raw: Mapping[str, Mapping[str, Any]],
    error: MakeError = SetupError,
    prefix: str = "",
    catalogue: Mapping[str, Effect] = CATALOGUE,
) -> Values:
    """Check numbers as read from a file or entered by a user against the catalogue.

    Args:
        raw: effect -> parameter -> number or (nested) list of numbers. One number stands for all six channels, two for
            three forces and three torques; lists of any length may be flat or nested.
        error: function that makes the error to raise.
        prefix: prefix of the field in messages.
        catalogue: name -> effect.

    Returns:
        float64 arrays of the catalogue's shapes, in the catalogue's order; optional parameters may be missing.
    """
    for name in raw:
        if name not in catalogue:
            remedy = nearest(name, catalogue)
            if remedy.startswith("known"):  # No known effect has a similar name.
                remedy = f"give the file that defines it by --effects; {remedy}"
            raise error(f"unknown effect {name!r}", field=f"{prefix}{name}", remedy=remedy)
    return {
        name: _check_effect(effect, raw[name], partial(_at, error, f"{prefix}{name}"))
        for name, effect in catalogue.items()
        if name in raw
    }


def check_names(names: Collection[str], field: str, catalogue: Catalogue = CATALOGUE) -> None:
    """Raise an error for names, stated in the given field, that are not in the catalogue.

    Raises:
        UsageError: an unknown effect.
    """
    for name in names:
        if name not in catalogue:
            raise UsageError(f"unknown effect {name!r}", field=field, remedy=nearest(name, catalogue))


def values_from_setup(effects: Mapping[str, Any], file: str = "", catalogue: Catalogue = CATALOGUE) -> Values:
    """Checked values of the ``[effects.NAME]`` and ``[[effects.term]]`` sections of a setup, from ``Setup.effects``.

    Raises:
        SetupError: an unknown effect or parameter, a wrong shape, a value out of bounds.
    """
    error = partial(SetupError, file=file)
    values = check_values({name: raw for name, raw in effects.items() if name != TERM}, error, "effects.", catalogue)
    return values | ({TERM: parse_terms(effects[TERM], error)} if TERM in effects else {})


def _at(error: MakeError, section: str, message: str, field: str = "", remedy: str = "") -> FtbiasError:
    return error(message, field=f"{section}.{field}" if field else section, remedy=remedy)


def _check_effect(effect: Effect, raw: Mapping[str, Any], error: MakeError) -> EffectValues:
    known = {parameter.name: parameter for parameter in effect.parameters}
    for key in raw:
        if key not in known:
            raise error("unknown key", field=key, remedy=nearest(key, known))
    for name, parameter in known.items():
        if name not in raw and not parameter.optional:
            raise error("missing key", field=name, remedy=f"give {_describe(parameter)}")
    values = {name: _check_parameter(parameter, raw[name], error) for name, parameter in known.items() if name in raw}
    _check_events(effect, values, error)
    return values


def _check_parameter(parameter: Parameter, raw: Any, error: MakeError) -> Array:
    remedy = f"give {_describe(parameter)}"
    try:
        value = np.asarray(raw)
        numeric = value.dtype.kind in "iuf"
    except ValueError:  # lists of unequal lengths
        numeric = False
    if not numeric:
        raise error(f"expected numbers, got {show(raw)}", field=parameter.name, remedy=remedy)
    shaped = _shape(parameter, value.astype(float))
    if shaped is None:
        raise error(f"has the wrong number of values: {show(raw)}", field=parameter.name, remedy=remedy)
    if not ((shaped >= parameter.lower) & (shaped <= parameter.upper)).all():  # NaN fails too
        raise error(f"got {show(raw)}", field=parameter.name, remedy=remedy)
    return shaped


def _shape(parameter: Parameter, value: Array) -> Array | None:
    """The value in the parameter's shape, or None if it has another number of values."""
    shape = parameter.shape
    if shape == (6,) and value.size in (1, 2) and value.ndim < 2:
        return np.repeat(value.ravel(), 6 // value.size)
    nested = value.ndim == len(shape) and all(want in (-1, have) for want, have in zip(shape, value.shape, strict=True))
    size = abs(int(np.prod(shape)))
    counted = value.size % size == 0 if -1 in shape else value.size == size
    flat = value.ndim < 2 and counted
    return value.reshape(shape) if value.size and (nested or flat) else None


def _check_events(effect: Effect, values: EffectValues, error: MakeError) -> None:
    lengths = {p.name: len(values[p.name]) for p in effect.parameters if p.name in values and -1 in p.shape}
    if len(set(lengths.values())) > 1:
        shown = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise error(f"different numbers of events: {shown}", remedy="give every event all parameters")
    message = effect.check(values) if effect.check else ""
    if message:
        raise error(message, remedy="correct the values")


def _describe(parameter: Parameter) -> str:
    """Description of a parameter in words: ``mass [kg], one number from 0.001 to 1000: mass of ...``."""
    shape = parameter.shape
    count = "x".join("n" if size == -1 else str(size) for size in shape)
    kind = f"{count} numbers" if shape else "one number"
    lower, upper = np.min(parameter.lower), np.max(parameter.upper)
    return f"{parameter.name} [{parameter.unit}], {kind} from {lower:g} to {upper:g}: {parameter.meaning}"


def _neutral(parameter: Parameter, model: Model, events: int) -> Array:
    value = parameter.neutral(model) if callable(parameter.neutral) else parameter.neutral
    shape = tuple(events if size == -1 else size for size in parameter.shape)
    return jnp.broadcast_to(jnp.asarray(value, model.theta.dtype), shape)
