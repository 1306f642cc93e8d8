"""Wrenches and motions of many samples in one call equal those of each sample, in pieces and under vmap."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_filters import assert_all_close

from ftbias_jax.filtering import pipeline
from ftbias_jax.model.kinematics.arm_batch import arm_motion
from ftbias_jax.model.kinematics.screws import make_arm, rotation_from_vector
from ftbias_jax.model.wrench.batch import PIECE, wrenches, wrenches_in_motion
from ftbias_jax.model.wrench.tool_wrench import Model, covariance_of_joints, joint_sensitivity

COUNT = PIECE + 9  # a whole piece and a part
ARMS = ("generic", "parallel", "sliding", "helical", "single", "nearly parallel")


def states(n):
    """Joints (T, 3, n) and their covariance (T, 3, 3, n)."""
    rng = np.random.default_rng(1)
    root = rng.normal(size=(COUNT, n, 3, 3))
    covariance = np.moveaxis(root @ np.swapaxes(root, 2, 3), 1, -1)
    return jnp.asarray(rng.normal(size=(COUNT, 3, n))), jnp.asarray(covariance)


@pytest.fixture(scope="module")
def joints(params):
    return states(params.arm.linear.shape[0])


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


def one_by_one(params, model, mean, covariance):
    params = params._replace(arm=model.arm, gravity=model.gravity, theta=model.theta)

    def one(mean, covariance):
        motion, wrench = pipeline.predict_wrench(params, mean.T)
        G = joint_sensitivity(model.theta, motion.R_base_sensor, motion.jacobian, model.gravity)
        return wrench, jnp.diagonal(covariance_of_joints(G, jnp.moveaxis(covariance, -1, 0)))

    return jax.vmap(one)(mean, covariance)


def of_states(model, mean, covariance=None):
    """``wrenches`` of joint states (T, 3, n), with covariance (T, 3, 3, n) or none."""
    upper = () if covariance is None else (covariance[:, 0, 0], covariance[:, 0, 2], covariance[:, 2, 2])
    return wrenches(model, *jnp.moveaxis(mean, 1, 0), *upper)


@partial(jax.jit, static_argnums=0)
def with_slopes(function, weights, *arguments):
    found, pull = jax.vjp(function, *arguments)
    return found, pull(weights)


def test_they_are_those_of_each_sample_with_their_slopes(params, joints):
    model = Model(params.arm, params.gravity, params.theta)
    rng = np.random.default_rng(2)
    weights = tuple(jnp.asarray(rng.normal(size=(COUNT, 6))) for _ in range(2))
    got = with_slopes(of_states, weights, model, *joints)
    expected = with_slopes(partial(one_by_one, params), weights, model, *joints)
    # P_qa is also used for P_aq, so its derivative contains both.
    slope = expected[1][2]
    slope = slope.at[:, 0, 2].add(slope[:, 2, 0]).at[:, 2, 0].set(0)
    expected = (expected[0], (*expected[1][:2], slope))
    assert_all_close(got, expected, 1e-10, 1e-11)


@pytest.mark.parametrize("kind", ARMS)
def test_joints_of_every_kind_are_seen_from_the_sensor_as_from_the_base(params, kind):
    arm = arm_of(kind)
    model = Model(arm, jnp.array([0.3, -0.2, -9.8]), params.theta)
    given = states(arm.linear.shape[0])
    expected = jax.jit(partial(one_by_one, params))(model, *given)
    for got, other in zip(jax.jit(of_states)(model, *given), expected, strict=True):
        np.testing.assert_allclose(got, other, rtol=1e-10, atol=1e-11 * np.abs(other).max())


def test_forward_mode_and_vmap(params, joints):
    model = Model(params.arm, params.gravity, params.theta)
    mean, covariance = joints
    expected = jax.jit(of_states)(model, mean)[0]

    def forward(mean):
        return wrenches_in_motion(model.gravity, model.theta, arm_motion(model.arm, *jnp.moveaxis(mean, 0, 2)))

    got, slope = jax.jit(lambda mean: jax.jvp(forward, (mean,), (mean,)))(mean)
    np.testing.assert_allclose(got, expected, rtol=1e-12, atol=1e-12)
    step = 1e-6
    difference = forward((1 + step) * mean) - forward((1 - step) * mean)
    np.testing.assert_allclose(slope, difference / (2 * step), rtol=1e-6, atol=1e-6 * np.abs(slope).max())
    many = jax.jit(jax.vmap(partial(of_states, model)))(jnp.stack([mean, -mean]), jnp.stack([covariance] * 2))
    np.testing.assert_allclose(many[0][0], expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(many[0][1], jax.jit(of_states)(model, -mean)[0], rtol=1e-12, atol=1e-12)
