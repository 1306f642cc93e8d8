"""Coordinates of effects that state how they are fitted."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.diagnosis.regression.coordinates import (
    fitted_effects,
    layout,
    scale_of,
    to_coordinates,
    values_at,
)
from ftbias_jax.model.effects.catalogue import CATALOGUE, Catalogue, neutral_values
from ftbias_jax.model.effects.fitting import ByJoint
from ftbias_jax.model.effects.types import Effect, Model, Parameter, Signals
from ftbias_jax.model.own_effects import catalogue_with
from ftbias_jax.model.wrench.tool_wrench import tool_parameters

ARM = SimpleNamespace(linear=np.zeros((7, 3)))
MODEL = Model(None, jnp.array([0, 0, -9.81]), jnp.ones(10))
SIZE = Parameter("size", "N", "", (3,), 0.0, 8.0, 0.0, [1.0, 2.0, 0.0])
INFINITE = float("inf")
BOX_ON_A_ROD = tool_parameters(jnp.asarray(0.9), jnp.array([0.0, 0.01, 0.05]), jnp.array([1e-3, 0, 0, 1e-3, 0, 1e-3]))
BY_NUMBERS = [effect for effect in fitted_effects(CATALOGUE) if not isinstance(effect.fit.search, ByJoint)]


def entry(*parameters):
    return Effect("own", "sensor", parameters, "", "", reading=lambda v, s, w: w)


@pytest.mark.parametrize(
    ("parameter", "others", "kind"),
    [
        (SIZE, (), "linear"),
        (Parameter("tau", "s", "", (), 0.1, 10, 1.0, 1.0, search=True), (SIZE,), "logarithm"),
        (Parameter("tau", "s", "", (), 0.1, 10, 1.0, 1.0, search=True), (), "linear"),
        (Parameter("cutoff", "Hz", "", (), 0.1, INFINITE, INFINITE, 10.0, search=True), (), "inverse"),
        (Parameter("cutoff", "Hz", "", (), 0.1, INFINITE, INFINITE, 10.0, search=True), (SIZE,), "logarithm"),
        (Parameter("place", "m", "", (3,), -5, 5, 0.0, 0.3, search=True), (SIZE,), "linear"),
        (Parameter("joint", "1", "", (), 1, 7, 1.0, 0.0, search=True), (SIZE,), "linear"),
    ],
)
def test_values_come_back_from_their_coordinates(parameter, others, kind):
    effect = entry(parameter, *others)
    assert scale_of(effect, parameter).kind == kind
    whole = layout(7, Catalogue([effect]))
    own = whole.slices["own", parameter.name]
    lower = np.broadcast_to(parameter.lower, parameter.shape)
    for value in (lower + 0.3, lower + 2.0):
        z = to_coordinates(effect, parameter, np.broadcast_to(parameter.neutral, parameter.shape), value)
        assert ((z >= whole.least[own]) & (z <= whole.most[own])).all()
        others_at = {other.name: jnp.zeros(3) for other in others}
        got = values_at(effect, MODEL, {parameter.name: jnp.asarray(z)} | others_at)[parameter.name]
        np.testing.assert_allclose(got, value, rtol=1e-5)


@pytest.mark.parametrize(("z", "size"), [(0.0, [0, 0, 0]), (1.0, [1, 2, 1]), (-50.0, [0, 0, 0]), (50.0, [8, 8, 8])])
def test_zero_is_neutral_one_a_typical_departure_and_nothing_is_outside_of_the_bounds(z, size):
    values = values_at(entry(SIZE), MODEL, {"size": jnp.full(3, z)})
    np.testing.assert_allclose(values["size"], size)


def test_at_a_bound_that_is_neutral_the_derivative_is_that_inside():
    """Half the derivative, as of jnp.clip, would start every one-sided effect at twice its size."""
    slope = jax.grad(lambda z: values_at(entry(SIZE), MODEL, {"size": z})["size"].sum())(jnp.zeros(3))
    np.testing.assert_allclose(slope, [1, 2, 1])


def test_an_own_effect_has_its_coordinates_among_those_of_its_stage():
    catalogue = catalogue_with([entry(SIZE)])
    built_in, whole = layout(7), layout(7, catalogue)
    assert whole.size == built_in.size + 3
    place = whole.slices["own", "size"]
    np.testing.assert_allclose(whole.least[place], 0)
    np.testing.assert_allclose(whole.most[place], [8, 4, 8])
    np.testing.assert_array_equal(np.delete(whole.most, range(place.start, place.stop)), built_in.most)


@pytest.mark.parametrize("effect", BY_NUMBERS, ids=lambda effect: effect.name)
def test_built_in_values_come_back_from_their_coordinates(effect):
    """Values are within the entry's plausible range, at 0.7 typical departures from the coordinate 0."""
    model = Model(ARM, jnp.array([0, 0, -9.81]), BOX_ON_A_ROD)
    neutral = neutral_values(effect, model)
    z = {p.name: jnp.full(int(np.prod(p.shape)), 0.7) for p in effect.parameters}
    values = values_at(effect._replace(fit=effect.fit._replace(told=None)), model, z)
    for p in effect.parameters:
        _, _, _, lower, upper = scale_of(effect, p)
        free = lower < upper
        got = to_coordinates(effect, p, np.asarray(neutral[p.name]), np.asarray(values[p.name]))
        np.testing.assert_allclose(got[free], 0.7, rtol=1e-4)
        assert (np.ravel(values[p.name]) <= upper + 1e-6).all()


def test_gravity_is_told_with_the_size_that_is_stated():
    model = Model(ARM, jnp.array([0, 0, -9.81]), jnp.ones(10))
    told = values_at(CATALOGUE["gravity_tilt"], model, {"gravity": jnp.array([3.0, -2.0, 5.0])})["gravity"]
    assert float(jnp.linalg.norm(told)) == pytest.approx(9.81, rel=1e-5)
    assert float(told[0] / told[2]) == pytest.approx(0.3 / (-9.81 + 0.5), rel=1e-4)


def test_an_effect_of_one_joint_gets_all_joints_at_once():
    """Each joint has its own offset, and the joints move as if the offsets were applied one after the other."""
    effect = CATALOGUE["encoder_offset"]
    z = jnp.array([0.0, 2.0, -1.0])
    values = values_at(effect, Model(None, jnp.zeros(3), jnp.ones(10)), {"offset": z}, 3)
    np.testing.assert_array_equal(values["joint"], [1, 2, 3])
    states = jnp.zeros((5, 3))
    signals = Signals(jnp.arange(5.0), states, states, states, jnp.zeros(5), MODEL)
    moved = signals
    for joint, offset in enumerate(values["offset"], 1):
        moved = effect.transform({"joint": jnp.array(joint), "offset": offset}, moved)
    np.testing.assert_allclose(effect.transform(values, signals).q, moved.q, atol=1e-9)


@pytest.mark.parametrize(
    "effect",
    [
        Effect("own", "sensor", (SIZE,), "", "", recording=lambda v, k, r: r),
        entry(SIZE._replace(shape=(-1, 3))),
        entry(SIZE._replace(scale=0.0)),
    ],
)
def test_what_cannot_be_fitted_has_no_coordinates(effect):
    catalogue = Catalogue([effect])
    assert fitted_effects(catalogue) == []
    assert layout(7, catalogue).size == 0
