"""The fast recursion and its hand-written reverse pass against the textbook filter and its autodiff."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from small_filters import GAP, MODELS, models, problem, sizes

from ftbias_jax.filtering import gaussian
from ftbias_jax.filtering.fast.scan import Inputs, filter_scan, innovations
from ftbias_jax.filtering.process_models import matrix
from ftbias_jax.types import Gaussian

seeds = st.integers(0, 2**32 - 1)
filter_log = jax.jit(filter_scan, static_argnums=0)


def textbook(model, inputs):
    """The outputs of the scan, in its order, by one Kalman filter in matrix form for every lane."""
    k, m = sizes(model)

    def one(density, y, variance, mean, covariance, restart):
        from_rest = jnp.diag(jnp.where(jnp.isfinite(restart), restart, 1))

        def body(state, sample):
            dt, y, variance = sample
            predicted = gaussian.predict(state, *map(matrix, MODELS[model](dt, density)))
            lost = (jnp.diagonal(predicted.covariance)[:2] > restart[:2]).all()
            at_rest = Gaussian(state.mean * jnp.eye(k)[0], from_rest)
            predicted = jax.tree.map(partial(jnp.where, lost), at_rest, predicted)
            state, innovation = gaussian.update(predicted, y, jnp.eye(m, k), jnp.diag(variance))
            raw = jnp.where(jnp.isfinite(y), innovation.value, 0)
            S = jnp.diagonal(innovation.covariance)
            return state, (*state, raw, S, innovation.nis, innovation.log_likelihood)

        return jax.lax.scan(body, Gaussian(mean, covariance), (inputs.dt, y, variance))[1]

    return jax.vmap(one, in_axes=-1, out_axes=-1)(*inputs[1:7])


@models
def test_innovations_and_their_derivative_are_those_of_the_scan(model):
    """Innovations are linear in the measurements."""
    inputs = problem(model, 1)
    other = inputs._replace(y=inputs.y + np.random.default_rng(2).normal(size=inputs.y.shape))

    @jax.jit
    def derivative(y, along):
        return jax.jvp(lambda y: innovations(MODELS[model], inputs._replace(y=y)), (y,), (along,))

    got, slope = derivative(inputs.y, other.y - inputs.y)
    one, two = (filter_log(MODELS[model], x) for x in (inputs, other))
    np.testing.assert_allclose(got[0], one.innovation, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(got[1], one.innovation_variance, rtol=1e-12)
    np.testing.assert_allclose(slope[0], two.innovation - one.innovation, rtol=1e-9, atol=1e-10)
    np.testing.assert_array_equal(slope[1], 0)


def with_slopes(scan, inputs, weights):
    """The outputs, and the derivative of their weighted sum with respect to every input but the times."""

    def score(differentiated):
        outputs = scan(inputs._replace(**differentiated))
        return sum((weight * output).sum() for weight, output in zip(weights, outputs, strict=True)), outputs

    slopes, outputs = jax.grad(score, has_aux=True)({name: getattr(inputs, name) for name in Inputs._fields[1:]})
    return outputs, slopes


@partial(jax.jit, static_argnums=0)
def both_ways(model, inputs, weights):
    scan = partial(filter_scan, MODELS[model])
    return with_slopes(scan, inputs, weights), with_slopes(partial(textbook, model), inputs, weights)


@models
@given(seed=seeds)
def test_filter_and_its_reverse_pass_equal_the_textbook_and_its_autodiff(model, seed):
    inputs = problem(model, seed)
    rng = np.random.default_rng(seed)
    weights = [rng.normal(size=x.shape) for x in jax.eval_shape(partial(textbook, model), inputs)]
    weights[1] = weights[1] + np.swapaxes(weights[1], 1, 2)  # a covariance is symmetric, and so is its cotangent
    (outputs, slopes), (expected_outputs, expected_slopes) = both_ways(model, inputs, weights)
    for got, expected in zip(outputs, expected_outputs, strict=True):
        np.testing.assert_allclose(got, expected, rtol=1e-10, atol=1e-10)
    for name, expected in expected_slopes.items():
        if expected is None:  # these filters have no process noise
            continue
        # Derivatives with respect to the prior pass through the whole log; seeds differ in the digits lost.
        np.testing.assert_allclose(slopes[name], expected, rtol=1e-8, atol=1e-8 * np.abs(expected).max(), err_msg=name)


def test_the_gap_makes_a_joint_start_again():
    """The test above checks restarts only if there are any."""
    inputs = problem("integrated_jerk", 0)
    track = filter_log(MODELS["integrated_jerk"], inputs)
    np.testing.assert_allclose(track.innovation_variance[GAP], inputs.restart_variance[:2] + inputs.variance[GAP])
