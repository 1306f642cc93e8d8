"""The walk from the sensor to the base gives the sensor's Jacobian, motion and gravity, for joints of every kind."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.model.kinematics.screws import make_arm, rotation_from_vector, sensor_motion
from ftbias_jax.model.kinematics.seen_from_sensor import (
    at_last_joint,
    chain_of,
    column_of,
    joint_before,
    moved_by,
    seen_by_sensor,
    turns_of,
)

GRAVITY = jnp.array([0.3, -0.2, -9.8])
ARMS = ("generic", "parallel", "sliding", "helical", "single", "nearly parallel")


def arm_of(kind):
    rng = np.random.default_rng(3)
    axes = rng.normal(size=(1 if kind == "single" else 5, 3))
    if kind == "parallel":
        axes[:] = [0, 0, 1]
        axes[2] *= -1
    if kind == "nearly parallel":
        axes = np.array([0.6, 0, 0.8]) + 1e-9 * axes
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    linear = -np.cross(axes, rng.normal(size=axes.shape))
    if kind == "helical":
        linear += 0.1 * axes
    if kind == "sliding":
        linear[1::2], axes[1::2] = 1.5 * axes[1::2], 0
    R = rotation_from_vector(jnp.asarray(rng.normal(size=3)))
    return make_arm(np.concatenate([linear, axes], 1), rng.normal(size=3), R)


@jax.jit
def walked(arm, q, dq, ddq):
    chain = chain_of(arm)
    turns = turns_of(chain, q)
    axes, p, moving = at_last_joint(chain, jnp.zeros_like(q[0]))
    columns = []
    for j in reversed(range(len(q))):
        columns = [column_of(chain, j, axes[2], p), *columns]
        moving = moved_by(columns[0], dq[j], ddq[j], moving)
        axes, p = joint_before(chain, j, q[j], turns, axes, p)
    stacked = jnp.stack([jnp.stack([*c.linear, *c.angular]) for c in columns], 1)
    return stacked, moving, seen_by_sensor(chain, turns, list(GRAVITY))


@pytest.mark.parametrize("kind", ARMS)
def test_it_is_the_motion_in_sensor_axes(kind):
    arm = arm_of(kind)
    q, dq, ddq = np.random.default_rng(0).uniform(-3, 3, (3, 4, arm.linear.shape[0]))
    columns, moving, gravity = walked(arm, q.T, dq.T, ddq.T)
    motion = jax.jit(jax.vmap(sensor_motion, (None, 0, 0, 0)))(arm, q, dq, ddq)
    R = motion.R_base_sensor
    expected = jnp.concatenate(
        [jnp.einsum("tab,tac->tbc", R, part) for part in jnp.split(motion.jacobian, 2, axis=1)], axis=1
    )
    np.testing.assert_allclose(jnp.moveaxis(columns, -1, 0), expected, rtol=1e-12, atol=1e-12)
    (v, w), (v_rate, w_rate) = moving
    acceleration = jnp.stack(v_rate, 1) + jnp.cross(jnp.stack(w, 1), jnp.stack(v, 1))

    def seen(x):
        return jnp.einsum("tab,ta->tb", R, x)

    for one, other in (
        (jnp.stack(v, 1), seen(motion.linear_velocity)),
        (jnp.stack(w, 1), seen(motion.angular_velocity)),
        (acceleration, seen(motion.linear_acceleration)),
        (jnp.stack(w_rate, 1), seen(motion.angular_acceleration)),
        (jnp.stack(gravity, 1), GRAVITY @ R),
    ):
        np.testing.assert_allclose(one, other, rtol=1e-11, atol=1e-11)
