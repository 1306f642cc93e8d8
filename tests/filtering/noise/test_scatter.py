"""The compiled fit of a variance against scipy's bounded optimiser, and against its normal equations."""

import jax
import numpy as np
import pytest
from scipy.optimize import minimize, nnls

from ftbias_jax.filtering.noise.scatter import (
    HEAVY,
    Scatter,
    maximise,
    variance_of,
)

COUNT = 70
fit = jax.jit(maximise, static_argnums=1)


def data_of(parts, joints, spikes=True):
    """Data with two choices of motion and two fits, the second of which uses the first half of the blocks."""
    rng = np.random.default_rng(0)
    stated = tuple(rng.uniform(0.5, 2, (COUNT, 6)) for _ in range(parts))
    dof = rng.integers(0, 20, (COUNT, 6)).astype(float)
    dof[:, 4] = 0  # an axis that nobody measured
    value = rng.gamma(3, 0.5, (COUNT, 6))
    value[5] *= 100 if spikes else 1
    motion = rng.uniform(0.5, 3, (2, COUNT, joints))
    half = dof * (np.arange(COUNT) < COUNT / 2)[:, None]
    return Scatter(value, np.stack([dof, half]), stated, motion, np.median(value, 0))


def by_scipy(data, choice, half, axis):
    """Log-likelihood of the maximum-likelihood coefficients of one fit."""
    columns = np.column_stack([*(part[:, axis] for part in data.stated), *data.motion[choice].T])
    dof, value = data.dof[half, :, axis], data.value[:, axis]

    def cost(b):
        mu = columns @ b
        return (dof * (np.log(mu) + value / mu)).sum() / 2, columns.T @ (dof * (1 - value / mu) / mu) / 2

    start = np.full(columns.shape[1], 0.3)
    return -minimize(cost, start, jac=True, bounds=[(1e-9, None)] * len(start), method="L-BFGS-B").fun


@pytest.mark.parametrize(("parts", "joints"), [(1, 0), (2, 3)])
def test_the_fit_is_the_likeliest_one(parts, joints):
    data = data_of(parts, joints, spikes=False)
    data = data._replace(value=np.minimum(data.value, 3.0))  # no reading is clipped at HEAVY, so the cost is smooth
    found = fit(data, 20)
    mu = np.asarray(variance_of(data, found))
    for choice in (0, 1):
        for half in (0, 1):
            dof = data.dof[half]
            nats = -(dof * (np.log(mu[choice, half]) + data.value / mu[choice, half])).sum(0) / 2
            for axis in (0, 1, 5):
                assert nats[axis] == pytest.approx(by_scipy(data, choice, half, axis), abs=1e-3)
    np.testing.assert_array_equal(found.shares[:, :, 4], 0)
    np.testing.assert_array_equal(found.per_speed[:, :, 4], 0)


def test_spikes_count_as_heavy_ones():
    """The fit solves the equations of the readings clipped at HEAVY."""
    data = data_of(2, 2)
    found = fit(data, 30)
    mu = np.asarray(variance_of(data, found))[0, 0, :, 0]
    cut = np.minimum(data.value[:, 0], HEAVY * mu)
    columns = np.column_stack([*(part[:, 0] for part in data.stated), *data.motion[0].T])
    root = np.sqrt(data.dof[0, :, 0]) / mu
    expected, _ = nnls(columns * root[:, None], cut * root)
    got = np.concatenate([found.shares[0, 0, 0], found.per_speed[0, 0, 0]])
    np.testing.assert_allclose(got, expected, rtol=1e-3, atol=1e-3)


def test_what_does_not_move_adds_nothing():
    data = data_of(1, 2)
    data = data._replace(motion=data.motion * [[[0.0, 0.0]], [[1.0, 0.0]]])
    found = fit(data, 10)
    np.testing.assert_array_equal(found.per_speed[0], 0)
    np.testing.assert_array_equal(found.per_speed[1, ..., 1], 0)
    assert (np.asarray(found.per_speed)[1, 0, [0, 1, 2, 3, 5], 0] > 0).any()
