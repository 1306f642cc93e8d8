"""Series that stand for an effect, against what the effect itself does to a reading."""

from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.diagnosis.hypothesis import jumps, slope_in_time, warmup
from ftbias_jax.model.effects.catalogue import CATALOGUE

T = np.tile(np.arange(0, 20, 0.05), 2)
PROBLEM = SimpleNamespace(t=T, log=np.repeat([0, 1], len(T) // 2))


@pytest.mark.parametrize("ramp", [0.0, 1.5])
def test_a_jump_is_that_of_the_catalogue_in_its_own_log(ramp):
    first, second = jumps(PROBLEM, 1, np.array([3.0, 7.5]), ramp)
    assert second.detail == (7.5, 1, ramp)
    own = PROBLEM.log == 1
    values = {"time": 7.5, "ramp": ramp, "amplitude": jnp.array([1.0, 0, 0, 0, 0, 0])}
    signals = SimpleNamespace(t=T[own])
    expected = CATALOGUE["bias_jump"].reading(values, signals, jnp.zeros((own.sum(), 6)))[:, 0]
    np.testing.assert_allclose(second.shapes[0][own], expected, atol=1e-12)
    np.testing.assert_array_equal(second.shapes[0][~own], 0)
    assert (first.shapes[0][own] <= second.shapes[0][own]).all()  # it came earlier


def test_the_slope_in_time_is_the_derivative():
    tau, t = 4.0, T[PROBLEM.log == 0]
    slope = slope_in_time(PROBLEM, warmup(PROBLEM, tau, 0))
    expected = t / tau**2 * np.exp(-t / tau)
    np.testing.assert_allclose(slope[PROBLEM.log == 0], expected, atol=0.02 * expected.max())
    np.testing.assert_array_equal(slope[PROBLEM.log == 1], 0)
