"""Smoothed states against the joint normal distribution of all states and measurements of a log."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_filters import COUNT, GAP, LANES, MODELS, problem, single, sizes

from ftbias_jax.filtering.fast.scan import filter_scan
from ftbias_jax.filtering.process_models import BiasStrength, correlated_bias, matrix, reverting_drift
from ftbias_jax.filtering.smoother import smooth_track

FUNCTIONS = {**MODELS, "a drift that reverts": reverting_drift, "correlated noise": correlated_bias}


@jax.jit
def smooth_all(inputs):
    return {
        name: smooth_track(FUNCTIONS[name], each, filter_scan(FUNCTIONS[name], each)) for name, each in inputs.items()
    }


def inputs_of(name):
    """A log without restarts; noise and drift that revert forget everything in a gap of 40 s."""
    if name in MODELS:
        return problem(name, 2, 0.1)._replace(restart_variance=jnp.full((sizes(name)[0], LANES), jnp.inf))
    plain, rng = problem("drift", 2, 40.0), np.random.default_rng(1)
    strength = BiasStrength(plain.density, jnp.asarray(rng.uniform(0.1, 2, LANES)))
    if name == "a drift that reverts":
        return plain._replace(density=strength)
    variance = jnp.asarray(rng.uniform(0.1, 1, LANES))
    in_both = np.array([1.0, 0, 1])  # the state is (bias + noise, drift, noise)
    added = np.outer(in_both, in_both)[:, :, None] * np.asarray(variance)
    return plain._replace(
        density=BiasStrength(*strength[:2], jnp.asarray(rng.uniform(1, 20, LANES)), variance),
        mean=jnp.pad(plain.mean, ((0, 1), (0, 0))),
        covariance=jnp.pad(plain.covariance, ((0, 1), (0, 1), (0, 0))) + added,
        restart_variance=jnp.full((3, LANES), jnp.inf),
    )


@pytest.fixture(scope="module")
def smoothed():
    inputs = {name: inputs_of(name) for name in FUNCTIONS}
    return inputs, smooth_all(inputs), smooth_all(single(inputs))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_smoothed_states_are_the_posterior_given_the_whole_log(linear_gaussian, smoothed, name):
    """In single precision they are close to it, with positive covariances."""
    inputs, exact, narrow = (x[name] for x in smoothed)
    assert narrow.covariance.dtype == jnp.float32
    for lane in range(LANES):
        strength = jax.tree.map(lambda x, lane=lane: x[lane], inputs.density)
        rows = [FUNCTIONS[name](dt, strength) for dt in inputs.dt]
        A, Q = (np.stack([matrix(x) for x in part]) for part in zip(*rows, strict=True))
        R = np.stack([np.diag(variance) for variance in inputs.variance[..., lane]])
        prior = (np.asarray(x[..., lane]) for x in (inputs.mean, inputs.covariance))
        model = linear_gaussian(A, Q, np.eye(R.shape[1], A.shape[1]), R, *prior)
        mean, covariance = model.smoothed(np.asarray(inputs.y[..., lane]))
        np.testing.assert_allclose(exact.mean[..., lane], mean, rtol=1e-7, atol=1e-8)
        np.testing.assert_allclose(exact.covariance[..., lane], covariance, rtol=1e-7, atol=1e-8)
        np.testing.assert_allclose(narrow.mean[..., lane], mean, rtol=1e-2, atol=1e-2)
        np.testing.assert_allclose(narrow.covariance[..., lane], covariance, rtol=1e-2, atol=1e-5)
        least = -1e-6 if name == "correlated noise" else 0.0
        assert (np.linalg.eigvalsh(np.asarray(narrow.covariance[..., lane], float)) > least).all()


def test_what_comes_after_a_restart_says_nothing_about_before():
    names = ("integrated_jerk", "integrated_acceleration", "drift")  # the positions of the other joints are not lost
    inputs = {name: problem(name, 3, 100.0) for name in names}
    restarting = {
        name: x._replace(restart_variance=jnp.full_like(x.restart_variance, 50.0)) for name, x in inputs.items()
    }
    silent = {name: x._replace(y=x.y.at[GAP:].set(jnp.nan)) for name, x in restarting.items()}
    whole, before = smooth_all(restarting), smooth_all(silent)
    for name in names:
        assert len(whole[name].mean) == COUNT
        np.testing.assert_array_equal(whole[name].mean[:GAP], before[name].mean[:GAP])
        np.testing.assert_array_equal(whole[name].covariance[:GAP], before[name].covariance[:GAP])
