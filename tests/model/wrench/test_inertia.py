"""Pseudo-inertia and log-Cholesky coordinates against bodies composed of point masses."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ftbias_jax.model.wrench import inertia
from ftbias_jax.model.wrench.tool_wrench import data_matrix, tool_parameters

COORDINATES = st.lists(st.floats(-1.5, 1.5), min_size=10, max_size=10)
UPPER = np.triu_indices(3)


def points(seed):
    """A body of a dozen point masses: (12,) kg and (12, 3) m."""
    rng = np.random.default_rng(seed)
    return rng.uniform(0.01, 0.2, 12), rng.normal([0.02, -0.03, 0.08], 0.04, (12, 3))


def parameters_of(masses, places):
    """(10,) inertial parameters by summing over the points."""
    tensor = sum(m * ((p @ p) * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, places, strict=True))
    return np.concatenate([[masses.sum()], masses @ places, tensor[UPPER]])


def test_pseudo_inertia_is_the_second_moment_of_homogeneous_coordinates():
    masses, places = points(0)
    homogeneous = np.concatenate([places, np.ones((12, 1))], 1)
    expected = np.einsum("p,pi,pj->ij", masses, homogeneous, homogeneous)
    theta = jnp.asarray(parameters_of(masses, places))
    np.testing.assert_allclose(inertia.pseudo_inertia(theta), expected, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(inertia.parameters_from_pseudo_inertia(expected), theta, rtol=1e-12, atol=1e-15)


def test_a_turned_body_is_the_body_of_its_turned_points():
    masses, places = points(1)
    R = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, 0.6, -0.8], [0, 0.8, 0.6]])
    found = inertia.turned(jnp.asarray(parameters_of(masses, places)), jnp.asarray(R))
    np.testing.assert_allclose(found, parameters_of(masses, places @ R.T), rtol=1e-12, atol=1e-15)


@given(COORDINATES)
def test_any_coordinates_are_a_body_that_can_exist(coordinates):
    """Positive mass and a positive definite second moment, so the inertia obeys the triangle inequalities."""
    theta = inertia.parameters_from_log_cholesky(jnp.array(coordinates))
    J = np.asarray(inertia.pseudo_inertia(theta))
    assert (np.linalg.eigvalsh(J) > 0).all()
    tensor = np.zeros((3, 3))
    tensor[UPPER] = np.asarray(inertia.about_center_of_mass(theta)[2])
    principal = np.linalg.eigvalsh(tensor + np.triu(tensor, 1).T)
    assert principal[0] + principal[1] > principal[2]


@given(COORDINATES)
def test_coordinates_and_bodies_are_one_to_one(coordinates):
    theta = inertia.parameters_from_log_cholesky(jnp.array(coordinates))
    back = inertia.log_cholesky_from_parameters(theta)
    np.testing.assert_allclose(back, coordinates, rtol=1e-6, atol=1e-6)


def test_every_direction_of_the_parameters_can_be_reached():
    theta = jnp.asarray(parameters_of(*points(1)))
    slope = jax.jacfwd(inertia.parameters_from_log_cholesky)(inertia.log_cholesky_from_parameters(theta))
    assert np.isfinite(slope).all()
    assert np.linalg.matrix_rank(slope) == 10


def test_about_the_centre_of_mass_is_what_a_data_sheet_says():
    masses, places = points(2)
    centre = masses @ places / masses.sum()
    mass, found, tensor = inertia.about_center_of_mass(jnp.asarray(parameters_of(masses, places)))
    np.testing.assert_allclose(mass, masses.sum())
    np.testing.assert_allclose(found, centre, rtol=1e-12)
    np.testing.assert_allclose(tensor, parameters_of(masses, places - centre)[4:], rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(tool_parameters(mass, found, tensor), parameters_of(masses, places), rtol=1e-12)


def test_spatial_inertia_is_the_wrench_of_unit_accelerations():
    theta = jnp.asarray(parameters_of(*points(3)))
    columns = [data_matrix(axis[:3], jnp.zeros(3), axis[3:]) @ theta for axis in jnp.eye(6)]
    np.testing.assert_allclose(inertia.spatial_inertia(theta), jnp.stack(columns, 1), rtol=1e-12, atol=1e-15)
