"""Built-in robots and screws; rotations as angles and vectors, and back, at the places where they are singular."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ftbias_jax.setup.robots import built_in_robot, prismatic_screw, revolute_screw
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


# The seven screws as the report prints them (linear; angular).
REPORT_SCREWS = [
    [0, 0, 0, 0, 0, 1],
    [-0.333, 0, 0, 0, 1, 0],
    [0, 0, 0, 0, 0, 1],
    [0.649, 0, -0.0825, 0, -1, 0],
    [0, 0, 0, 0, 0, 1],
    [1.033, 0, 0, 0, -1, 0],
    [0, 0.088, 0, 0, 0, -1],
]


@pytest.mark.parametrize("model", ["panda", "fr3"])
def test_built_in_robots_have_the_screws_and_flange_of_the_report(model):
    robot = built_in_robot(model)
    np.testing.assert_array_equal(robot.screws, REPORT_SCREWS)
    np.testing.assert_allclose(robot.flange_translation, [0.088, 0, 0.819], rtol=1e-15)
    np.testing.assert_array_equal(robot.flange_rotation, np.diag([1, -1, -1]))
    assert robot.joint_names == tuple(f"{model}_joint{i}" for i in range(1, 8))
    assert robot.model == model


def test_unknown_robot():
    with pytest.raises(KeyError, match="ur6"):
        built_in_robot("ur6")


def test_screws_are_the_velocity_at_the_origin_and_the_turn():
    axis, point = np.array([0.6, 0.0, 0.8]), np.array([0.1, -0.2, 0.3])
    screw = revolute_screw(axis, point)
    np.testing.assert_allclose(screw[:3] + np.cross(screw[3:], point), 0, atol=1e-16)  # the axis itself does not move
    np.testing.assert_array_equal(screw[3:], axis)
    np.testing.assert_array_equal(prismatic_screw(axis), [0.6, 0, 0.8, 0, 0, 0])


def test_rpy_turns_about_the_fixed_x_then_y_then_z():
    roll = rotation_from_rpy([0.3, 0, 0])
    pitch = rotation_from_rpy([0, 0.5, 0])
    yaw = rotation_from_rpy([0, 0, 0.7])
    np.testing.assert_allclose(rotation_from_rpy([np.pi / 2, 0, 0]) @ [0, 1, 0], [0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(rotation_from_rpy([0, np.pi / 2, 0]) @ [0, 0, 1], [1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(rotation_from_rpy([0, 0, np.pi / 2]) @ [1, 0, 0], [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(rotation_from_rpy([0.3, 0.5, 0.7]), yaw @ pitch @ roll, rtol=1e-14)


angles = st.floats(-7, 7)


@given(angles, angles | st.sampled_from([np.pi / 2, -np.pi / 2, np.pi / 2 - 1e-9, 1.5707963]), angles)
def test_rpy_of_a_rotation_gives_it_back_at_any_pitch(roll, pitch, yaw):
    rotation = rotation_from_rpy([roll, pitch, yaw])
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(rotation_from_rpy(rpy_from_rotation(rotation)), rotation, atol=2e-15)
