"""Kinematics of a recorded pose against those of the arm that produced it, and against a known rotation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.model.kinematics.recorded_pose import FreeBody, body_motion, motions_of, path_of
from ftbias_jax.model.kinematics.screws import Motion, rotation_from_vector, sensor_motion, sensor_pose


def entries(arm, q):
    """Quaternion and position of the sensor, smooth in q."""
    rotation, position = sensor_pose(arm, q)
    w = jnp.sqrt(1 + jnp.trace(rotation)) / 2
    x = jnp.stack([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]])
    return jnp.concatenate([w[None], x / (4 * w), position])


def rates(of, q, dq, ddq):
    """Value, first and second time derivative of a function of the joints."""

    def at(t):
        return of(q + t * dq + t**2 / 2 * ddq)

    first = jax.jacfwd(at)
    return at(0.0), first(0.0), jax.jacfwd(first)(0.0)


@jax.jit
def motions(arm, mount, length, q, dq, ddq):
    """Motion of the body mounted on the arm, and of an arm that ends in the body."""

    def stretched(q):
        pose = entries(arm, q)
        return pose.at[:4].multiply(length * (1 + 0.1 * jnp.sin(q).sum()))

    ends_in_body = arm._replace(
        zero_position=arm.zero_position + arm.zero_rotation @ mount.zero_position,
        zero_rotation=arm.zero_rotation @ mount.zero_rotation,
    )
    return body_motion(mount, *rates(stretched, q, dq, ddq)), sensor_motion(ends_in_body, q, dq, ddq)


@pytest.mark.parametrize("length", [1.0, 0.98, -3.0])
def test_motion_is_that_of_the_arm(moving, length):
    """This holds for quaternions of any length and sign, and for lengths that change with the motion."""
    arm, q, dq, ddq = moving
    mount = FreeBody(jnp.array([0.03, -0.05, 0.1]), rotation_from_vector(jnp.array([0.4, -0.2, 0.9])))
    got, expected = motions(arm, mount, length, q, dq, ddq)
    for name in Motion._fields:
        if name != "jacobian":
            np.testing.assert_allclose(getattr(got, name), getattr(expected, name), rtol=1e-9, atol=1e-9, err_msg=name)


def test_the_jacobian_maps_rates_of_entries_to_the_twist():
    rng = np.random.default_rng(1)
    q, dq, ddq = rng.normal(size=(3, 7))
    motion = body_motion(FreeBody(rng.normal(size=3), np.eye(3)), *map(jnp.asarray, (q, dq, ddq)))
    twist = np.concatenate([motion.linear_velocity, motion.angular_velocity])
    np.testing.assert_allclose(motion.jacobian @ dq, twist, rtol=1e-12)


def test_without_a_position_the_body_turns_about_its_origin():
    rng = np.random.default_rng(2)
    body = FreeBody(rng.normal(size=3), np.eye(3))
    q, dq, ddq = rng.normal(size=(3, 4))
    still = np.zeros(3)
    short = body_motion(body, *map(jnp.asarray, (q, dq, ddq)))
    full = body_motion(body, *(jnp.asarray(np.r_[x, still]) for x in (q, dq, ddq)))
    assert short.jacobian.shape == (6, 4)
    for name in set(Motion._fields) - {"jacobian"}:
        np.testing.assert_allclose(getattr(short, name), getattr(full, name), rtol=1e-12, atol=1e-15)


def test_gradients_are_finite_at_rest():
    q = jnp.array([1.0, 0, 0, 0, 0, 0, 0])
    zero = jnp.zeros(7)
    body = FreeBody(jnp.zeros(3), jnp.eye(3))
    gradients = jax.grad(lambda *rates: sum(x.sum() for x in body_motion(body, *rates)), (0, 1, 2))(q, zero, zero)
    assert all(np.isfinite(x).all() for x in gradients)


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
