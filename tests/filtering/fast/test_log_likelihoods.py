"""The likelihood in chunks, of which nothing is stored, is the sum over the steps; so are its slopes."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.filtering import pipeline
from ftbias_jax.filtering.fast import log_likelihoods as route
from ftbias_jax.filtering.pipeline import Options
from ftbias_jax.filtering.samples import pad

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
def test_many_logs_are_each_log(params, samples, in_chunks):
    """One after the other, each with a clock of its own; padding, here a chunk of it and more, changes nothing."""
    logs = [
        samples,
        samples._replace(wrench=2 * samples.wrench),
        samples._replace(dt=1.5 * samples.dt, dq=samples.dq / 1.5),
    ]
    length, weight = len(samples.dt), jnp.ones(len(samples.dt))
    many = jax.tree.map(lambda *x: jnp.stack(x), *(pad(log, length + 24) for log in logs))
    one = jax.jit(partial(values_and_slopes, in_chunks, Options()))
    together = jax.jit(jax.vmap(partial(values_and_slopes, in_chunks, Options()), (None, 0, None)))(
        params, many, jnp.pad(weight, (0, 24))
    )
    for i, log in enumerate(logs):
        value, (of_params, *of_samples) = jax.tree.map(lambda x, i=i: x[i], together)
        expected, expected_slopes = one(params, log, weight)
        assert_close(value, expected, 1e-10)
        assert_close((of_params, *(x[:length] for x in of_samples)), expected_slopes, 1e-6)  # the prior's lose digits
        assert not any(x[length:].any() for x in of_samples)


def test_only_padding_is_left_out(samples):
    """Neither a gap, in which time passes, nor measurements at one stamp."""
    chunk = jax.tree.map(lambda x: x[:8], samples)
    nothing = pad(jax.tree.map(lambda x: x[:0], chunk), 8)
    done = lambda samples: route._unless_empty(lambda chunk: 1, lambda chunk: 0, (samples, jnp.ones(8)))  # noqa: E731
    assert done(chunk) == 1
    assert done(nothing) == 0
    assert done(nothing._replace(dt=chunk.dt)) == 1
    assert done(nothing._replace(wrench=nothing.wrench.at[3, 2].set(1.0))) == 1
    assert done(nothing._replace(dq=nothing.dq.at[7, 0].set(1.0))) == 1


def test_what_is_kept_for_slopes_is_the_log_and_little_else(params, samples):
    """At most 250 bytes a sample, with the 112 of the log of three joints and its weights."""
    length = 20_000
    log = jax.tree.map(lambda x: jax.ShapeDtypeStruct((length, *x.shape[1:]), x.dtype), samples)

    def pull(params, log):
        score = lambda p: sum(route.log_likelihoods(p, pipeline.init(p, log), log, log.dt, Options()))  # noqa: E731
        return jax.vjp(score, params)[1]

    kept = jax.tree.leaves(jax.eval_shape(pull, params, log))
    assert sum(x.size * x.dtype.itemsize for x in kept) < 250 * length
