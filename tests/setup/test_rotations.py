"""Rotations as angles and vectors, and back, at the places where they are singular."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ftbias_jax.setup.rotations import (
    rotation_from_rpy,
    rotation_from_vector,
    rpy_from_rotation,
    skew,
    vector_from_rotation,
)

vectors = st.tuples(*[st.floats(-1, 1)] * 3).map(np.array).filter(lambda v: np.linalg.norm(v) > 1e-3)


@given(vectors, st.sampled_from([0.0, 1e-12, 1e-5, 0.7, 3.0, np.pi - 1e-9]))
def test_vectors_come_back_from_their_rotation(axis, angle):
    vector = angle * axis / np.linalg.norm(axis)
    rotation = rotation_from_vector(vector)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(vector_from_rotation(rotation), vector, atol=1e-8)


@pytest.mark.parametrize("degrees", [200.0, -1607.0, 360.0])
def test_angles_beyond_half_a_turn_are_wrapped(degrees):
    vector = np.radians([0.0, 0.0, degrees])
    wrapped = vector_from_rotation(rotation_from_vector(vector))
    assert np.linalg.norm(wrapped) <= np.pi
    np.testing.assert_allclose(wrapped[2], (vector[2] + np.pi) % (2 * np.pi) - np.pi, atol=1e-9)
    rpy = rpy_from_rotation(rotation_from_rpy(vector))
    np.testing.assert_allclose(rpy[2], wrapped[2], atol=1e-9)


def test_half_a_turn_is_plus_pi():
    half = np.diag([-1.0, -1.0, 1.0])
    half[1, 0] = -0.0
    assert rpy_from_rotation(half)[2] == np.pi


def test_skew_is_the_cross_product_of_each_vector():
    v, w = np.random.default_rng(0).normal(size=(2, 5, 3))
    np.testing.assert_allclose(np.einsum("nij,nj->ni", skew(v), w), np.cross(v, w))
