"""The motion of an arm at many samples is that of each, link by link."""

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.model.kinematics.arm_batch import arm_motion
from ftbias_jax.model.kinematics.screws import product_of_exponentials, sensor_motion


def test_the_motion_is_that_of_each_sample(arm):
    q, dq, ddq = np.random.default_rng(0).uniform(-1, 1, (3, 5, arm.linear.shape[0]))
    got = jax.jit(arm_motion)(arm, q.T, dq.T, ddq.T)
    expected = jax.jit(jax.vmap(sensor_motion, (None, 0, 0, 0)))(arm, q, dq, ddq)
    for one, other in (
        (got.sensor_rotation, expected.R_base_sensor),
        (got.sensor_position, expected.p_base_sensor),
        (got.velocity, expected.linear_velocity),
        (got.acceleration, expected.linear_acceleration),
        (got.angular_velocity, expected.angular_velocity),
        (got.angular_acceleration, expected.angular_acceleration),
    ):
        np.testing.assert_allclose(jnp.moveaxis(one, -1, 0), other, rtol=1e-12, atol=1e-12)
    R, p = jax.jit(jax.vmap(product_of_exponentials, (None, 0)))(arm, q)
    np.testing.assert_allclose(got.link_rotation, np.moveaxis(R, (0, 1), (-1, 2)), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(got.link_position, np.moveaxis(p, (0, 1), (-1, 1)), rtol=1e-12, atol=1e-12)
