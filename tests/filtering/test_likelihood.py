"""The likelihood of a log against the scan of steps, including derivatives, and whitening against dense algebra."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.calibration.tune import stack
from ftbias_jax.errors import UsageError
from ftbias_jax.filtering import likelihood, pipeline
from ftbias_jax.filtering.fast import stages
from ftbias_jax.filtering.likelihood import WrenchProblem, log_likelihood, log_likelihood_parts
from ftbias_jax.filtering.pipeline import Options
from ftbias_jax.filtering.process_models import drift_noise, matrix

BURN_IN = 0.1  # s, about ten samples


@pytest.mark.parametrize("burn_in", [0.0, BURN_IN])
def test_it_is_that_of_the_joints_and_that_of_the_wrench(params, samples, burn_in):
    """The sum over samples after the burn-in; each filter's likelihood is tested against the density of a whole log."""
    options = Options(uncertain_joints=False)
    got = log_likelihood_parts(params, samples, options, burn_in)
    infos = pipeline.scan_steps(params, pipeline.init(params, samples), samples, options, pipeline.keep_all)[1][1]
    counted = np.cumsum(samples.dt) >= burn_in
    np.testing.assert_allclose(got.joint, infos.joint.log_likelihood[counted].sum(), rtol=1e-7)
    np.testing.assert_allclose(got.wrench, infos.wrench.log_likelihood[counted].sum(), rtol=1e-9)
    np.testing.assert_allclose(log_likelihood(params, samples, options, burn_in), got.joint + got.wrench)
    np.testing.assert_allclose(likelihood.joint_log_likelihood(params, samples, options, burn_in), got.joint)


@pytest.mark.parametrize(
    "derivative",
    [
        pytest.param(lambda f, x: jax.jvp(f, (x,), (x,)), id="forwards"),
        pytest.param(lambda f, x: jax.hessian(f)(x), id="the Hessian"),
        pytest.param(lambda f, x: jax.jit(jax.hessian(f))(x), id="the compiled Hessian"),
        pytest.param(lambda f, x: jax.jacrev(jax.grad(f))(x), id="two reverse passes"),
    ],
)
def test_derivatives_that_a_reverse_pass_does_not_have_are_refused_in_words(params, samples, derivative):
    with pytest.raises(UsageError, match=r"neither forwards .* nor twice .*by_steps=True"):
        derivative(lambda theta: log_likelihood(params._replace(theta=theta), samples), params.theta)


@pytest.mark.slow
def test_by_steps_it_is_the_same_and_has_all_derivatives(params, samples):
    def nats(theta, by_steps=True):
        return log_likelihood(params._replace(theta=theta), samples, burn_in=BURN_IN, by_steps=by_steps)

    theta, fast = jnp.asarray(params.theta), jax.jit(jax.value_and_grad(partial(nats, by_steps=False)))
    (value, slope), (along, bend) = jax.jit(lambda x: jax.jvp(jax.value_and_grad(nats), (x,), (x,)))(theta)
    expected, gradient = fast(theta)
    np.testing.assert_allclose(value, expected, rtol=1e-9)
    np.testing.assert_allclose(slope, gradient, rtol=1e-6, atol=1e-9 * np.abs(gradient).max())
    np.testing.assert_allclose(along, gradient @ theta, rtol=1e-6)
    difference = (fast(1.0001 * theta)[1] - fast(0.9999 * theta)[1]) / 2e-4
    np.testing.assert_allclose(bend, difference, rtol=1e-3, atol=1e-3 * np.abs(difference).max())


def test_padded_logs_side_by_side_count_nothing_more(params, samples):
    short = jax.tree.map(lambda x: x[:25], samples)
    both = jax.jit(jax.vmap(lambda log: log_likelihood_parts(params, log)))(stack([samples, short]))
    for i, log in enumerate((samples, short)):
        alone = log_likelihood_parts(params, log)
        np.testing.assert_allclose(both.joint[i], alone.joint, rtol=1e-12)
        np.testing.assert_allclose(both.wrench[i], alone.wrench, rtol=1e-12)


def test_regression_on_whitened_columns_is_generalised_least_squares(linear_gaussian):
    """The bias acts as correlated measurement noise, and some measurements are missing."""
    rng = np.random.default_rng(0)
    dt = np.r_[0.0, rng.uniform(0.01, 0.1, 29)]
    wrench, columns = rng.normal(size=(30, 6)), rng.normal(size=(3, 30, 6))
    wrench[10:15, 2] = wrench[20] = np.nan
    variance, density, prior_std = rng.uniform(0.1, 1, (30, 6)), rng.uniform(0.5, 2, 6), rng.uniform(0.5, 2, 12)
    problem = WrenchProblem(*map(jnp.asarray, (dt, wrench, variance, density, prior_std)))
    whitened = likelihood.whiten(problem, jnp.asarray(np.concatenate([columns, wrench[None]]))).reshape(4, -1)
    solution, square, *_ = np.linalg.lstsq(whitened[:3].T, whitened[3])

    information, slope, power = np.zeros((3, 3)), np.zeros(3), 0.0
    for axis in range(6):
        seen = np.isfinite(wrench[:, axis])
        X, y = columns[:, seen, axis], wrench[seen, axis]
        steps = [tuple(map(matrix, drift_noise(h, density[axis]))) for h in dt]
        A, Q = (np.stack(part) for part in zip(*steps, strict=True))
        prior = np.zeros(2), np.diag(prior_std[[axis, 6 + axis]] ** 2)
        model = linear_gaussian(A, Q, np.eye(1, 2), variance[:, axis, None, None], *prior)
        weight = np.linalg.inv(model.together(wrench[:, [axis]])[-1])
        information, slope, power = information + X @ weight @ X.T, slope + X @ weight @ y, power + y @ weight @ y
    expected = np.linalg.solve(information, slope)
    np.testing.assert_allclose(solution, expected, rtol=1e-9)
    np.testing.assert_allclose(whitened[:3] @ whitened[:3].T, information, rtol=1e-9)
    np.testing.assert_allclose(square, power - slope @ expected, rtol=1e-9)


def test_the_problem_of_the_wrench_is_the_bias_filter_of_the_pipeline(params, samples):
    """The prior has a nonzero bias and drift."""
    start = pipeline.init(params, samples)
    _, track = stages.run(params, start, samples, pipeline.DEFAULT_OPTIONS)
    problem, wrench_tool = likelihood.wrench_problem(params, samples, stages.joint_states(track.joint))
    np.testing.assert_allclose(wrench_tool, track.wrench_tool, rtol=1e-12)
    whitened = likelihood.whiten(problem, (wrench_tool - problem.wrench)[None])[0]
    np.testing.assert_allclose(whitened**2, track.wrench.nis, rtol=1e-10, atol=1e-12)
