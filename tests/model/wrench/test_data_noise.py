"""Sigma_D from physical standard deviations, against the entries of D of many noisy motions; and its part of R."""

from functools import partial

import by_params
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from stated import PANDA

from ftbias_jax.filtering.likelihood import log_likelihood
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.model.wrench.tool_wrench import (
    LIVE_ENTRIES,
    DataNoise,
    data_matrix,
    data_variance,
    measurement_covariance,
    vec,
)
from ftbias_jax.setup import parse_setup


def test_the_variances_are_those_of_noisy_motions():
    """For a sensor at rest, tilted gravity changes a - g by the variance (|g| sigma)^2 in every axis."""
    rng = np.random.default_rng(0)
    linear, angular, rate, tilt = ([0.3, 0.1, 0.2], [2.0, 1.0, 4.0], [1.0, 2.0, 0.5], [0.02, 0.05, 0.03])
    noise = DataNoise(*map(jnp.array, (linear, angular, rate, tilt)))
    gravity = np.array([0.0, 6.0, -8.0])
    force = np.hypot(linear, 10 * np.array(tilt))
    stds = np.stack([force, rate, angular])
    draws = stds * rng.normal(size=(200_000, 3, 3))
    entries = jax.jit(jax.vmap(lambda motion: vec(data_matrix(*motion))[LIVE_ENTRIES]))(jnp.asarray(draws))
    np.testing.assert_allclose(data_variance(noise, jnp.asarray(gravity)), np.var(entries, 0), rtol=0.05)


def test_a_setup_states_it():
    rad = {"angular_velocity": 0.2, "linear_acceleration": 0.5}
    params = params_from_setup(parse_setup({**PANDA, "data_noise": rad}))
    np.testing.assert_allclose(params.bias.data_variance[:3], np.full(3, 0.25), rtol=1e-12)
    np.testing.assert_allclose(params.bias.data_variance[3], 2 * 2 * 0.2**4, rtol=1e-12)  # -(wy^2 + wz^2)
    assert params_from_setup(parse_setup(PANDA)).bias.data_variance is None
    entries = np.linspace(0, 2, 36)
    params = params_from_setup(parse_setup({**PANDA, "data_noise": {"entries": list(entries)}}))
    np.testing.assert_allclose(params.bias.data_variance, entries**2, rtol=1e-12)


def folded(params):
    """Parameters with the same R, stated as noise of the sensor alone."""
    bias = params.bias
    R = measurement_covariance(params.theta, bias.data_variance, bias.wrench_variance)
    return params._replace(bias=bias._replace(data_variance=None, wrench_variance=jnp.diagonal(R)))


@pytest.mark.parametrize("what", ["likelihood", "smoother"])
def test_filter_smoother_and_likelihood_take_it_as_noise_of_the_reading(params, samples, what):
    """This tests the fast route; test_tool_wrench.py tests that R is right."""
    run = {
        "likelihood": lambda p: log_likelihood(p, samples),
        "smoother": lambda p: by_params.smooth_bias(p, samples),
    }[what]
    without = params._replace(bias=params.bias._replace(data_variance=None))
    got, expected, sharper = (jax.tree.leaves(jax.jit(run)(p)) for p in (params, folded(params), without))
    for one, other in zip(got, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12)
    assert not np.allclose(got[-1], sharper[-1])


def test_an_absent_sigma_d_adds_no_operation(params, samples):
    """The likelihood's program with None is smaller than one with Sigma_D, and has no array of 36."""

    def program(p):
        return str(jax.make_jaxpr(partial(log_likelihood, samples=samples))(p))

    without = params._replace(bias=params.bias._replace(data_variance=None))
    assert "f64[36]" in program(params)
    assert "[36]" not in program(without)
    assert "6,36" not in program(without)
