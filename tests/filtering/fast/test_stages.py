"""The staged route is pipeline.run, forward and in reverse."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.filtering import pipeline
from ftbias_jax.filtering.fast import stages
from ftbias_jax.filtering.pipeline import Options


def whole_run(params, samples, options):
    """What pipeline.run says of every sample, by name, 0 where nothing was measured; and the last state."""
    last, (states, infos) = pipeline.run(params, pipeline.init(params, samples), samples, options)
    return {
        "last state": last,
        "joints": states.joint,
        "bias": states.bias.mean.reshape(-1, 2, 6),
        "bias covariance": jnp.diagonal(states.bias.covariance.reshape(-1, 2, 6, 2, 6), axis1=2, axis2=4),
        "innovation": jnp.nan_to_num(infos.wrench.value),
        "innovation variance": jnp.diagonal(infos.wrench.covariance, axis1=1, axis2=2),
        "joint innovation": jnp.nan_to_num(infos.joint.value),
        "nis": infos.wrench.nis,
        "joint nis": infos.joint.nis,
        "log likelihood": infos.log_likelihood,
        "wrench of the tool": infos.wrench_tool,
    }


def staged_run(params, samples, options, run=stages.run):
    last, (joint, wrench, wrench_tool) = run(params, pipeline.init(params, samples), samples, options)
    return {
        "last state": last,
        "joints": stages.joint_states(joint),
        "bias": wrench.mean,
        "bias covariance": wrench.covariance,
        "innovation": wrench.innovation[:, 0],
        "innovation variance": wrench.innovation_variance[:, 0],
        "joint innovation": jnp.swapaxes(joint.innovation, 1, 2),
        "nis": wrench.nis.sum(1),
        "joint nis": joint.nis,
        "log likelihood": joint.log_likelihood.sum(1) + wrench.log_likelihood.sum(1),
        "wrench of the tool": wrench_tool,
    }


def assert_all_close(got, expected, rtol):
    for (path, one), other in zip(jax.tree.leaves_with_path(expected), jax.tree.leaves(got), strict=True):
        atol = rtol / 10 * np.abs(one).max()
        np.testing.assert_allclose(other, one, rtol=rtol, atol=atol, err_msg=jax.tree_util.keystr(path))


def test_staged_run_equals_pipeline_run(params, samples):
    """With other options than the default, which comes below."""
    expected, got = (run(params, samples, Options("acceleration", "none")) for run in (whole_run, staged_run))
    assert_all_close(got, expected, 1e-9)


@partial(jax.jit, static_argnums=0)
def with_slopes(run, params, samples, weights):
    """The outputs of a run, and the derivative of their weighted sum in every parameter."""

    def score(params):
        outputs = run(params, samples, Options())
        return sum(map(jnp.vdot, jax.tree.leaves(weights), jax.tree.leaves(outputs))), outputs

    slopes, outputs = jax.grad(score, has_aux=True)(params)
    return outputs, slopes


def test_and_in_the_derivative_of_every_output_in_every_parameter(params, samples):
    rng = np.random.default_rng(0)
    shapes = jax.eval_shape(partial(whole_run, options=Options()), params, samples)
    weights = jax.tree.map(lambda x: rng.normal(size=x.shape), shapes)
    # A covariance is symmetric, and so is its weight.
    for gaussian in (weights["joints"], weights["last state"].joint, weights["last state"].bias):
        gaussian.covariance[:] = gaussian.covariance + np.swapaxes(gaussian.covariance, -1, -2)
    weights["bias covariance"] += np.swapaxes(weights["bias covariance"], 1, 2)
    expected, got = (with_slopes(run, params, samples, weights) for run in (whole_run, staged_run))
    assert_all_close(got[0], expected[0], 1e-9)
    assert_all_close(got[1], expected[1], 1e-6)  # the textbook filter's own rounding, for sharp encoders


@pytest.fixture
def in_chunks(monkeypatch):
    """The staged run with chunks so small that the log has two whole ones and a part."""
    monkeypatch.setattr(stages, "CHUNK", 16)
    monkeypatch.setattr(stages, "PIECE", 8)
    return partial(staged_run, run=stages.run.__wrapped__)  # what was compiled before has other chunks


def test_so_is_a_log_in_chunks_of_time(params, samples, in_chunks):
    """With the model whose noise does not shrink with dt: padding must not reach the last state."""
    options = Options("acceleration")
    expected, got = (jax.jit(partial(run, options=options))(params, samples) for run in (whole_run, in_chunks))
    assert_all_close(got, expected, 1e-9)


def test_and_its_slopes(params, samples, in_chunks):
    def slopes(run):
        def score(params):
            outputs = run(params, samples, Options())
            return (outputs["log likelihood"] * jnp.cos(jnp.arange(40))).sum() + outputs["bias"].sum()

        return jax.jit(jax.grad(score))(params)

    assert_all_close(slopes(in_chunks), slopes(staged_run), 1e-7)  # slopes in the prior lose digits


def test_many_logs_are_each_log(params, samples):
    """Under vmap a processor takes one log at a time."""
    logs = [samples, samples._replace(wrench=2 * samples.wrench), samples._replace(q=samples.q + 0.1)]
    many = jax.tree.map(lambda *x: jnp.stack(x), *logs)

    def slopes(samples):
        return jax.value_and_grad(lambda p: staged_run(p, samples, Options())["log likelihood"].sum())(params)

    together = jax.jit(jax.vmap(slopes))(many)
    for i, log in enumerate(logs):
        assert_all_close(jax.tree.map(lambda x, i=i: x[i], together), jax.jit(slopes)(log), 1e-9)


def test_it_applies_where_the_axes_are_independent():
    """Structure decides, so that jit, vmap and gradients always take the same route."""
    assert stages.applies(Options())
    assert stages.applies(Options(joint_uncertainty="none"))
    assert not stages.applies(Options(joint_uncertainty="full"))
