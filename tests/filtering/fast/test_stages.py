"""The fast route of pipeline.run is the scan of single steps, forward and in reverse."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_filters import ALL, PARTS, assert_all_close, parts, with_part

from ftbias_jax.filtering import pipeline
from ftbias_jax.filtering.fast import stages
from ftbias_jax.filtering.pipeline import Options

GATE = 40.0
"""Standard deviations; large, because the log's errors do not match its parameters."""


def outputs_of(params, samples, options, run=pipeline.run):
    """Last state, and state and info of every sample, 0 where nothing was measured."""
    last, (states, infos) = run(params, pipeline.init(params, samples), samples, options, pipeline.keep_all)
    floats = jax.tree.map(lambda x: x.astype(params.theta.dtype), infos)  # counts have no derivatives
    return last, states, jax.tree.map(jnp.nan_to_num, floats)


by_definition = partial(outputs_of, run=pipeline.scan_steps)


def touched(samples):
    """The log with a contact, which the gate rejects, and a sensor that is set to zero after it."""
    return samples._replace(wrench=samples.wrench.at[20:26].add(30.0), rezeroed=jnp.zeros(40).at[30].set(1.0))


@pytest.mark.parametrize(
    ("part", "options"),
    [
        ("as stated", Options("acceleration", "none")),
        *((part, Options()) for part in PARTS if part != "as stated"),
        (ALL, Options(gate=GATE)),
    ],
)
def test_the_fast_route_is_the_scan_of_steps(params, samples, part, options):
    moved, log = with_part(params, part), touched(samples)
    expected, got = (run(moved, log, options) for run in (by_definition, outputs_of))
    assert_all_close(got, expected, 1e-9)
    assert got[2].wrench.count[:20].any()
    assert got[2].wrench.count[20:26].any() == (options.gate is None)


@partial(jax.jit, static_argnums=0)
def with_slopes(run, params, samples, weights):
    """The outputs of a run, and the derivative of their weighted sum with respect to every parameter."""

    def score(params):
        outputs = run(params, samples, Options())
        return sum(map(jnp.vdot, jax.tree.leaves(weights), jax.tree.leaves(outputs))), outputs

    slopes, outputs = jax.grad(score, has_aux=True)(params)
    return outputs, slopes


@pytest.mark.slow
def test_and_in_the_derivative_of_every_output_in_every_parameter(params, samples):
    rng = np.random.default_rng(0)
    shapes = jax.eval_shape(partial(outputs_of, options=Options()), params, samples)
    weights = jax.tree.map(lambda x: rng.normal(size=x.shape), shapes)
    last, states, _ = weights
    for gaussian in (last.joint, last.bias, states.joint, states.bias):  # a covariance is symmetric, so is its weight
        gaussian.covariance[:] = gaussian.covariance + np.swapaxes(gaussian.covariance, -1, -2)
    expected, got = (with_slopes(run, params, samples, weights) for run in (by_definition, outputs_of))
    assert_all_close(got[0], expected[0], 1e-9)
    assert_all_close(got[1], expected[1], 1e-6)  # rounding errors of the textbook filter, for precise encoders


@pytest.mark.slow
@pytest.mark.parametrize("gate", [None, GATE])
@parts
def test_and_in_the_gradient_of_the_likelihood_in_the_noise_of_the_bias(params, samples, part, gate):
    """The set of samples that the gate rejects counts as constant."""
    moved, log = with_part(params, part), touched(samples)

    def nats(run, bias):
        return run(moved._replace(bias=bias), log, Options(gate=gate))[2].log_likelihood.sum()

    slow, fast = (jax.jit(jax.grad(partial(nats, run)))(moved.bias) for run in (by_definition, outputs_of))
    assert_all_close(fast, slow, 1e-7)


@pytest.fixture
def in_chunks(monkeypatch):
    """The fast route with chunks so small that the log has two whole ones and a part."""
    monkeypatch.setattr(stages, "PIECE_SAMPLES", 16)
    monkeypatch.setattr(stages, "PIECE", 8)
    monkeypatch.setattr(stages, "run", stages.run.__wrapped__)  # a program compiled before has other chunks
    return partial(outputs_of, run=pipeline.run.__wrapped__)


def test_so_is_a_log_in_chunks_of_time(params, samples, in_chunks):
    """The process model's noise does not shrink with dt: padding must not reach the last state."""
    options = Options("acceleration")
    expected, got = (jax.jit(partial(run, options=options))(params, samples) for run in (by_definition, in_chunks))
    assert_all_close(got, expected, 1e-9)


def score(run, params, samples):
    """A number that depends on every sample's likelihood and bias, with the default options."""
    _, states, infos = run(params, samples, Options())
    return (infos.log_likelihood * jnp.cos(jnp.arange(40))).sum() + states.bias.mean[:, :6].sum()


@pytest.mark.slow
def test_and_its_slopes(params, samples, in_chunks):
    chunked, whole = (jax.jit(jax.grad(partial(score, run)))(params, samples) for run in (in_chunks, outputs_of))
    without = [x._replace(joint=x.joint._replace(prior_std=0.0)) for x in (chunked, whole)]
    assert_all_close(*without, 1e-7)
    assert_all_close(chunked.joint.prior_std, whole.joint.prior_std, 1e-6)  # these cancel, and lose digits


@pytest.mark.slow
@pytest.mark.parametrize("part", ["as stated", ALL])
def test_many_logs_are_each_log(params, samples, part):
    """Under vmap a processor takes one log at a time; XLA once ended the process at gradients of this."""
    logs = [samples, samples._replace(wrench=2 * samples.wrench), samples._replace(q=samples.q + 0.1)]
    many = jax.tree.map(lambda *x: jnp.stack(x), *logs)
    slopes = partial(jax.value_and_grad(partial(score, outputs_of)), with_part(params, part))
    together = jax.jit(jax.vmap(slopes))(many)
    one = jax.jit(slopes)
    for i, log in enumerate(logs):
        assert_all_close(jax.tree.map(lambda x, i=i: x[i], together), one(log), 1e-6)  # those of the prior lose digits
