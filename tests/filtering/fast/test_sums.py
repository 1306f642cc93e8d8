"""Sums are those over filter_scan, and so are their slopes; many logs are each log."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.filtering.fast.scan import Inputs, Sums, filter_scan, filter_sums
from ftbias_jax.filtering.process_models import JOINT_MODELS, drift_noise

LENGTH, LANES = 12, 4
WEIGHT = jnp.linspace(0.5, 1.5, LENGTH).at[2].set(0.0)
CASES = {"joints": (JOINT_MODELS["integrated_jerk"], 3, 2), "bias": (drift_noise, 2, 1)}


def made(k, m, seed=0):
    """Measurements with gaps, one of which is so long that joints start again after it."""
    rng = np.random.default_rng(seed)
    y = rng.normal(size=(LENGTH, m, LANES))
    y[rng.uniform(size=y.shape) < 0.3] = np.nan
    y[4] = np.nan
    root = rng.normal(size=(LANES, k, k))
    restart = np.full((k, LANES), 20.0 if m == 2 else np.inf)
    return Inputs(
        jnp.asarray(rng.uniform(0.1, 0.5, LENGTH)).at[6].set(8.0),
        jnp.asarray(rng.uniform(0.5, 2, LANES)),
        jnp.asarray(y),
        jnp.asarray(rng.uniform(0.1, 1, y.shape)),
        jnp.asarray(rng.normal(size=(k, LANES))),
        jnp.moveaxis(jnp.asarray(root @ np.swapaxes(root, 1, 2) + np.eye(k)), 0, -1),
        jnp.asarray(restart),
    )


def by_scan(model, inputs, weight):
    track = filter_scan(model, inputs)
    return Sums((weight[:, None] * track.log_likelihood).sum(0), track.mean[-1], track.covariance[-1], track[:2])


def by_sums(model, inputs, weight):
    sums = filter_sums(model, True, inputs, weight)
    return sums._replace(states=tuple(sums.states.stacked()))


def values_and_slopes(function, model, inputs, weight):
    """All results, and the slopes of a mixture of them in all inputs but dt."""
    rng = np.random.default_rng(1)
    k = len(inputs.mean)
    shapes = [(LANES,), (k, LANES), (k, k, LANES), (LENGTH, k, LANES), (LENGTH, k, k, LANES)]
    factors = [jnp.asarray(rng.normal(size=shape)) for shape in shapes]

    def mixture(given, weight):
        results = function(model, Inputs(inputs.dt, *given), weight)
        return sum(map(jnp.vdot, factors, jax.tree.leaves(results))), results

    return jax.value_and_grad(mixture, (0, 1), has_aux=True)(inputs[1:7], weight)


def assert_close(got, expected):
    for one, other in zip(jax.tree.leaves(expected), jax.tree.leaves(got), strict=True):
        np.testing.assert_allclose(other, one, rtol=1e-10, atol=1e-10 * np.abs(one).max())


@pytest.mark.parametrize("case", CASES)
def test_sums_and_slopes_are_those_of_the_scan(case):
    model, k, m = CASES[case]
    inputs = made(k, m)
    expected, got = (
        jax.jit(partial(values_and_slopes, function, model))(inputs, WEIGHT) for function in (by_scan, by_sums)
    )
    assert_close(got, expected)
    assert case == "bias" or np.abs(expected[1][0][5]).max() > 0  # of the restart: it happened


def test_many_logs_are_each_log():
    """Each with its own clock and gaps."""
    model, k, m = CASES["joints"]
    logs = [made(k, m, seed) for seed in range(3)]
    one = jax.jit(partial(values_and_slopes, by_sums, model))
    many = jax.tree.map(lambda *x: jnp.stack(x), *logs)
    together = jax.jit(jax.vmap(partial(values_and_slopes, by_sums, model), (0, None)))(many, WEIGHT)
    for i, log in enumerate(logs):
        assert_close(jax.tree.map(lambda x, i=i: x[i], together), one(log, WEIGHT))
