"""Least squares on whitened innovations: linearisation, and standard errors that allow for correlated errors."""

import jax.numpy as jnp
import numpy as np

from ftbias_jax.filtering import innovation_regression, likelihood
from ftbias_jax.filtering.likelihood import WrenchProblem

COUNT, DT = 2000, 0.05
T = DT * np.arange(COUNT)
WAVES = np.stack([np.sin(3 * T), np.cos(5 * T), np.sin(7 * T)])[:, :, None] * np.ones(6)  # (3, T, 6)
NO_BIAS = np.zeros((3, 6))
STD = np.array([0.1, 0.2, 0.1, 0.01, 0.02, 0.01])


def problem_of(wrench):
    """A constant bias with a wide prior."""
    variance = np.broadcast_to(STD**2, (COUNT, 6))
    arrays = (np.r_[0.0, np.full(COUNT - 1, DT)], wrench, variance, np.full(6, 1e-9), np.repeat([10.0, 1e-9], 6))
    return WrenchProblem(*map(jnp.asarray, arrays))


def curved(values):
    """A nonlinear model: (2,) -> (T, 6)."""
    return jnp.tensordot(jnp.stack([values[0], values[0] * values[1], values[1] ** 2]), jnp.asarray(WAVES), 1)


def straight(values):
    """A linear model: (2,) -> (T, 6)."""
    return jnp.tensordot(values, jnp.asarray(WAVES[:2]), 1)


def test_a_model_is_linearised_where_it_stands():
    rng = np.random.default_rng(0)
    wrench = rng.normal(size=(COUNT, 6))
    wrench[100:200, 2] = np.nan
    problem, at = problem_of(wrench), np.array([0.7, -0.4])
    linear = innovation_regression.linearise(problem, curved, jnp.asarray(at))
    for got, expected in zip(linear[:4], linear_at(problem, at)[:4], strict=True):
        np.testing.assert_allclose(got, expected, rtol=1e-9, atol=1e-9)
    assert (linear.residual[100:200, 2] == 0).all()


def test_a_linear_model_is_moved_as_it_would_be_linearised_there():
    problem, at, to = problem_of(noisy(1.0, 4)), np.array([0.7, -0.4]), np.array([0.2, 1.3])
    linear, there = (innovation_regression.linearise(problem, straight, jnp.asarray(x)) for x in (at, to))
    for got, expected in zip(linear.moved(to), there, strict=True):
        np.testing.assert_allclose(got, expected, rtol=1e-9, atol=1e-9)


def test_the_bias_after_the_last_sample_is_that_of_the_filter_and_moves_with_the_parameters():
    """The bias is constant: it is the mean of the residual, with the prior as one more reading."""
    at = np.array([0.7, -0.4])
    wrench = noisy(1.0, 4) - np.array([3.0, -2.0, 8.0, 0.1, 0.2, -0.3])
    linear = innovation_regression.linearise(problem_of(wrench), curved, jnp.asarray(at))
    weight = STD**-2.0 / (COUNT * STD**-2.0 + 1e-2)
    error = np.asarray(curved(at)) - wrench
    np.testing.assert_allclose(linear.bias, weight * error.sum(0), rtol=1e-4)
    np.testing.assert_allclose(linear.bias_slopes, weight * slopes_at(at).sum(1), rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(linear.bias_variance, weight * STD**2, rtol=1e-4)


def noisy(scale, seed, hold=1):
    """Readings of the model at (0.7, -0.4) with noise ``scale`` times the stated, constant over ``hold`` samples."""
    noise = np.random.default_rng(seed).normal(size=(-(-COUNT // hold), 6)).repeat(hold, 0)[:COUNT]
    return np.asarray(curved(np.array([0.7, -0.4]))) + scale * STD * noise


def estimates_and_errors(scale, hold):
    """Estimates by one Newton step from the truth for 30 logs, and their stated standard errors, (30, 2) each."""
    at, found = np.array([0.7, -0.4]), []
    for seed in range(30):
        problem = problem_of(noisy(scale, seed, hold))
        linear = linear_at(problem, at)
        normal = linear.information
        step = -np.linalg.solve(normal, np.einsum("ptc,tc->p", linear.columns, linear.residual))
        found.append((step, np.sqrt(np.diag(innovation_regression.covariance(linear, problem.dt, normal)))))
    return map(np.array, zip(*found, strict=True))


def slopes_at(at):
    return np.stack([WAVES[0] + at[1] * WAVES[1], at[0] * WAVES[1] + 2 * at[1] * WAVES[2]])


def linear_at(problem, at):
    """The linearisation, with the derivatives written out."""
    error = np.asarray(curved(at)) - np.asarray(problem.wrench)
    white = np.asarray(likelihood.whiten(problem, jnp.asarray(np.concatenate([slopes_at(at), error[None]]))))
    return innovation_regression.Linear(
        at, white[:2], white[2], np.einsum("atc,btc->ab", white[:2], white[:2]), *NO_BIAS
    )


def test_standard_errors_of_white_noise_are_those_of_the_information():
    step, stderr = estimates_and_errors(1.0, 1)
    spread = np.sqrt((step**2).mean(0))
    np.testing.assert_allclose(spread, np.median(stderr, 0), rtol=0.4)


def test_standard_errors_grow_with_errors_that_hang_together():
    """Noise is constant over ten samples, so there is a tenth of the independent ones that the information assumes."""
    step, stderr = estimates_and_errors(1.0, 10)
    naive = estimates_and_errors(1.0, 1)
    spread = np.sqrt((step**2).mean(0))
    assert (spread > 1.5 * np.median(list(naive)[1], 0)).all()
    np.testing.assert_allclose(np.median(stderr, 0), spread, rtol=0.4)
