"""A scan in blocks is the plain scan: when it forgets at once, slowly, or never, and in reverse."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax import blocks
from ftbias_jax.blocks import count_blocks, scan_blocks

LENGTH, LANES = 4096, 3


def body(forget, state, total, x):
    state = forget * state + x
    return state, total + state, 2 * state


def close(starts, ends):
    return (jnp.abs(starts - ends) <= 1e-12).all()


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("forget", [0.5, 0.9999, 1.0])
def test_it_is_the_plain_scan(forget, reverse):
    x = jnp.asarray(np.random.default_rng(0).normal(size=(LENGTH, LANES)))
    start = jnp.array([1.0, -2.0, 3.0])

    @partial(jax.jit, static_argnums=0)
    def scan(count):
        constants = jnp.full(LANES, forget)
        return scan_blocks(body, constants, start, jnp.zeros(LANES), x, count, close, reverse=reverse)

    for one, other in zip(scan(1), scan(4), strict=True):
        np.testing.assert_allclose(other, one, rtol=1e-10, atol=1e-9)


def test_short_logs_are_one_block_and_long_ones_not_too_many():
    assert [count_blocks(length) for length in (1, 2047, 2048)] == [1, 1, 2]
    assert count_blocks(10**7) == blocks.MOST
