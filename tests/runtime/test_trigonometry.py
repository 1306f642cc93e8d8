"""Sine and versine by polynomials, against the C library."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.runtime.trigonometry import sine_and_versine


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_they_are_those_of_the_library_to_round_off(dtype):
    rng = np.random.default_rng(0)
    near = np.pi / 2 * np.arange(-9, 10)[:, None] + 1e-6 * rng.normal(size=9)
    x = np.concatenate([[0.0], near.ravel(), rng.uniform(-8, 8, 4000), rng.uniform(-1e4, 1e4, 4000)]).astype(dtype)
    sine, versine = jax.jit(sine_and_versine)(jnp.asarray(x))
    wide, eps = x.astype(np.longdouble), np.finfo(dtype).eps
    assert sine.dtype == versine.dtype == dtype
    np.testing.assert_allclose(sine, np.sin(wide), rtol=4 * eps, atol=eps / 4)
    np.testing.assert_allclose(versine, 2 * np.sin(wide / 2) ** 2, rtol=4 * eps, atol=eps**2)


def test_a_small_angle_keeps_all_its_digits():
    sine, versine = sine_and_versine(jnp.asarray([1e-12, -1e-9]))
    np.testing.assert_allclose(sine, [1e-12, -1e-9], rtol=1e-15)
    np.testing.assert_allclose(versine, [5e-25, 5e-19], rtol=1e-15)


def test_slopes_are_cosine_and_sine():
    x = jnp.linspace(-5.0, 5.0, 41)
    _, (by_sine, by_versine) = jax.jvp(sine_and_versine, (x,), (jnp.ones_like(x),))
    np.testing.assert_allclose(by_sine, np.cos(x), atol=1e-15)
    np.testing.assert_allclose(by_versine, np.sin(x), atol=1e-15)
