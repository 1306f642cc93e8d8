"""How the sensor moves, as effects see it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.model.kinematics.recorded_pose import FreeBody, motions_of, path_of
from ftbias_jax.model.kinematics.screws import make_arm, sensor_motion

RNG = np.random.default_rng(2)


@pytest.fixture(scope="module")
def joints():
    return tuple(jnp.asarray(RNG.normal(size=(5, 3))) for _ in range(3))


def test_the_path_of_an_arm_is_that_of_single_samples(joints):
    """With a prismatic joint among the revolute ones."""
    axes = RNG.normal(size=(3, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    screws = np.concatenate([-np.cross(axes, RNG.normal(size=(3, 3))), axes], 1)
    screws[1] = np.r_[axes[1], 0, 0, 0]
    arm = make_arm(jnp.asarray(screws), jnp.array([0.1, 0.2, 0.7]), jnp.eye(3))
    path = path_of(motions_of(arm, *(x.T for x in joints)))
    for i in range(5):
        motion = sensor_motion(arm, *(x[i] for x in joints))
        for got, expected in zip((x[i] for x in path), motion[:6], strict=True):
            np.testing.assert_allclose(got, expected, rtol=1e-4, atol=1e-5)


def test_the_velocity_of_a_recorded_pose_is_the_derivative_of_its_position():
    body = FreeBody(jnp.array([0.0, 0.1, 0.2]), jnp.eye(3))

    def pose(t):
        return jnp.array([1.0, jnp.sin(t), 0.3 * t, 0.2, t**2, jnp.cos(t), 0.1 * t])

    def position(t):
        zero = jnp.zeros((7, 1))
        return path_of(motions_of(body, pose(t)[:, None], zero, zero)).position[0]

    at = jnp.asarray(0.4)
    rate = jax.jacfwd(pose)(at)
    path = path_of(motions_of(body, pose(at)[:, None], rate[:, None], jnp.zeros((7, 1))))
    np.testing.assert_allclose(path.velocity[0], jax.jacfwd(position)(at), rtol=1e-4, atol=1e-5)
