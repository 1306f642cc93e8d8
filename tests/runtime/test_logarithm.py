"""The logarithm in vector instructions is that of the C library to the last bits."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.runtime.logarithm import log

RNG = np.random.default_rng(0)


@pytest.mark.parametrize("spread", [1e-9, 0.5, 20.0, 700.0])
def test_it_is_right_to_the_last_bit_or_the_one_before(spread):
    x = np.exp(RNG.uniform(-spread, spread, 20_000))
    expected = np.log(x)
    assert np.all(np.abs(np.asarray(log(jnp.asarray(x))) - expected) <= 2 * np.spacing(np.abs(expected)))


def test_one_and_what_is_no_number():
    np.testing.assert_array_equal(log(jnp.array([1.0, jnp.inf, jnp.nan])), [0.0, np.inf, np.nan])


def test_its_slope_and_single_precision():
    assert jax.grad(log)(jnp.asarray(4.0)) == 0.25
    single = log(jnp.asarray(3.0, jnp.float32))
    assert single.dtype == jnp.float32
    np.testing.assert_allclose(single, np.log(3.0), rtol=1e-6)
