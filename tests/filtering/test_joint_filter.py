"""The joint filter against a textbook filter, against one joint normal distribution, and over very long logs."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.filtering import joint_filter
from ftbias_jax.filtering.params_for_log import max_likelihood_density
from ftbias_jax.filtering.process_models import JOINT_MODELS, matrix
from ftbias_jax.model.params import JointNoise

COUNT, JOINTS = 40, 3
PRIOR_STD = np.array([2.0, 1.0, 10.0])
MISSING = ["nothing", "velocities", "one joint's positions", "samples here and there"]
models = pytest.mark.parametrize("model", JOINT_MODELS)


@pytest.fixture(scope="module")
def noise():
    """Well conditioned, so that the naive reference is accurate to 1e-9."""
    return JointNoise(*map(jnp.asarray, ([2.0, 5.0, 8.0], [0.01, 0.02, 0.03], [0.05, 0.02, 0.1], PRIOR_STD)))


def measured(missing):
    """Irregular stamps, positions and velocities; NaN = not measured."""
    rng = np.random.default_rng(0)
    dt = np.r_[0.0, rng.uniform(0.01, 0.1, COUNT - 1)]
    q, dq = 0.3 * rng.normal(size=(2, COUNT, JOINTS))
    if missing == "velocities":
        dq[:] = np.nan
    elif missing == "one joint's positions":
        q[1:, 1] = np.nan
    elif missing == "samples here and there":
        q[rng.uniform(size=q.shape) < 0.3] = np.nan
        dq[rng.uniform(size=q.shape) < 0.3] = np.nan
        q[20:23] = dq[20:23] = np.nan
        q[0] = 0.1
    return dt, q, dq


@partial(jax.jit, static_argnames="model")
def run(noise, dt, q, dq, model):
    """States (T, n, ...) and innovations of a whole log."""

    def body(state, sample):
        state, innovation = joint_filter.step(noise, state, *sample, model)
        return state, (state, innovation)

    return jax.lax.scan(body, joint_filter.init(noise, joint_filter.first_measured(q)), (dt, q, dq))[1]


step = jax.jit(joint_filter.step, static_argnames="model")


def reference(linear_gaussian, noise, dt, q, joint, model):
    """The filter of one joint as matrices."""
    pairs = [JOINT_MODELS[model](jnp.asarray(interval), noise.process_density[joint]) for interval in dt]
    A, Q = (np.stack([matrix(rows) for rows in part]) for part in zip(*pairs, strict=True))
    R = np.diag([noise.position_std[joint] ** 2, noise.velocity_std[joint] ** 2])
    start = np.array([q[0, joint], 0, 0])
    return linear_gaussian(A, Q, np.eye(2, 3), np.tile(R, (len(dt), 1, 1)), start, np.diag(PRIOR_STD**2))


@models
@pytest.mark.parametrize("missing", MISSING)
def test_erratum_13_the_likelihood_is_that_of_the_whole_log(linear_gaussian, noise, model, missing):
    """States are the textbook's; increments add up to the density of any first samples, including the burn-in."""
    dt, q, dq = measured(missing)
    states, innovation = run(noise, dt, q, dq, model)
    total = np.cumsum(innovation.log_likelihood, 0)
    for joint in range(JOINTS):
        whole, y = reference(linear_gaussian, noise, dt, q, joint, model), np.stack([q, dq], -1)[:, joint]
        mean, covariance = whole.filtered(y)
        np.testing.assert_allclose(states.mean[:, joint], mean, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(states.covariance[:, joint], covariance, rtol=1e-9, atol=1e-9)
        for k in (10, COUNT):
            part = whole._replace(A=whole.A[:k], Q=whole.Q[:k], R=whole.R[:k])
            np.testing.assert_allclose(total[k - 1, joint], part.log_density(y[:k]), rtol=1e-9, atol=1e-9)


def test_erratum_15_a_log_may_start_in_motion():
    """At 1 rad/s from the first sample, with positions only: the error bar of the velocity holds from the start."""
    t = np.arange(1000) * 1e-3
    encoder = JointNoise(*map(jnp.asarray, ([10.0], [1e-5], [1e-3], [1.0, 1.0, 10.0])))
    q = (0.3 + np.sin(t) + 1e-5 * np.random.default_rng(0).normal(size=t.size))[:, None]
    start = joint_filter.init(encoder, jnp.asarray(q[0]))
    np.testing.assert_array_equal(start.mean, [[q[0, 0], 0, 0]])
    states, _ = run(encoder, np.full(t.size, 1e-3), q, np.full_like(q, np.nan), "integrated_jerk")
    std = np.sqrt(np.diagonal(states.covariance[:, 0], axis1=1, axis2=2))
    error = states.mean[:, 0] - np.stack([np.sin(t) + 0.3, np.cos(t), -np.sin(t)], 1)
    assert (np.abs(error) < 5 * std).all()
    assert abs(error[-1, 1]) < 0.01


def encoder_noise(dtype, densities=(1.0, 100.0)):
    """1e-5 rad and 2e-5 rad encoders at each process noise, with the prior that setups have by default."""
    density = np.repeat(densities, 2)
    position_std = np.tile([1e-5, 2e-5], len(densities))
    values = (density, position_std, np.full(len(density), 1e-3), [1.0, 1.0, 10.0])
    return JointNoise(*(jnp.asarray(x, dtype) for x in values))


@partial(jax.jit, static_argnames=("model", "count"))
def covariances_at_1_khz(noise, velocities, model, count):
    """The last state, whether the covariance was symmetric positive definite at all samples, and the variance of the
    acceleration at every 2000th. The covariance depends only on whether something is measured, not on its value.
    """
    zero = jnp.zeros_like(noise.position_std)
    interval = jnp.asarray(1e-3, zero.dtype)
    dq = jnp.where(velocities, zero, jnp.nan)

    def body(state, _):
        state, _ = joint_filter.step(noise, state, interval, zero, dq, model)
        P = state.covariance
        positive = jnp.isfinite(jnp.linalg.cholesky(P)).all()
        return state, (positive & (jnp.swapaxes(P, 1, 2) == P).all() & jnp.isfinite(state.mean).all(), P[:, 2, 2])

    last, (healthy, variance) = jax.lax.scan(body, joint_filter.init(noise, zero), None, length=count)
    return last, healthy.all(), variance[1999::2000]


@models
@pytest.mark.parametrize("velocities", [True, False], ids=["with velocities", "positions only"])
def test_erratum_04_a_1_khz_log_of_20000_samples_stays_positive_definite(model, velocities):
    """This holds in float32 as in float64, with the same standard deviations."""
    narrow, healthy, _ = covariances_at_1_khz(encoder_noise("float32"), velocities, model, 20_000)
    assert healthy
    wide, healthy, _ = covariances_at_1_khz(encoder_noise("float64"), velocities, model, 20_000)
    assert healthy
    assert narrow.covariance.dtype == jnp.float32
    stds = [np.sqrt(np.diagonal(state.covariance, axis1=1, axis2=2)) for state in (narrow, wide)]
    np.testing.assert_allclose(*stds, rtol=0.02)


def test_covariance_is_positive_definite_for_a_million_samples_in_float32():
    _, healthy, _ = covariances_at_1_khz(encoder_noise("float32", [100.0]), True, "integrated_jerk", 1_000_000)
    assert healthy


@pytest.mark.parametrize(("model", "ratio"), [("integrated_acceleration", 0.1), ("integrated_jerk", 1.0)])
def test_erratum_14_model_2_grows_deaf_to_accelerations_and_model_3_does_not(model, ratio):
    """Without noise on the acceleration its variance falls as 1 / t, as for the estimate of a constant."""
    _, _, variance = covariances_at_1_khz(encoder_noise("float64"), True, model, 20_000)
    np.testing.assert_allclose(variance[-1, :2] / variance[0, :2], ratio, rtol=0.01)


def after_a_gap(dtype, model, gap):
    """Joints at rest at 0.5 rad, then no data for a while, then only a position."""
    noise = encoder_noise(dtype)
    settled, *_ = covariances_at_1_khz(noise, True, model, 20_000)
    settled = settled._replace(mean=settled.mean.at[:, 0].set(0.5))
    missing = jnp.full_like(noise.position_std, jnp.nan)
    after, _ = step(noise, settled, jnp.asarray(gap, dtype), missing, missing, model)
    found, _ = step(noise, after, jnp.asarray(1e-3, dtype), jnp.full_like(missing, 0.7), missing, model)
    return after, found


@models
@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("gap", [1.0, 3600.0])
def test_a_position_after_a_gap_is_found_at_once(model, dtype, gap):
    _, found = after_a_gap(dtype, model, gap)
    assert found.covariance.dtype == jnp.dtype(dtype)
    assert jnp.isfinite(jnp.linalg.cholesky(found.covariance)).all()
    np.testing.assert_allclose(found.mean[:, 0], 0.7, atol=1e-4)


@models
def test_an_hour_without_data_restarts_the_filter(model):
    """Integrated noise would exceed any motion: the joint is at rest at its last position, with the covariance P_0."""
    after, _ = after_a_gap("float64", model, 3600.0)
    np.testing.assert_array_equal(after.mean, [[0.5, 0, 0]] * 4)
    np.testing.assert_array_equal(after.covariance, [np.diag([1.0, 1.0, 100.0])] * 4)


def test_likeliest_density_finds_what_the_data_were_made_with():
    rng = np.random.default_rng(1)
    truth = np.array([0.1, 1.0, 10.0])
    noise = JointNoise(*map(jnp.asarray, (truth, [1e-4] * 3, [1e-3] * 3, [1.0, 1.0, 10.0])))
    dt = np.r_[0.0, np.full(299, 0.01)]
    A, Q = (np.asarray(matrix(rows)) for rows in JOINT_MODELS["integrated_jerk"](jnp.asarray(0.01), jnp.asarray(1.0)))
    state, states = np.zeros((3, JOINTS)), []
    for _ in dt:
        states.append(state)
        state = A @ state + np.linalg.cholesky(Q) @ rng.normal(size=(3, JOINTS)) * truth
    q, dq, _ = np.moveaxis(states, 1, 0)
    q, dq = q + 1e-4 * rng.normal(size=q.shape), dq + 1e-3 * rng.normal(size=q.shape)
    found = max_likelihood_density(noise, jnp.asarray(dt), jnp.asarray(q), jnp.asarray(dq))
    np.testing.assert_allclose(found, truth, rtol=0.25)

    def score(factor):
        tried = noise._replace(process_density=found * factor)
        return np.asarray(run(tried, dt, q, dq, "integrated_jerk")[1].log_likelihood.sum(0))

    assert (score(0.95) < score(1.0)).all()
    assert (score(1.05) < score(1.0)).all()


def test_likeliest_density_of_a_violent_log():
    """Jumping accelerations are no white jerk: over an octave the likelihood is far from a parabola."""
    dt = np.r_[0.0, np.full(299, 0.01)]
    t = np.cumsum(dt)[:, None]
    ddq = 20.0 * np.sign(np.sin(2 * np.pi * t * [0.7, 1.0, 2.0]))
    dq = np.cumsum(ddq * 0.01, 0)
    q = np.cumsum(dq * 0.01, 0)
    noise = JointNoise(*map(jnp.asarray, (np.ones(3), [1e-5] * 3, [1e-3] * 3, [1.0, 1.0, 30.0])))
    found = max_likelihood_density(noise, jnp.asarray(dt), jnp.asarray(q), jnp.asarray(dq))
    near = np.linspace(0.9, 1.1, 41)
    tried = [noise._replace(process_density=found * factor) for factor in near]
    scores = np.array([run(each, dt, q, dq, "integrated_jerk")[1].log_likelihood.sum(0) for each in tried])
    np.testing.assert_allclose(near[scores.argmax(0)], 1, atol=0.02)
