"""Physically possible tools: coordinates that leave single parameters unchanged, and quadratic costs over them."""

import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.calibration.tool import physical
from ftbias_jax.calibration.tool.physical import Quadratic
from ftbias_jax.filtering.innovation_regression import Prior
from ftbias_jax.model.wrench.inertia import pseudo_inertia

SHEET = np.array([0.9, 0.01, -0.02, 0.06, 0.004, 2e-4, -1e-4, 0.005, 3e-4, 0.003])
X = physical.coordinates(jnp.asarray(physical.theta_of(SHEET)))


def sheet(x):
    return np.asarray(physical.data_sheet(physical.physical(jnp.asarray(x))[:10]))


def test_coordinates_are_of_the_data_sheet_and_those_of_the_inertia_leave_the_weight_alone():
    """A point mass is given a volume."""
    np.testing.assert_allclose(sheet(X), SHEET, rtol=1e-9)
    moved = X.copy()
    moved[physical.OF_INERTIA] += 0.1
    np.testing.assert_allclose(sheet(moved)[:4], SHEET[:4], rtol=1e-12)
    x = physical.coordinates(jnp.asarray(physical.theta_of(np.r_[SHEET[:4], np.zeros(6)])))
    np.testing.assert_allclose(sheet(x)[:4], SHEET[:4])
    np.testing.assert_allclose(sheet(x)[[4, 7, 9]], 0.4 * 0.9 * physical.RADIUS**2)


@pytest.mark.parametrize("name", physical.COORDINATE)
def test_each_of_these_coordinates_is_one_parameter_alone(name):
    moved = X.copy()
    moved[physical.COORDINATE[name]] += 0.1
    changed = np.abs(sheet(moved) - SHEET) > 1e-12
    row = physical.NAMES.index(name)
    assert changed[row]
    others = np.delete(changed[:4], row)
    assert not others.any()
    assert not changed[4:].any() or name == "mass"  # the inertia per kg stays


def test_costs_add_up_and_scale():
    rng = np.random.default_rng(0)
    parts = [Quadratic(X, rng.normal(size=10), np.eye(10) * k, float(k)) for k in (1, 2, 3)]
    z = X + rng.normal(size=10)
    np.testing.assert_allclose(physical.total(parts)(z), sum(part(z) for part in parts))
    np.testing.assert_allclose(parts[1].scaled(0.25)(z), parts[1](z) / 4)


def test_the_most_likely_tool_is_the_unconstrained_one_where_that_can_exist():
    start, wide = np.asarray(physical.physical(jnp.asarray(X))), Prior(X, np.full(10, 1e3))
    goal = np.asarray(physical.theta_of(SHEET * 1.2))
    information = np.diag(1e4 / np.square(physical.tool_units(0.9)))
    cost = Quadratic(start, information @ (start - goal), information, 0.0)
    found = np.asarray(physical.physical(jnp.asarray(physical.most_likely(cost, X, wide))))
    np.testing.assert_allclose(found, goal, atol=1e-5)


def test_a_pull_to_a_body_that_cannot_exist_ends_at_one_that_can():
    start = np.asarray(physical.physical(jnp.asarray(X)))
    goal = start - [0, 0, 0, 0, 1, 0, 0, 0, 0, 0]  # Ixx of -1 kg m^2
    information = np.diag(1e2 / np.square(physical.tool_units(0.9)))
    cost = Quadratic(start, information @ (start - goal), information, 0.0)
    found = physical.most_likely(cost, X, Prior(X, physical.PRIOR_STD))
    theta = physical.physical(jnp.asarray(found))
    assert (np.linalg.eigvalsh(pseudo_inertia(theta)) > 0).all()
    assert cost(np.asarray(theta)) < cost(start)
