"""The likelihood in chunks, of which nothing is stored, is the sum over the steps; so are its slopes."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.filtering import pipeline
from ftbias_jax.filtering.fast import log_likelihoods as route
from ftbias_jax.filtering.pipeline import Options

CORRELATED = {
    "vibration": jnp.full((3, 6), 0.3),
    "vibration_speed": jnp.asarray(0.5),
    "correlated_std": jnp.linspace(0.1, 0.6, 6),
    "correlated_time": jnp.linspace(0.05, 0.3, 6),
    "correlated_vibration": jnp.full(6, 0.5),
    "drift_time": jnp.full(6, 30.0),
}
CASES = {
    "plain": ({}, Options()),
    "acceleration noise, joints known": ({}, Options("acceleration", "none")),
    "correlated noise, vibration and gate": (CORRELATED, Options(gate=3.0)),
}


@pytest.fixture
def in_chunks(monkeypatch):
    """Two whole chunks of the log's 40 samples, and a part."""
    monkeypatch.setattr(route, "CHUNK", 16)
    return route.log_likelihoods.__wrapped__


def by_samples(params, state, samples, weight, options):
    """The definition: what the pipeline reports of every sample, added up."""
    emit = lambda state, info: (info.joint.log_likelihood.sum(), info.wrench.log_likelihood)  # noqa: E731
    _, (joint, wrench) = pipeline.scan_steps(params, state, samples, options, emit)
    return (weight * joint).sum(), (weight * wrench).sum()


def values_and_slopes(function, options, params, samples, weight):
    """Both sums, and the slopes of a mixture of them in parameters, wrench and joints."""

    def mixture(params, wrench, q):
        seen = samples._replace(wrench=wrench, q=q)
        joint, wrench = function(params, pipeline.init(params, samples), seen, weight, options)
        return joint + 2 * wrench, (joint, wrench)

    return jax.value_and_grad(mixture, (0, 1, 2), has_aux=True)(params, samples.wrench, samples.q)


def assert_close(got, expected, rtol):
    for one, other in zip(jax.tree.leaves(expected), jax.tree.leaves(got), strict=True):
        np.testing.assert_allclose(other, one, rtol=rtol, atol=rtol * np.abs(np.nan_to_num(one)).max())


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_it_is_the_sum_over_the_steps_and_so_are_its_slopes(params, samples, in_chunks, case):
    changes, options = CASES[case]
    params = params._replace(bias=params.bias._replace(**changes))
    weight = jnp.linspace(0.5, 1.5, 40)
    arguments = (params, samples, weight)
    expected = jax.jit(partial(values_and_slopes, by_samples, options))(*arguments)
    got = jax.jit(partial(values_and_slopes, in_chunks, options))(*arguments)
    assert_close(got[0], expected[0], 1e-10)
    assert_close(got[1], expected[1], 1e-6)  # the textbook filter's own rounding, for sharp encoders


@pytest.mark.slow
def test_many_logs_are_each_log(params, samples, in_chunks, monkeypatch):
    """In tiles, the last of which is filled up; each with a clock of its own."""
    monkeypatch.setattr(route, "TILE", 3)
    logs = [
        samples,
        samples._replace(wrench=2 * samples.wrench),
        samples._replace(q=samples.q + 0.1),
        samples._replace(dt=1.5 * samples.dt, dq=samples.dq / 1.5),
        samples._replace(dq=samples.dq + 0.2),
    ]
    many, weight = jax.tree.map(lambda *x: jnp.stack(x), *logs), jnp.ones(40)
    one = jax.jit(partial(values_and_slopes, in_chunks, Options()))
    together = jax.jit(jax.vmap(partial(values_and_slopes, in_chunks, Options()), (None, 0, None)))(
        params, many, weight
    )
    for i, log in enumerate(logs):
        value, slopes = jax.tree.map(lambda x, i=i: x[i], together)
        expected, expected_slopes = one(params, log, weight)
        assert_close(value, expected, 1e-10)
        assert_close(slopes, expected_slopes, 1e-6)  # slopes in the prior lose digits


def test_what_is_kept_for_slopes_is_the_log_and_little_else(params, samples):
    """At most 250 bytes a sample, with the 112 of the log of three joints and its weights."""
    length = 20_000
    log = jax.tree.map(lambda x: jax.ShapeDtypeStruct((length, *x.shape[1:]), x.dtype), samples)

    def pull(params, log):
        score = lambda p: sum(route.log_likelihoods(p, pipeline.init(p, log), log, log.dt, Options()))  # noqa: E731
        return jax.vjp(score, params)[1]

    kept = jax.tree.leaves(jax.eval_shape(pull, params, log))
    assert sum(x.size * x.dtype.itemsize for x in kept) < 250 * length
