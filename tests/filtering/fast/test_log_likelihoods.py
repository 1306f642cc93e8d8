"""The likelihood in chunks, of which nothing is stored, is the sum over the steps; so are its slopes."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.filtering import pipeline
from ftbias_jax.filtering.fast import log_likelihoods as route
from ftbias_jax.filtering.pipeline import Options

NOISE = {
    "vibration": {"vibration": jnp.full((3, 6), 0.3), "vibration_speed": jnp.full(3, 0.5)},
    "correlated": {
        "vibration": jnp.full((3, 6), 0.3),
        "correlated_std": jnp.linspace(0.1, 0.6, 6),
        "correlated_time": jnp.linspace(0.05, 0.3, 6),
        "correlated_vibration": jnp.full(6, 0.5),
        "drift_time": jnp.full(6, 30.0),
    },
}
CASES = {
    "plain": ({}, Options()),
    "accel": ({}, Options("acceleration")),
    "none": ({}, Options(joint_uncertainty="none")),
    "vibration and gate": (NOISE["vibration"], Options(gate=3.0)),
    "correlated": (NOISE["correlated"], Options()),
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


def with_noise(params, changes):
    n = params.joint.position_std.shape[0]
    fitting = {k: v[:n] if k in ("vibration", "vibration_speed") else v for k, v in changes.items()}
    return params._replace(bias=params.bias._replace(**fitting))


@pytest.mark.parametrize("case", CASES)
def test_it_is_the_sum_over_the_steps_and_so_are_its_slopes(params, samples, in_chunks, case):
    changes, options = CASES[case]
    params, weight = with_noise(params, changes), jnp.linspace(0.5, 1.5, 40)
    arguments = (params, samples, weight)
    expected = jax.jit(partial(values_and_slopes, by_samples, options))(*arguments)
    got = jax.jit(partial(values_and_slopes, in_chunks, options))(*arguments)
    assert_close(got[0], expected[0], 1e-10)
    assert_close(got[1], expected[1], 1e-6)  # the textbook filter's own rounding, for sharp encoders


def test_many_logs_are_each_log(params, samples, in_chunks):
    logs = [samples, samples._replace(wrench=2 * samples.wrench), samples._replace(q=samples.q + 0.1)]
    many, weight = jax.tree.map(lambda *x: jnp.stack(x), *logs), jnp.ones(40)
    one = jax.jit(partial(values_and_slopes, in_chunks, Options()))
    together = jax.jit(jax.vmap(partial(values_and_slopes, in_chunks, Options()), (None, 0, None)))(
        params, many, weight
    )
    for i, log in enumerate(logs):
        assert_close(jax.tree.map(lambda x, i=i: x[i], together), one(params, log, weight), 1e-9)


def test_the_memory_for_slopes_does_not_grow_with_the_log(params, samples):
    """At most 250 bytes a sample beyond the log itself, its slopes and one chunk."""

    def temporary(length):
        log = jax.tree.map(lambda x: jnp.tile(x, (length // 40 + 1, *[1] * (x.ndim - 1)))[:length], samples)
        score = lambda p: sum(  # noqa: E731
            route.log_likelihoods(p, pipeline.init(p, log), log, jnp.ones(length), Options())
        )
        return jax.jit(jax.grad(score)).lower(params).compile().memory_analysis().temp_size_in_bytes

    assert (temporary(8 * route.CHUNK) - temporary(4 * route.CHUNK)) / (4 * route.CHUNK) < 250 + 4 * 8 * 13
