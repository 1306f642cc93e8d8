"""Parameters that a plan is to determine: the tool's ten inertial parameters, the noise, or those of an effect.

No effect is known here by name: its catalogue entry states which of its parameters can be fitted, and their scale.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ftbias_jax.calibration.tool.physical import NAMES, UNITS, data_sheet, tool_units
from ftbias_jax.calibration.tool.shown import LEAST_KNOWN
from ftbias_jax.diagnosis.regression.coordinates import can_move, scale_of, why_not_fitted
from ftbias_jax.errors import UsageError
from ftbias_jax.model.effects import compose
from ftbias_jax.model.effects.catalogue import Catalogue, check_names, complete, typical_values, values_of
from ftbias_jax.model.effects.fitting import INVERSE, LOGARITHM, ByJoint, Samples
from ftbias_jax.model.effects.types import Effect, EffectValues, Model, Parameter, Signals, Values
from ftbias_jax.model.wrench.tool_wrench import tool_parameters
from ftbias_jax.types import AXES, Array

TOOL = "tool"
"""Requests the tool's mass, centre of mass and inertia."""
NOISE = "noise"
"""Requests the noise of the readings at rest, and the noise that each joint's speed adds."""
POOR = 3.0
"""Standard error, in typical departures, above which a parameter or a combination of parameters is not determined."""

ROUNDING = 1e-12
STEP = 1e-4
"""Step of the central differences, in typical departures; their error is of second order in it."""
LOOSE = 0.3
"""Assumed error of the setup's inertia, as a share of the inertia that a tool of its mass can have."""
INERTIA = ("xx", "xy", "xz", "yy", "yz", "zz")
"""Labels of six numbers in kg m^2; six numbers of any other unit belong to the wrench axes."""


class Asked(NamedTuple):
    """The P parameters that one name requests."""

    name: str
    """TOOL, NOISE, or the name of an effect."""
    labels: tuple[str, ...]
    units: tuple[str, ...]
    at: np.ndarray
    """(P,) values at which the reading is linearised."""
    scale: np.ndarray
    """(P,) typical departures of the parameters."""
    base: np.ndarray
    """All numbers of the effect, including those that are never fitted; empty for the tool."""
    poor: float = POOR
    """Typical departures; a larger standard error means not determined; for the tool as in ``identify``."""


def asked_for(name: str, model: Model, catalogue: Catalogue, stated: Mapping[str, EffectValues]) -> Asked:
    """Return the parameters of the tool, of the noise or of an effect of the catalogue.

    Parameters of an effect that the setup or a diagnosis has not ``stated`` have typical values.

    Raises:
        UsageError: there is no such effect, or a mean reading does not depend on its parameters.
    """
    if name == TOOL:
        at = np.asarray(data_sheet(model.theta))
        scale = tool_units(at[0], at[[4, 7, 9]].max())
        scale[1:4] /= at[0]
        return Asked(TOOL, NAMES, UNITS, at, scale, np.zeros(0), LEAST_KNOWN)
    if name == NOISE:
        joints = range(model.arm.angular.shape[0])
        labels = (*(f"at_rest_{axis}" for axis in AXES), *(f"speed_of_joint_{j + 1}" for j in joints))
        zero = np.zeros(len(labels))
        return Asked(NOISE, labels, ("of itself",) * len(labels), zero, zero + 1, zero[:0])
    check_names([name], "for", catalogue)
    effect = catalogue[name]
    why = "it is read off single samples" if isinstance(effect.fit.search, Samples) else why_not_fitted(effect)
    if not why and any(-1 in parameter.shape for parameter in effect.parameters):
        why = "it happens when it happens"
    if why:
        raise UsageError(f"{name}: {why}", field="for", remedy="record longer, or plan for 'noise'")
    given = {**_typical(effect, model), **stated.get(name, {})}
    values = _for_all_joints(effect, complete(effect, given, model), model.arm.angular.shape[0])
    base = np.concatenate([np.ravel(values[parameter.name]) for parameter in effect.parameters])
    movable = _movable(effect, model.arm.angular.shape[0])
    numbers = [row for p in effect.parameters for row in _rows(effect, p, np.asarray(values[p.name]))]
    labels, units, sizes = zip(*(numbers[i] for i in movable), strict=True)
    return Asked(name, labels, units, base[movable], np.array(sizes), base)


def _typical(effect: Effect, model: Model) -> EffectValues:
    """Typical values of an effect's parameters; neutral values of those that are never fitted."""
    typical, neutral = typical_values(effect, model), complete(effect, {}, model)
    return {p.name: jnp.where(can_move(p).any(), typical[p.name], neutral[p.name]) for p in effect.parameters}


def _for_all_joints(effect: Effect, values: EffectValues, joints: int) -> EffectValues:
    """Expand the values of an effect of one joint to all joints, with zero offset for the others."""
    search = effect.fit.search
    if not isinstance(search, ByJoint):
        return values
    number, offset = np.ravel(values[search.number]), np.ravel(values[search.offset])
    offsets = np.zeros(joints)
    offsets[np.asarray(number, int) - 1] = offset
    return {search.number: np.arange(1.0, joints + 1), search.offset: offsets}


def _movable(effect: Effect, joints: int) -> np.ndarray:
    """Indices, among all numbers of an effect, of those that are fitted."""
    search, able = effect.fit.search, []
    for parameter in effect.parameters:
        count = joints if isinstance(search, ByJoint) else int(np.prod(parameter.shape))
        is_number = isinstance(search, ByJoint) and parameter.name == search.number
        able.append(np.broadcast_to(can_move(parameter) & (not is_number), count))
    return np.flatnonzero(np.concatenate(able))


def _rows(effect: Effect, parameter: Parameter, values: np.ndarray) -> list[tuple[str, str, float]]:
    """Label, unit and typical departure from these values for each number of a parameter."""
    _, _, unit, *_ = scale = scale_of(effect, parameter)
    at = np.ravel(values)
    size = {LOGARITHM: np.abs(at), INVERSE: at**2 / np.where(unit > 0, unit, 1)}.get(scale.kind, unit)
    axes: dict[tuple[int, ...], tuple[str, ...]] = {(): ("",), (3,): ("_x", "_y", "_z")}
    axes[(6,)] = tuple(f"_{axis}" for axis in (INERTIA if parameter.unit == "kg m^2" else AXES))
    by_number = tuple("_" + ",".join(str(i + 1) for i in index) for index in np.ndindex(np.shape(values)))
    # Six joints are not the six axes of a wrench.
    labels = by_number if isinstance(effect.fit.search, ByJoint) else axes.get(np.shape(values), by_number)
    sizes = np.broadcast_to(size, at.shape).tolist()
    return [(parameter.name + label, parameter.unit, one) for label, one in zip(labels, sizes, strict=True)]


def reading(
    signals: Signals, known: Values, base: Array, x: Float[Array, " P"], name: str, catalogue: Catalogue
) -> Float[Array, "U 6"]:
    """Predict the reading, (U, 6) N, Nm, for values x (P,) of the requested parameters.

    ``base`` holds all numbers of the effect, as in ``Asked``; ``known`` are further effects that the setup states.
    """
    if name == TOOL:
        model = signals.model._replace(theta=tool_parameters(x[0], x[1:4], x[4:]))
        return compose.predict(signals._replace(model=model), known, catalogue)
    values = _values(catalogue[name], base, x, signals.q.shape[1])
    return compose.predict(signals, values_of({**known, name: values}, catalogue), catalogue)


def _values(effect: Effect, base: Array, x: Array, joints: int) -> EffectValues:
    """Assemble the parameters of an effect from all its numbers and the requested ones (P,)."""
    numbers, values, first = jnp.asarray(base).at[_movable(effect, joints)].set(x), {}, 0
    for parameter in effect.parameters:
        shape = (joints,) if isinstance(effect.fit.search, ByJoint) else parameter.shape
        count = int(np.prod(shape))
        values[parameter.name] = numbers[first : first + count].reshape(shape)
        first += count
    return values


def inertia_std(asked: Sequence[Asked], model: Model, catalogue: Catalogue) -> np.ndarray:
    """(6,) kg m^2: standard deviation assumed for the setup's inertia when two effects are to be distinguished.

    Inertias are rarely measured. If they counted as known, an equal gain of all channels would be distinguishable from
    a heavier tool by the inertia that does not grow with it. An inertia that is all an effect changes counts as known:
    zeros.
    """
    still = jnp.zeros((1, model.arm.angular.shape[0]))
    at_rest = Signals(jnp.zeros(1), still, still, still, jnp.zeros(1), model)
    for one in asked:
        values = {one.name: _values(catalogue[one.name], one.base, jnp.asarray(one.at), still.shape[1])}
        changed = compose.transform(at_rest, values_of(values, catalogue), catalogue).model.theta - model.theta
        mass_and_center, inertia = jnp.split(jnp.abs(changed) > ROUNDING * jnp.abs(model.theta).max(), [4])
        if inertia.any() and not mass_and_center.any():
            return np.zeros(6)
    return LOOSE * tool_units(float(model.theta[0]))[4:]


def columns(signals: Signals, known: Values, numbers: Any, names: tuple[str, ...], catalogue: Catalogue) -> Array:
    """(C, U, 6): for one name the derivatives of the reading; for two, what distinguishes each from the other.

    For two names these are, for each in turn, the difference between the reading with its effect and that with the
    other one at the closest values, and the derivatives with respect to those values; finally the changes due to the
    tool's inertia (6,), per standard deviation. ``numbers`` is as in ``climb.Task``.

    Central differences replace derivatives in float64: the search differentiates through them in reverse mode, and its
    program compiles in half the time.
    """

    def seen(name: str, base: Array, scale: Array, *at: Array) -> tuple[Array, Array]:
        """Readings at all values, and derivatives (P, U, 6) at the last ones."""
        steps = STEP * jnp.diag(scale)
        values = jnp.concatenate([jnp.stack(at), at[-1][None] + steps, at[-1][None] - steps])
        readings = jax.lax.map(lambda x: reading(signals, known, base, x, name, catalogue), values)
        plain, above, below = jnp.split(readings, [len(at), len(at) + len(scale)])
        return plain, (above - below) / (2 * STEP * scale)[:, None, None]

    if len(names) == 1:
        return seen(names[0], *numbers[0])[1]
    (one, by_one), (two, by_two) = (seen(name, *numbers[i]) for i, name in enumerate(names))
    sheet = data_sheet(signals.model.theta)

    def with_inertia(share: Array) -> Array:
        return reading(signals, known, sheet[:0], sheet.at[4:].add(share * numbers[2]), TOOL, catalogue)

    by_inertia = jnp.moveaxis(jax.jacfwd(with_inertia)(jnp.zeros_like(sheet[4:])), -1, 0)
    return jnp.concatenate([one[:1] - two[1:], by_two, two[:1] - one[1:], by_one, by_inertia])
