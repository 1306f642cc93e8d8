"""The fast recursion and its hand-written reverse pass against the textbook filter, its autodiff and dense algebra."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_filters import COUNT, GAP, LANES, MODELS, models, problem, sizes

from ftbias_jax.filtering import gaussian
from ftbias_jax.filtering.fast.rts import smooth_track
from ftbias_jax.filtering.fast.scan import Inputs, filter_scan, innovations
from ftbias_jax.filtering.process_models import matrix
from ftbias_jax.types import Gaussian

seeds = st.integers(0, 2**32 - 1)
filter_log = jax.jit(filter_scan, static_argnums=0)
smooth_log = jax.jit(lambda model, inputs: smooth_track(model, inputs, filter_scan(model, inputs)), static_argnums=0)


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
    """They are linear in the measurements."""
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
    """The outputs, and the derivative of their weighted sum in every input but the times."""

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
        if expected is None:  # nothing drives these filters
            continue
        # Slopes in the prior pass through the whole log; seeds differ in how many digits that costs.
        np.testing.assert_allclose(slopes[name], expected, rtol=1e-8, atol=1e-8 * np.abs(expected).max(), err_msg=name)


def test_the_gap_makes_a_joint_start_again():
    """The test above compares restarts only if there are any."""
    inputs = problem("integrated_jerk", 0)
    track = filter_log(MODELS["integrated_jerk"], inputs)
    np.testing.assert_allclose(track.innovation_variance[GAP], inputs.restart_variance[:2] + inputs.variance[GAP])


@pytest.mark.parametrize("model", ["integrated_jerk", "drift"])
def test_float32_stays_float32_and_close(model):
    wide = problem(model, 1)
    narrow = jax.tree.map(lambda x: x.astype("float32"), wide)
    tolerance = np.sqrt(np.finfo("float32").eps)
    for got, expected in zip(filter_log(MODELS[model], narrow), filter_log(MODELS[model], wide), strict=True):
        assert got.dtype == jnp.float32
        np.testing.assert_allclose(got, expected, rtol=tolerance, atol=tolerance * np.abs(expected).max())


@partial(jax.jit, static_argnums=0)
def steps(model, dt, density):
    """A and Q (T, k, k) of every step."""
    return jax.vmap(lambda dt: tuple(map(matrix, MODELS[model](dt, density))))(dt)


def posterior(model, inputs, lane):
    """Means (T, k) and covariances (T, k, k) of one lane by conditioning one big normal distribution of all states."""
    k, m = sizes(model)
    A, Q = map(np.asarray, steps(model, inputs.dt, inputs.density[lane]))
    mean, P = np.asarray(inputs.mean[:, lane]), np.asarray(inputs.covariance[..., lane])
    means, joint = [], np.zeros((COUNT, k, COUNT, k))
    for i in range(COUNT):
        mean, P = A[i] @ mean, A[i] @ P @ A[i].T + Q[i]
        means.append(mean)
        ahead = P
        for j in range(i, COUNT):
            ahead = ahead if i == j else ahead @ A[j].T
            joint[i, :, j], joint[j, :, i] = ahead, ahead.T
    y, mean, joint = np.asarray(inputs.y[..., lane]), np.stack(means), joint.reshape(COUNT * k, COUNT * k)
    seen = np.isfinite(y)
    measured = (k * np.arange(COUNT)[:, None] + np.arange(m))[seen]
    gain = joint[:, measured] @ np.linalg.inv(
        joint[np.ix_(measured, measured)] + np.diag(np.asarray(inputs.variance[..., lane])[seen])
    )
    mean = mean + (gain @ (y - mean[:, :m])[seen]).reshape(COUNT, k)
    covariance = (joint - gain @ joint[measured]).reshape(COUNT, k, COUNT, k)
    return mean, covariance[np.arange(COUNT), :, np.arange(COUNT)]


@models
def test_smoothed_states_are_the_posterior_given_the_whole_log(model):
    inputs = problem(model, 2, gap=False)._replace(restart_variance=jnp.full((sizes(model)[0], LANES), jnp.inf))
    smoothed = smooth_log(MODELS[model], inputs)
    for lane in range(LANES):
        mean, covariance = posterior(model, inputs, lane)
        np.testing.assert_allclose(smoothed.mean[..., lane], mean, rtol=1e-6, atol=1e-7)
        np.testing.assert_allclose(smoothed.covariance[..., lane], covariance, rtol=1e-6, atol=1e-7)


def test_what_comes_after_a_restart_says_nothing_about_before():
    inputs = problem("integrated_jerk", 3)
    silent = inputs._replace(y=inputs.y.at[GAP:].set(jnp.nan))
    whole, before = (smooth_log(MODELS["integrated_jerk"], x) for x in (inputs, silent))
    np.testing.assert_allclose(whole.mean[:GAP], before.mean[:GAP], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(whole.covariance[:GAP], before.covariance[:GAP], rtol=1e-12, atol=1e-12)
