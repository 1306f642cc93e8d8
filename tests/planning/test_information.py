import jax.numpy as jnp
import numpy as np

from ftbias_jax.filtering.likelihood import WrenchProblem, whiten
from ftbias_jax.planning.information import bias_shapes, information, inverse, mean_log_error, unexplained

U, P = 120, 4
T = np.arange(U) * 0.1
DENSITY = np.repeat([2e-2, 1e-3], 3)
PRIOR = np.concatenate([np.repeat([5.0, 0.5], 3), np.repeat([0.02, 1e-3], 3)])


def columns_and_variance(seed=0):
    rng = np.random.default_rng(seed)
    smooth = np.cumsum(rng.normal(size=(P, U, 6)), 1)
    return smooth, rng.uniform(0.5, 2, (U, 6)) * np.repeat([1e-2, 1e-5], 3)


def test_it_is_the_information_of_whitened_innovations_of_the_bias_filter():
    columns, variance = columns_and_variance()
    dt = jnp.asarray(np.diff(T, prepend=T[0]))
    problem = WrenchProblem(dt, jnp.zeros((U, 6)), jnp.asarray(variance), jnp.asarray(DENSITY), jnp.asarray(PRIOR))
    white = np.asarray(whiten(problem, jnp.asarray(columns))).reshape(P, -1)
    told = information(jnp.asarray(columns), jnp.asarray(variance), bias_shapes(T, DENSITY, PRIOR))
    np.testing.assert_allclose(told, white @ white.T, rtol=1e-3, atol=1e-4 * np.trace(white @ white.T) / P)


def test_it_is_that_of_a_dense_covariance_with_constant_slope_and_integrated_random_walk():
    columns, variance = columns_and_variance(1)
    low, high = np.minimum.outer(T, T), np.maximum.outer(T, T)
    walk = low**2 * (3 * high - low) / 6
    expected = np.zeros((P, P))
    for k in range(6):
        bias = PRIOR[k] ** 2 + PRIOR[6 + k] ** 2 * np.outer(T, T) + DENSITY[k] ** 2 * walk
        expected += columns[:, :, k] @ np.linalg.solve(bias + np.diag(variance[:, k]), columns[:, :, k].T)
    told = information(jnp.asarray(columns), jnp.asarray(variance), bias_shapes(T, DENSITY, PRIOR))
    np.testing.assert_allclose(told, expected, rtol=1e-3, atol=1e-4 * np.trace(expected) / P)


def test_what_is_as_constant_as_the_bias_says_next_to_nothing():
    column, variance = np.ones((1, U, 6)), np.full((U, 6), 1e-4)
    told = information(jnp.asarray(column), jnp.asarray(variance), bias_shapes(T, DENSITY, PRIOR))
    assert told[0, 0] < 1.01 * (PRIOR[:6] ** -2.0).sum()


def test_the_inverse_is_that_of_numpy():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(12, 12)) * np.geomspace(1, 1e3, 12)[:, None]
    matrix = root @ root.T
    np.testing.assert_allclose(inverse(jnp.asarray(matrix)) @ matrix, np.eye(12), atol=1e-6)


def test_the_mean_log_error_is_that_of_the_axes_of_the_error_ellipsoid():
    rng = np.random.default_rng(1)
    root, scale = rng.normal(size=(5, 5)), rng.uniform(0.1, 10, 5)
    scaled = root @ root.T * np.outer(scale, scale) + np.eye(5) / 30**2
    axes = np.linalg.eigvalsh(np.linalg.inv(scaled)) ** 0.5
    found = mean_log_error(jnp.asarray(root @ root.T), jnp.asarray(scale), 30.0)
    np.testing.assert_allclose(found, np.log(axes).mean(), rtol=1e-9)


def test_unexplained_is_half_of_the_squares_that_least_squares_leaves():
    rng = np.random.default_rng(3)
    first, others = rng.normal(size=40), rng.normal(size=(3, 40)) * [[1e3], [1], [1e-3]]
    rest = first - others.T @ np.linalg.lstsq(others.T, first, rcond=None)[0]
    whole = np.concatenate([first[None], others])
    np.testing.assert_allclose(unexplained(jnp.asarray(whole @ whole.T)), rest @ rest / 2, rtol=1e-6)
