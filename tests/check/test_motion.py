"""Kinematics in NumPy agree with those of the model."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import small_checks

import ftbias_jax as ft
from ftbias_jax.check.motion import arm_motion, body_motion, data_matrices
from ftbias_jax.model.kinematics.recorded_pose import FreeBody
from ftbias_jax.model.kinematics.recorded_pose import motion_of as motion_of_model
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.model.wrench.tool_wrench import data_matrix


@pytest.fixture(scope="module")
def setup():
    return ft.parse_setup(small_checks.TABLES)


def test_motion_and_data_matrix_of_an_arm_are_those_of_the_model(setup):
    rng = np.random.default_rng(0)
    q, dq, ddq = rng.normal(size=(3, 4, 6))
    ours = arm_motion(setup.robot, setup.sensor, q, dq, ddq)
    D = data_matrices(ours, setup.robot.gravity)
    params = params_from_setup(setup, jnp.float64)

    def model(q, dq, ddq):
        motion = motion_of_model(params.arm, q, dq, ddq)
        down = motion.R_base_sensor.T
        force = down @ (motion.linear_acceleration - params.gravity)
        return motion, data_matrix(force, down @ motion.angular_velocity, down @ motion.angular_acceleration)

    motions, matrices = jax.jit(jax.vmap(model))(q, dq, ddq)
    np.testing.assert_allclose(ours.rotation, motions.R_base_sensor, atol=1e-12)
    np.testing.assert_allclose(ours.acceleration, motions.linear_acceleration, atol=1e-11)
    np.testing.assert_allclose(D, matrices, atol=1e-10)


def test_motion_of_a_recorded_pose_is_that_of_the_model(setup):
    rng = np.random.default_rng(1)
    q, dq, ddq = rng.normal(size=(3, 5, 7))
    lever = np.array([0.1, -0.2, 0.3])
    ours = body_motion(setup.sensor, lever, q, dq, ddq)
    body = FreeBody(jnp.asarray(lever), jnp.asarray(setup.sensor.rotation))
    theirs = jax.jit(jax.vmap(lambda q, dq, ddq: motion_of_model(body, q, dq, ddq)))(q, dq, ddq)
    np.testing.assert_allclose(ours.rotation, theirs.R_base_sensor, atol=1e-12)
    np.testing.assert_allclose(ours.velocity, theirs.angular_velocity, atol=1e-11)
    np.testing.assert_allclose(ours.turning, theirs.angular_acceleration, atol=1e-10)
    np.testing.assert_allclose(ours.acceleration, theirs.linear_acceleration, atol=1e-9)


def test_a_position_in_the_axes_of_the_body_is_turned_into_the_base(setup):
    """A body that spins about z at 2 rad/s around a point 0.5 m away has a constant position in its own axes."""
    t, rate = np.linspace(0, 1, 5), 2.0
    zero = np.zeros_like(t)
    half = rate * t / 2
    q = np.stack([np.cos(half), zero, zero, np.sin(half), zero + 0.5, zero, zero], 1)
    dq = np.stack([-np.sin(half), zero, zero, np.cos(half), zero, zero, zero], 1) * rate / 2
    ddq = np.stack([-np.cos(half), zero, zero, -np.sin(half), zero, zero, zero], 1) * (rate / 2) ** 2
    dq[:, 4:], ddq[:, 4:] = 0, 0
    motion = body_motion(setup.sensor, np.zeros(3), q, dq, ddq, in_body=True)
    inwards = -0.5 * rate**2 * np.stack([np.cos(rate * t), np.sin(rate * t), zero], 1)
    np.testing.assert_allclose(motion.acceleration, inwards, atol=1e-12)
