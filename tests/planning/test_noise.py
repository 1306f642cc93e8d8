import jax
import jax.numpy as jnp
import numpy as np
import pytest
from two_joints import SETUP

from ftbias_jax.filtering import pipeline, smoother
from ftbias_jax.filtering.pipeline import Options
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.planning.noise import noise_of, smoothed_covariance
from ftbias_jax.setup import parse_setup
from ftbias_jax.types import Sample


def test_the_joints_are_as_uncertain_as_those_that_the_smoother_finds_amid_a_log():
    setup, rate = parse_setup(SETUP), 250.0
    params = params_from_setup(setup)
    t = jnp.arange(1000) / rate
    q = jnp.zeros((1000, 2))
    samples = Sample(jnp.full(1000, 1 / rate), q, q, jnp.zeros((1000, 6)))
    options = Options()
    smoothed = jax.jit(lambda s: smoother.smooth_joints(params, pipeline.init(params, s), s, options).covariance)(
        samples
    )
    found = smoothed_covariance(params.joint, options.joint_model, 1 / rate)
    size = np.sqrt(np.diagonal(found, axis1=1, axis2=2))
    np.testing.assert_allclose(found, smoothed[len(t) // 2], rtol=1e-3, atol=1e-3 * size.max(0).min() ** 2)


def test_the_noise_is_that_of_the_setup_and_of_faster_joints_the_acceleration_is_less_certain():
    setup = parse_setup({**SETUP, "joints": {"position_noise_std": 1e-4, "velocity_noise_std": 1e-3}})
    t, grid_t = np.arange(1000) / 250, np.arange(50) * 0.08
    slow, fast = (
        noise_of(setup, np.sin(w * t)[:, None] * [1, 1], w * np.cos(w * t)[:, None] * [1, 1], 250.0, grid_t)
        for w in (1.0, 6.0)
    )
    np.testing.assert_allclose(slow.wrench_variance, np.repeat([1e-2, 1.6e-5], 3))
    assert slow.samples == pytest.approx(20)
    assert (fast.joint_covariance[:, 2, 2] > 2 * slow.joint_covariance[:, 2, 2]).all()
