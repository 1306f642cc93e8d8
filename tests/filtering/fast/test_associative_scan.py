"""The filters parallel in time are the sequential ones, in both precisions, and on an accelerator if there is one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_filters import MODELS, models, problem

from ftbias_jax.filtering import pipeline
from ftbias_jax.filtering.fast import stages
from ftbias_jax.filtering.fast.associative_scan import filter_parallel
from ftbias_jax.filtering.fast.scan import filter_scan

one_by_one = jax.jit(filter_scan, static_argnums=0)
at_once = jax.jit(filter_parallel, static_argnums=0)


@models
def test_it_is_the_sequential_filter_also_across_a_restart(model):
    """Restarts come in the joint models; all kinds of missing measurements in all."""
    for seed in range(2):
        inputs = problem(model, seed)
        expected, got = one_by_one(MODELS[model], inputs), at_once(MODELS[model], inputs)
        for name, one, other in zip(expected._fields, expected, got, strict=True):
            np.testing.assert_allclose(other, one, rtol=1e-9, atol=1e-10 * np.abs(one).max(), err_msg=name)


@pytest.mark.slow
def test_and_so_are_its_slopes():
    inputs = problem("integrated_jerk", 0, gap=False)

    def slopes(scan):
        def nats(density, variance):
            moved = inputs._replace(density=density, variance=variance)
            return scan(MODELS["integrated_jerk"], moved).log_likelihood.sum()

        return jax.jit(jax.grad(nats, (0, 1)))(inputs.density, inputs.variance)

    for got, expected in zip(slopes(filter_parallel), slopes(filter_scan), strict=True):
        np.testing.assert_allclose(got, expected, rtol=1e-8, atol=1e-9 * np.abs(expected).max())


def sharp_encoders(count, dtype):
    """A joint at 1 kHz as robots measure it, errors of 2e-5 rad: hard for single precision."""
    rng = np.random.default_rng(0)
    t = 1e-3 * np.arange(count)
    y = np.stack([np.sin(t) + 2e-5 * rng.normal(size=count), np.cos(t) + 1e-3 * rng.normal(size=count)], 1)[..., None]
    example = problem("integrated_jerk", 0, gap=False)
    values = example._replace(
        dt=np.r_[0.0, np.full(count - 1, 1e-3)],
        density=np.array([30.0]),
        y=y,
        variance=np.broadcast_to(np.array([[2e-5], [1e-3]]) ** 2, y.shape),
        mean=np.array([[y[0, 0, 0]], [0.0], [0.0]]),
        covariance=np.diag([1.0, 1.0, 100.0])[..., None],
        restart_variance=np.array([[1.0], [1.0], [100.0]]),
    )
    return jax.tree.map(lambda x: jnp.asarray(x, dtype), values)


@pytest.mark.slow
def test_single_precision_stays_positive_definite_and_near_double():
    model = MODELS["integrated_jerk"]
    exact, rough = (at_once(model, sharp_encoders(4000, dtype)) for dtype in (jnp.float64, jnp.float32))
    assert rough.mean.dtype == jnp.float32
    covariance = np.asarray(rough.covariance[..., 0], np.float64)
    std = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    assert (np.linalg.eigvalsh(covariance / std[:, :, None] / std[:, None]) > 0).all()
    settled = slice(100, None)
    np.testing.assert_allclose(covariance[settled], exact.covariance[settled, ..., 0], rtol=0.02)
    error = np.abs(rough.mean - exact.mean)[settled, :, 0] / std[settled]
    assert np.quantile(error, 0.99) < 2.0


def test_an_accelerator_filters_as_the_processor_does(params, samples):
    accelerators = [device for device in jax.devices() if device.platform != "cpu"]
    if not accelerators:
        pytest.skip("no accelerator")
    for dtype, rtol in ((jnp.float64, 1e-8), (jnp.float32, 1e-2)):
        one, log = jax.tree.map(lambda x, dtype=dtype: x.astype(dtype), (params, samples))
        state = pipeline.init(one, log)
        (_, (_, infos)), (_, track) = (
            pipeline.scan_steps(one, state, log),
            stages.run(one, state, log, pipeline.DEFAULT_OPTIONS),
        )
        got = track.joint.log_likelihood.sum(1) + track.wrench.log_likelihood.sum(1)
        assert np.isfinite(got).all()
        np.testing.assert_allclose(got, infos.log_likelihood, rtol=rtol, atol=rtol * np.abs(got).max())
