"""The pipeline: one step, a scan, batches; units, precision, gradients; and the parameters of a setup."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jax.flatten_util import ravel_pytree
from small_filters import assert_all_close

from ftbias_jax.errors import SetupError
from ftbias_jax.filtering import pipeline
from ftbias_jax.filtering.pipeline import Options
from ftbias_jax.filtering.samples import pad, samples_from_log
from ftbias_jax.io.log import Log
from ftbias_jax.model.kinematics.screws import sensor_motion, sensor_pose
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.model.wrench.tool_wrench import joint_sensitivity
from ftbias_jax.setup import parse_setup
from ftbias_jax.setup.rotations import rotation_from_rpy
from ftbias_jax.types import Sample

seeds = st.integers(0, 2**32 - 1)
step = jax.jit(pipeline.step, static_argnames="options")


def run(params, samples):
    """Last state, and state and info of every sample."""
    return pipeline.run(params, pipeline.init(params, samples), samples, emit=pipeline.keep_all)


def loop(params, samples):
    """The same by calling step for one sample at a time."""
    state, kept = pipeline.init(params, samples), []
    for i in range(len(samples.dt)):
        state, info = step(params, state, jax.tree.map(lambda x, i=i: x[i], samples))
        kept.append((state, info))
    return state, jax.tree.map(lambda *leaves: np.stack(leaves), *kept)


def assert_close(value, expected, tolerance=1e-12):
    """Trees agree to a tolerance relative to each leaf's largest entry; NaN in the same places."""
    assert_all_close(value, expected, 0, tolerance)


def cut(tree, start, stop):
    return jax.tree.map(lambda x: np.asarray(x)[start:stop], tree)


def first_of(tree):
    return jax.tree.map(lambda x: x[0], tree)


def test_run_is_a_loop_of_step(params, samples):
    expected = loop(params, samples)
    assert_close(run(params, samples), expected)
    assert_close(pipeline.scan_steps(params, pipeline.init(params, samples), samples, emit=pipeline.keep_all), expected)


def test_a_step_is_compiled(params, samples):
    """A driver calls it once for each sample."""
    state, sample = pipeline.init(params, samples), first_of(samples)
    assert pipeline.step.lower(params, state, sample).compile()
    assert_close(pipeline.step(params, state, sample), pipeline.step.__wrapped__(params, state, sample))


def test_single_steps_refuse_effects(params, samples):
    """An effect with memory cannot be computed from one sample."""
    knowing = params._replace(effects={"gain": {"gain": jnp.ones(6)}})
    with pytest.raises(SetupError, match="whole logs"):
        pipeline.step(knowing, pipeline.init(params, samples), first_of(samples))


def test_a_log_cannot_be_padded_to_less(samples):
    with pytest.raises(ValueError, match="cannot pad 40 samples to 39"):
        pad(samples, 39)


def test_by_default_is_kept_what_a_result_has(params, samples):
    _, (states, infos) = run(params, samples)
    _, kept = pipeline.run(params, pipeline.init(params, samples), samples)
    assert_close(kept, jax.vmap(pipeline.keep_result)(states, infos))
    assert max(x[0].size for x in jax.tree.leaves(kept)) <= max(3 * samples.q.shape[1], 12)


@pytest.mark.parametrize("place", [1, 20, 34])
def test_splitting_a_log_and_carrying_the_state_changes_nothing(params, samples, place):
    whole, kept = run(params, samples)
    parts = cut(samples, 0, place), cut(samples, place, 40)
    state, pieces = pipeline.init(params, samples), []
    for part in parts:
        state, piece = pipeline.run(params, state, pad(part, 40), emit=pipeline.keep_all)  # one shape: compiled once
        pieces.append(cut(piece, 0, len(part.dt)))
    assert_close(state, whole)
    assert_close(jax.tree.map(lambda *leaves: np.concatenate(leaves), *pieces), kept)


@given(scale=st.floats(0.1, 10.0))
def test_the_unit_of_time_does_not_matter(params, samples, scale):
    """With a time unit of which a second has ``scale``, forces and torques scale by 1 / scale^2, rates by 1 / scale."""
    s = scale
    params, samples = jax.tree.map(np.asarray, (params, samples))
    rate = np.array([1, 1 / s, 1 / s**2])
    other = params._replace(
        gravity=params.gravity / s**2,
        joint=params.joint._replace(
            process_density=params.joint.process_density / s**2.5,
            velocity_std=params.joint.velocity_std / s,
            prior_std=params.joint.prior_std * rate,
        ),
        bias=params.bias._replace(
            density=params.bias.density / s**3.5,
            data_variance=params.bias.data_variance / s**4,
            wrench_variance=params.bias.wrench_variance / s**4,
            prior_mean=params.bias.prior_mean / np.repeat([s**2, s**3], 6),
            prior_std=params.bias.prior_std / np.repeat([s**2, s**3], 6),
        ),
    )
    scaled = Sample(samples.dt * s, samples.q, samples.dq / s, samples.wrench / s**2)
    _, (states, info) = run(other, scaled)
    _, (expected, expected_info) = run(params, samples)
    assert_close(np.asarray(states.joint.mean) / rate, expected.joint.mean, 1e-10)
    assert_close(np.asarray(states.bias.mean) * np.repeat([s**2, s**3], 6), expected.bias.mean, 1e-10)
    assert_close(info.wrench.nis, expected_info.wrench.nis, 1e-9)
    densities = np.log(s) * (np.isfinite(samples.dq).sum() + 2 * np.isfinite(samples.wrench).sum())
    assert_close(info.log_likelihood.sum() - densities, expected_info.log_likelihood.sum(), 1e-9)


predict_wrench = jax.jit(lambda params, joints: pipeline.predict_wrench(params, joints)[1])


def test_erratum_02_turning_the_wrist_at_rest_turns_the_weight(panda, params):
    """Without gravity in D this 0.9 kg tool would appear as 8.8 N of bias that varies by 17.7 N."""
    gravity = jnp.array([0.0, 0.0, -9.81])
    theta = jnp.zeros(10).at[0].set(0.9)
    held = params._replace(arm=panda, gravity=gravity, theta=theta)
    still = np.zeros((7, 3))
    for wrist, expected in ((0.0, -8.829), (np.pi, 8.829)):  # the flange of a Panda at q = 0 points down
        still[5, 0] = wrist
        np.testing.assert_allclose(predict_wrench(held, still), [0, 0, expected, 0, 0, 0], atol=1e-12)


@jax.jit
def path_acceleration(arm, center, q, dq, ddq):
    """Sensor axes, and the acceleration in the base frame of a point fixed in the sensor frame."""

    def position(time):
        rotation, origin = sensor_pose(arm, q + dq * time + ddq * time**2 / 2)
        return origin + rotation @ center

    return sensor_pose(arm, q)[0], jax.jacfwd(jax.jacfwd(position))(0.0)


@given(seed=seeds)
def test_erratum_03_the_wrench_is_in_the_frame_of_the_sensor(params, seed):
    """A point mass in base coordinates, its acceleration by differentiating its path, turned into the sensor frame."""
    q, dq, ddq = np.random.default_rng(seed).normal(size=(3, 3))
    mass, center = 0.7, np.array([0.1, -0.2, 0.3])
    inertia = mass * (center @ center * np.eye(3) - np.outer(center, center))
    theta = jnp.asarray(np.r_[mass, mass * center, inertia[np.triu_indices(3)]])
    wrench = predict_wrench(params._replace(theta=theta), np.stack([q, dq, ddq], 1))
    rotation, acceleration = path_acceleration(params.arm, center, q, dq, ddq)
    force = rotation.T @ (mass * (acceleration - params.gravity))
    np.testing.assert_allclose(wrench, np.r_[force, np.cross(center, force)], rtol=1e-9, atol=1e-9)


def panda_setup(**sections):
    return parse_setup(
        {
            "robot": {"model": "panda"},
            "sensor": {"noise_std": [0.1, 0.004], "translation": [0.01, 0.02, 0.03], "rotation_rpy": [0.1, 0.2, 0.3]},
            "tool": {"mass": 0.7, "center_of_mass": [0, 0, 0.06]},
            **sections,
        }
    )


def test_erratum_10_the_sensor_at_zero_is_the_flange_moved_by_the_mount():
    params = params_from_setup(panda_setup())
    rotation, position = sensor_pose(params.arm, jnp.zeros(7))
    flange = np.diag([1.0, -1.0, -1.0])
    np.testing.assert_allclose(rotation, flange @ rotation_from_rpy(np.array([0.1, 0.2, 0.3])), atol=1e-15)
    np.testing.assert_allclose(position, [0.088 + 0.01, -0.02, 0.926 - 0.107 - 0.03], atol=1e-15)


def test_parameters_are_those_of_the_setup():
    """In the order of the setup's joints, with the requested dtype."""
    setup = panda_setup(joints={"position_noise_std": [1e-5 * j for j in range(1, 8)]}, bias={"initial": [1.5, 0.2]})
    params = params_from_setup(setup, jnp.float32)
    assert {x.dtype for x in jax.tree.leaves(params)} == {jnp.dtype("float32")}
    np.testing.assert_allclose(params.joint.position_std, 1e-5 * np.arange(1, 8), rtol=1e-6)
    np.testing.assert_allclose(params.bias.prior_mean, np.repeat([1.5, 0.2, 0, 0], 3), rtol=1e-6)
    np.testing.assert_allclose(params.bias.prior_std[6:], setup.bias.initial_drift_std, rtol=1e-6)
    np.testing.assert_allclose(params.bias.wrench_variance, setup.sensor.noise_std**2, rtol=1e-6)
    np.testing.assert_allclose(params.theta[:4], [0.7, 0, 0, 0.7 * 0.06], rtol=1e-6)
    np.testing.assert_allclose(params.arm.angular, setup.robot.screws[:, 3:])


def test_erratum_07_the_dt_of_a_step_is_the_time_since_the_previous_sample():
    """The first sample has none. It is taken in float64: float32 stamps of a long log would lose milliseconds."""
    t = 1e5 + np.array([0.0, 0.001, 0.003, 0.004])
    log = Log(t, np.zeros((4, 7)), np.zeros((4, 7)), np.zeros((4, 6)), np.zeros(4))
    samples = samples_from_log(log, jnp.float32)
    assert samples.dt.dtype == jnp.float32
    np.testing.assert_allclose(samples.dt, [0, 0.001, 0.002, 0.001], rtol=1e-6)


def test_erratum_07_the_first_sample_is_a_correction_of_the_prior(params, samples):
    """Results are bitwise independent of the process noise, which only a prediction would add."""
    restless = params._replace(joint=params.joint._replace(process_density=100 * params.joint.process_density))
    for model in ("integrated_jerk", "acceleration"):
        first, second = (
            step(p, pipeline.init(p, samples), first_of(samples), Options(model)) for p in (params, restless)
        )
        for x, y in zip(jax.tree.leaves(first), jax.tree.leaves(second), strict=True):
            np.testing.assert_array_equal(x, y)


def test_every_joint_starts_at_its_first_measured_position(params, samples):
    late = samples._replace(q=samples.q.at[:3, 1].set(jnp.nan).at[:, 2].set(jnp.nan))
    state = pipeline.init(params, late)
    np.testing.assert_array_equal(state.joint.mean[:, 0], [samples.q[0, 0], samples.q[3, 1], 0])
    np.testing.assert_array_equal(state.joint.mean[:, 1:], np.zeros((3, 2)))


def test_float32_stays_float32_and_is_close_in_standard_deviations(params, samples):
    _, (narrow, info) = run(*jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), (params, samples)))
    floats = [x.dtype for x in jax.tree.leaves((narrow, info)) if jnp.issubdtype(x.dtype, jnp.floating)]
    assert set(floats) == {jnp.dtype("float32")}
    _, (wide, wide_info) = run(params, samples)
    for one, other in ((narrow.joint, wide.joint), (narrow.bias, wide.bias)):
        std = np.sqrt(np.diagonal(other.covariance, axis1=-2, axis2=-1))
        assert (np.abs(one.mean - other.mean) < 0.02 * std).all()
        np.testing.assert_allclose(np.sqrt(np.diagonal(one.covariance, axis1=-2, axis2=-1)), std, rtol=0.01)
    np.testing.assert_allclose(info.log_likelihood.sum(), wide_info.log_likelihood.sum(), rtol=1e-3)


def score(params, samples):
    """Log-likelihood of a log plus a small function of the last state, so that every leaf matters."""
    last, likelihood = pipeline.run(params, pipeline.init(params, samples), samples, emit=only_likelihood)
    return likelihood.sum() + last.bias.mean.sum() + last.joint.mean.sum()


def only_likelihood(state, info):
    return info.log_likelihood


value, slope = jax.jit(score), jax.jit(jax.grad(score))
LEAVES = {
    "gravity": lambda params: params.gravity,
    "tool": lambda params: params.theta,
    "sensor position": lambda params: params.arm.zero_position,
    "joint process noise": lambda params: params.joint.process_density,
    "joint position noise": lambda params: params.joint.position_std,
    "joint velocity noise": lambda params: params.joint.velocity_std,
    "bias process noise": lambda params: params.bias.density,
    "Sigma_D (erratum 11)": lambda params: params.bias.data_variance,
    "Sigma_W": lambda params: params.bias.wrench_variance,
    "prior bias": lambda params: params.bias.prior_mean,
    "P_0": lambda params: params.bias.prior_std,
}


@pytest.mark.parametrize("leaf", LEAVES)
def test_erratum_11_gradients_are_differences_of_the_likelihood(params, samples, leaf):
    """Every parameter, Sigma_D among them, along a random direction in proportion to its value; the log has NaN."""
    target = LEAVES[leaf](params)
    weights = np.random.default_rng(0).normal(size=target.shape)
    direction = jax.tree.map(lambda x: weights * x if x is target else jnp.zeros_like(x), params)

    def along(step):
        return value(jax.tree.map(lambda x, d: x + step * d, params, direction), samples)

    h = 1e-4
    difference = (8 * (along(h) - along(-h)) - (along(2 * h) - along(-2 * h))) / (12 * h)
    exact = ravel_pytree(slope(params, samples))[0] @ ravel_pytree(direction)[0]
    rounding = 10 * np.finfo(float).eps * abs(value(params, samples)) / h  # of differences of sums over the samples
    np.testing.assert_allclose(exact, difference, rtol=1e-6, atol=rounding)


def test_gradients_are_finite_when_nothing_is_measured(params, samples):
    nothing = Sample(samples.dt, *(jnp.full_like(x, jnp.nan) for x in samples[1:4]))
    for log in (nothing, samples):
        assert all(jnp.isfinite(x).all() for x in jax.tree.leaves(slope(params, log)))


def test_uncertain_joints_add_to_the_noise_of_the_wrench(params, samples):
    """S of the first sample grows by the diagonal of G P G^T."""
    start, sample = pipeline.init(params, samples), first_of(samples)
    first = [step(params, start, sample, Options(uncertain_joints=uncertain)) for uncertain in (False, True)]
    without, with_joints = (info.wrench.covariance for _, info in first)
    joint = first[0][0].joint
    motion = sensor_motion(params.arm, *joint.mean.T)
    by_q, by_ddq = joint_sensitivity(params.theta, motion.R_base_sensor, motion.jacobian, params.gravity)
    expected = np.zeros((6, 6))
    for j in range(3):
        G = np.stack([by_q[:, j], by_ddq[:, j]], 1)
        expected += G @ joint.covariance[j][::2, ::2] @ G.T
    assert_close(with_joints - without, np.diag(np.diag(expected)), 1e-10)
