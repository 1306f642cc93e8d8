"""Smoothing against filtering of the past; test_rts.py and test_params_for_log.py show that it is the posterior."""

import by_params
import jax.numpy as jnp
import numpy as np

from ftbias_jax.cli.commands import demo
from ftbias_jax.filtering import pipeline, smoother
from ftbias_jax.filtering.fast import stages
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.setup import parse_setup
from ftbias_jax.types import Sample


def test_the_whole_log_knows_more_than_its_past(params, samples):
    """This holds for joints and bias at every sample, except the last of the joints, which has no future."""
    start = pipeline.init(params, samples)
    _, filtered = stages.run(params, start, samples, pipeline.DEFAULT_OPTIONS)
    joints, (bias, bias_std) = smoother.smooth_joints(params, start, samples), by_params.smooth_bias(params, samples)
    past = stages.joint_states(filtered.joint)
    variance, past_variance = (np.diagonal(x.covariance, axis1=2, axis2=3) for x in (joints, past))
    assert (variance > 0).all()
    assert (variance <= past_variance * (1 + 1e-6)).all()
    np.testing.assert_allclose(joints.mean[-1], past.mean[-1], rtol=1e-9, atol=1e-12)
    past_std = np.sqrt(np.moveaxis(np.diagonal(filtered.wrench.covariance, axis1=1, axis2=2), -1, 1))
    assert (bias_std <= past_std.reshape(bias_std.shape) * (1 + 1e-6)).all()
    assert np.isfinite(bias).all()


def test_smoothed_accelerations_have_no_lag(params, samples):
    """The log's joints follow sines of 2 rad/s."""
    t = np.cumsum(np.asarray(samples.dt))[:, None]
    truth = -2 * np.sin(2 * t + [0, 1, 2])
    start = pipeline.init(params, samples)
    joints = smoother.smooth_joints(params, start, samples)
    error = joints.mean[:, :, 2] - truth
    assert (np.abs(error) < 4 * np.sqrt(joints.covariance[:, :, 2, 2])).all()


def drifting(dtype):
    """A Panda log of 600 samples at 500 Hz whose first samples measured nothing: wide priors, slow bias."""
    t = np.arange(600) / 500
    rng = np.random.default_rng(0)
    q = 0.5 * np.sin(t[:, None] + np.arange(7)) + 2e-5 * rng.normal(size=(600, 7))
    dq = 0.5 * np.cos(t[:, None] + np.arange(7)) + 1e-3 * rng.normal(size=(600, 7))
    wrench = 1 + 0.1 * rng.normal(size=(600, 6))
    dq[:5] = q[1:5] = wrench[:5] = wrench[200:300] = np.nan
    samples = Sample(*(jnp.asarray(x, dtype) for x in (np.diff(t, prepend=0.0), q, dq, wrench)))
    return params_from_setup(parse_setup(demo.SETUP), dtype), samples


def test_single_precision_keeps_its_digits():
    """P_0 is up to 1e10 times the smoothed variance: a difference of covariances would have no correct digit."""
    results = []
    for dtype in (jnp.float32, jnp.float64):
        params, samples = drifting(dtype)
        joints = smoother.smooth_joints(params, pipeline.init(params, samples), samples)
        mean, std = by_params.smooth_bias(params, samples)
        assert {x.dtype for x in (*joints, mean, std)} == {jnp.dtype(dtype)}
        results.append([np.asarray(x, float) for x in (*joints, mean, std)])
    (q, P, bias, std), (exact_q, exact_P, exact_bias, exact_std) = results
    assert (np.linalg.eigvalsh(exact_P) > 0).all()
    variance, exact = (np.diagonal(x, axis1=2, axis2=3) for x in (P, exact_P))
    np.testing.assert_allclose(variance[10:], exact[10:], rtol=1e-3)
    np.testing.assert_allclose(variance, exact, rtol=0.1)  # while almost nothing is known
    np.testing.assert_allclose(std, exact_std, rtol=1e-3)
    assert (np.abs(bias - exact_bias) < 0.5 * exact_std).all()
    assert (np.abs(q - exact_q) < 0.2 * np.sqrt(exact)).all()
