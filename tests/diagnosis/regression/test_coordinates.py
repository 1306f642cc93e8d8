"""Coordinates of effects that say themselves how they are fitted."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.diagnosis.regression import chain_model
from ftbias_jax.diagnosis.regression.coordinates import kind_of, own_blocks, own_effects, own_values, to_coordinates
from ftbias_jax.model.effects.types import Effect, Model, Parameter
from ftbias_jax.model.own_effects import catalogue_with

MODEL = Model(None, jnp.array([0, 0, -9.81]), jnp.ones(10))
SIZE = Parameter("size", "N", "", (3,), 0.0, 8.0, 0.0, [1.0, 2.0, 0.0])
INFINITE = float("inf")


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
    assert kind_of(effect, parameter) == kind
    (block, *_) = own_blocks(catalogue_with([effect]))
    lower = np.broadcast_to(parameter.lower, parameter.shape)
    for value in (lower + 0.3, lower + 2.0):
        z = to_coordinates(effect, parameter, np.broadcast_to(parameter.neutral, parameter.shape), value)
        assert ((z >= block.least) & (z <= block.most)).all()
        others_at = {other.name: jnp.zeros(3) for other in others}
        got = own_values(effect, MODEL, {parameter.name: jnp.asarray(z)} | others_at)[parameter.name]
        np.testing.assert_allclose(got, value, rtol=1e-5)


def test_zero_is_neutral_and_one_a_typical_departure():
    values = own_values(entry(SIZE), MODEL, {"size": jnp.zeros(3)})
    np.testing.assert_array_equal(values["size"], 0)
    values = own_values(entry(SIZE), MODEL, {"size": jnp.ones(3)})
    np.testing.assert_allclose(values["size"], [1, 2, 1])


def test_no_coordinate_gives_a_value_outside_of_the_bounds():
    for z in (-50.0, 50.0):
        values = own_values(entry(SIZE), MODEL, {"size": jnp.full(3, z)})
        assert float(values["size"].min()) >= 0
        assert float(values["size"].max()) <= 8


def test_at_a_bound_that_is_neutral_the_derivative_is_that_inside():
    """Half of it, as of jnp.clip, would have every one-sided effect begin at twice its size."""
    slope = jax.grad(lambda z: own_values(entry(SIZE), MODEL, {"size": z})["size"].sum())(jnp.zeros(3))
    np.testing.assert_allclose(slope, [1, 2, 1])


def test_own_coordinates_come_after_those_of_the_catalogue():
    catalogue = catalogue_with([entry(SIZE)])
    assert chain_model.size(7, catalogue) == chain_model.size(7) + 3
    assert chain_model.slices(7, catalogue)["own", "size"].start == chain_model.size(7)
    assert chain_model.slices(7).items() <= chain_model.slices(7, catalogue).items()
    least, most = chain_model.bounds(7, catalogue)
    np.testing.assert_allclose(least[-3:], 0)
    np.testing.assert_allclose(most[-3:], [8, 4, 8])


@pytest.mark.parametrize(
    "effect",
    [
        Effect("own", "sensor", (SIZE,), "", "", recording=lambda v, k, r: r),
        entry(SIZE._replace(shape=(-1, 3))),
        entry(SIZE._replace(scale=0.0)),
    ],
)
def test_what_cannot_be_fitted_has_no_coordinates(effect):
    catalogue = catalogue_with([effect])
    assert own_effects(catalogue) == []
    assert own_blocks(catalogue) == ()
