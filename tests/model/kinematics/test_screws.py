"""Kinematics against the matrix exponential and JAX derivatives; test_engines.py tests poses and twists."""

from typing import NamedTuple

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jax.flatten_util import ravel_pytree
from scipy.linalg import expm

from ftbias_jax.model.kinematics import screws
from ftbias_jax.model.kinematics.screws import Motion
from ftbias_jax.types import Array

CLOSE = {"rtol": 1e-10, "atol": 1e-12}


class Kinematics(NamedTuple):
    """All quantities of the module for one state, and the derivative of the Jacobian; compiled once for all arms."""

    exponentials: tuple[Array, Array]
    products: tuple[Array, Array]
    pose: tuple[Array, Array]
    hessian: Array
    motion: Motion

    @property
    def twist(self):
        return jnp.concatenate([self.motion.linear_velocity, self.motion.angular_velocity])

    @property
    def acceleration(self):
        return jnp.concatenate([self.motion.linear_acceleration, self.motion.angular_acceleration])


@jax.jit
def kinematics(arm, q, dq, ddq):
    return Kinematics(
        screws.exponentials(arm, q),
        screws.product_of_exponentials(arm, q),
        screws.sensor_pose(arm, q),
        jnp.moveaxis(jax.jacfwd(lambda q: screws.sensor_motion(arm, q, dq, ddq).jacobian)(q), -1, 0),
        screws.sensor_motion(arm, q, dq, ddq),
    )


@jax.jit
def rates(arm, q, dq, ddq):
    """Time derivatives of all quantities along a motion of constant acceleration."""
    state = (q, dq, ddq)
    return jax.jvp(lambda *state: kinematics(arm, *state), state, (dq, ddq, jnp.zeros_like(ddq)))[1]


rotation_and_slope = jax.jit(lambda v: (screws.rotation_from_vector(v), jax.jacfwd(screws.rotation_from_vector)(v)))


seeds = st.integers(0, 2**32 - 1)


def random_state(seed, arm):
    return np.random.default_rng(seed).uniform(-3, 3, (3, arm.linear.shape[0]))


def homogeneous(rotation, position):
    return np.block([[np.asarray(rotation), np.asarray(position)[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])


@given(seed=seeds, scale=st.sampled_from([0.0, 1e-9, 1e-5, 1e-4, 1e-3, 1.0]))
def test_rotation_from_vector_is_the_matrix_exponential(seed, scale):
    vector = scale * np.random.default_rng(seed).normal(size=3)
    rotation, slope = rotation_and_slope(vector)
    expected = expm(np.asarray(screws.skew(vector)))
    np.testing.assert_allclose(rotation, expected, atol=1e-13)
    # R(v + v dt) = R(v) R(v dt): along v itself the derivative is R [v].
    np.testing.assert_allclose(slope @ vector, expected @ screws.skew(vector), rtol=1e-9, atol=1e-11)


def test_erratum_08_one_joint_transforms_are_not_the_cumulative_ones(moving):
    arm, q, dq, ddq = moving
    now = kinematics(arm, q, dq, ddq)
    single, cumulative = now.exponentials, now.products
    expected = np.eye(4)
    for j in range(len(q)):
        expected = expected @ homogeneous(single[0][j], single[1][j])
        np.testing.assert_allclose(homogeneous(cumulative[0][j + 1], cumulative[1][j + 1]), expected, **CLOSE)
    moved = kinematics(arm, q + np.eye(len(q))[0], dq, ddq).exponentials
    np.testing.assert_array_equal(moved[0][1:], single[0][1:])
    np.testing.assert_array_equal(moved[1][1:], single[1][1:])


@given(seed=seeds)
def test_erratum_01_acceleration_is_the_derivative_of_the_twist(arm, seed):
    state = random_state(seed, arm)
    expected = rates(arm, *state).twist
    np.testing.assert_allclose(kinematics(arm, *state).acceleration, expected, rtol=1e-10, atol=1e-10)


def test_erratum_01_the_angular_hessian_is_not_symmetric(moving):
    """Later joints do not move an axis; if filled symmetrically, the matrix gives a wrong angular acceleration."""
    hessian = np.asarray(kinematics(*moving).hessian)
    np.testing.assert_allclose(hessian[:, :3], hessian[:, :3].T, **CLOSE)
    j, k = np.indices(hessian.shape[::2])
    assert not hessian[:, 3:].swapaxes(1, 2)[j >= k].any()
    assert hessian[:, 3:].swapaxes(1, 2)[j < k].any()


@given(seed=seeds)
def test_recursion_equals_the_jacobian_and_hessian_form(arm, seed):
    """The report's (H dq) dq + J ddq, with the derivative of the Jacobian from JAX."""
    _, dq, ddq = state = random_state(seed, arm)
    now = kinematics(arm, *state)
    motion = now.motion
    np.testing.assert_allclose(motion.R_base_sensor, now.pose[0], **CLOSE)
    np.testing.assert_allclose(motion.p_base_sensor, now.pose[1], **CLOSE)
    np.testing.assert_allclose(now.twist, motion.jacobian @ dq, rtol=1e-10, atol=1e-11)
    expected = np.einsum("jik,j,k->i", now.hessian, dq, dq) + motion.jacobian @ ddq
    np.testing.assert_allclose(now.acceleration, expected, rtol=1e-10, atol=1e-10)


@jax.jit
def slopes(arm, q, dq, ddq):
    """Gradient of a sum that weights every component of the motion differently."""

    def weighted(*inputs):
        flat, _ = ravel_pytree(screws.sensor_motion(*inputs))
        return flat @ jnp.cos(jnp.arange(flat.size))

    return jax.grad(weighted, argnums=(0, 1, 2, 3))(arm, q, dq, ddq)


@pytest.mark.parametrize("angle", [0.0, 1e-160, 1e-8, np.pi])
def test_gradients_are_finite_where_sines_vanish(arm, angle):
    zero = jnp.zeros(len(arm.linear))
    flat, _ = ravel_pytree(slopes(arm, zero + angle, zero, zero))
    assert jnp.isfinite(flat).all()
    assert flat.any()


def test_float32_stays_float32_and_is_close(moving):
    narrow = kinematics(*jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), moving))
    assert {x.dtype for x in jax.tree.leaves(narrow)} == {jnp.dtype("float32")}
    chex.assert_trees_all_close(narrow, kinematics(*moving), rtol=1e-4, atol=1e-4)
