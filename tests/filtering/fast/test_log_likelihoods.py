"""The likelihood in chunks, of which nothing is stored, equals the sum over single steps; so do its derivatives."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_filters import ALL, assert_all_close, single, with_part

from ftbias_jax.filtering import pipeline
from ftbias_jax.filtering.fast import log_likelihoods as route
from ftbias_jax.filtering.pipeline import Options
from ftbias_jax.filtering.samples import pad

CASES = {
    "acceleration noise, joints known": ("as stated", Options("acceleration", "none")),
    "plain": ("as stated", Options()),
    "noise that follows the motion": ("vibration", Options("acceleration")),
    "correlated noise, vibration and gate": (ALL, Options(gate=40.0)),
}


@pytest.fixture
def in_chunks(monkeypatch):
    """Chunks of 16, so that the log's 40 samples are two chunks and a part."""
    monkeypatch.setattr(route, "CHUNK", 16)
    return route.log_likelihoods.__wrapped__


def by_samples(params, state, samples, weight, options):
    """The definition: the log-likelihoods of all samples that the pipeline reports, summed."""
    emit = lambda state, info: (info.joint.log_likelihood.sum(), info.wrench.log_likelihood)  # noqa: E731
    _, (joint, wrench) = pipeline.scan_steps(params, state, samples, options, emit)
    return (weight * joint).sum(), (weight * wrench).sum()


def values_and_slopes(function, options, params, samples, weight):
    """Both sums, and the derivatives of a mixture of them with respect to parameters, wrench and joints."""

    def mixture(params, wrench, q):
        seen = samples._replace(wrench=wrench, q=q)
        joint, wrench = function(params, pipeline.init(params, samples), seen, weight, options)
        return joint + 2 * wrench, (joint, wrench)

    return jax.value_and_grad(mixture, (0, 1, 2), has_aux=True)(params, samples.wrench, samples.q)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_it_is_the_sum_over_the_steps_and_so_are_its_slopes(params, samples, in_chunks, case):
    """The log has a gap after which every joint restarts, and a sensor that is set to zero."""
    part, options = CASES[case]
    log = samples._replace(dt=samples.dt.at[20].set(20.0), rezeroed=jnp.zeros(40).at[30].set(1.0))
    arguments = (with_part(params, part), log, jnp.linspace(0.5, 1.5, 40))
    expected = jax.jit(partial(values_and_slopes, by_samples, options))(*arguments)
    got = jax.jit(partial(values_and_slopes, in_chunks, options))(*arguments)
    assert_all_close(got[0], expected[0], 1e-10, 1e-10)
    assert_all_close(got[1], expected[1], 1e-6, 1e-6)  # rounding errors of the textbook filter, for precise encoders


def different(samples):
    """Logs with clocks, gaps, axes and lengths of their own."""
    nan = jnp.nan
    return [
        samples,
        samples._replace(wrench=(2 * samples.wrench).at[:, 1].set(nan)),
        samples._replace(dt=1.5 * samples.dt, dq=samples.dq / 1.5),
        jax.tree.map(lambda x: x[:7], samples),
        samples._replace(q=samples.q.at[5:20].set(nan), dq=samples.dq.at[:, 0].set(nan)),
    ]


@pytest.mark.slow
@pytest.mark.parametrize("case", list(CASES)[1:])
def test_many_logs_are_each_log(params, samples, in_chunks, case):
    """Each log has its own clock; padding, here of more than a chunk, changes nothing."""
    part, options = CASES[case]
    params = with_part(params, part)
    logs, length = different(samples), len(samples.dt) + 24
    many = jax.tree.map(lambda *x: jnp.stack(x), *(pad(log, length) for log in logs))
    weight = jnp.linspace(0.5, 1.5, length)
    function = partial(values_and_slopes, in_chunks, options)
    together = jax.jit(jax.vmap(function, (None, 0, None)))(params, many, weight)
    one = jax.jit(function)
    for i, log in enumerate(logs):
        value, (of_params, *of_samples) = jax.tree.map(lambda x, i=i: x[i], together)
        expected, expected_slopes = one(params, pad(log, length), weight)
        assert_all_close(value, expected, 1e-10, 1e-10)
        assert_all_close((of_params, *of_samples), expected_slopes, 1e-6, 1e-6)  # those of the prior lose digits
        assert not any(x[len(log.dt) :].any() for x in of_samples)


def test_parameters_of_their_own_are_taken_one_after_the_other(params, samples, in_chunks):
    logs = jax.tree.map(lambda x: jnp.stack([x] * 4), samples)
    densities, weight = params.bias.density[None] * jnp.arange(1.0, 5)[:, None], jnp.ones(len(samples.dt))

    def total(density, samples):
        own = params._replace(bias=params.bias._replace(density=density))
        return sum(in_chunks(own, pipeline.init(own, samples), samples, weight, Options()))

    together = jax.jit(jax.vmap(total))(densities, logs)
    np.testing.assert_allclose(together, [jax.jit(total)(density, samples) for density in densities], rtol=1e-10)


def test_in_single_precision(params, samples, in_chunks):
    params, samples = single((params, samples))
    weight = jnp.ones(len(samples.dt), jnp.float32)
    total = lambda log: sum(in_chunks(params, pipeline.init(params, log), log, weight, Options()))  # noqa: E731
    together = jax.jit(jax.vmap(total))(jax.tree.map(lambda x: jnp.stack([x] * 4), samples))
    assert together.dtype == jnp.float32
    np.testing.assert_allclose(together, jax.jit(total)(samples), rtol=1e-5)


def test_only_padding_is_left_out(samples):
    """A gap, in which time passes, and measurements at one stamp are not left out."""
    chunk = jax.tree.map(lambda x: x[:8], samples)
    nothing = pad(jax.tree.map(lambda x: x[:0], chunk), 8)
    assert route.is_there(chunk)
    assert not route.is_there(nothing)
    assert route.is_there(nothing._replace(dt=chunk.dt))
    assert route.is_there(nothing._replace(wrench=nothing.wrench.at[3, 2].set(1.0)))
    assert route.is_there(nothing._replace(dq=nothing.dq.at[7, 0].set(1.0)))


def test_what_is_kept_for_slopes_is_the_log_and_little_else(params, samples):
    """At most 250 bytes a sample, including 112 for the log of three joints and its weights."""
    length = 20_000
    log = jax.tree.map(lambda x: jax.ShapeDtypeStruct((length, *x.shape[1:]), x.dtype), samples)

    def pull(params, log):
        score = lambda p: sum(route.log_likelihoods(p, pipeline.init(p, log), log, log.dt, Options()))  # noqa: E731
        return jax.vjp(score, params)[1]

    kept = jax.tree.leaves(jax.eval_shape(pull, params, log))
    assert sum(x.size * x.dtype.itemsize for x in kept) < 250 * length
