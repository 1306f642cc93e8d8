"""A padded log in pieces: the same as at once, and what is padding alone is passed over."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.runtime.pieces import PIECE, over_pieces

ROOM = 4 * PIECE


@jax.jit
def both_ways(x, length):
    """Sums up to each sample, and from each on; padding is zero, so it changes neither."""

    def forth(total, x):
        sums = total + jnp.cumsum(x)
        return sums[-1], sums

    def back(total, x):
        sums = total + jnp.cumsum(x[::-1])[::-1]
        return sums[0], sums

    return over_pieces(forth, x[0] * 0, x, length), over_pieces(back, x[0] * 0, x, length, reverse=True)


@pytest.mark.parametrize("length", [1, PIECE, PIECE + 1, ROOM])
def test_a_state_is_carried_through_the_pieces_of_the_log_and_no_others(length):
    x = np.zeros(ROOM, np.float32)
    x[:length] = np.random.default_rng(0).integers(1, 9, length)
    (end, forth), (start, back) = both_ways(x, length)
    assert end == start == x.sum()
    np.testing.assert_array_equal(forth[:length], np.cumsum(x)[:length])
    np.testing.assert_array_equal(back[:length], np.cumsum(x[::-1])[::-1][:length])
    worked_on = PIECE * -(-length // PIECE)
    np.testing.assert_array_equal(forth[worked_on:], 0)  # the sum so far, had the piece been worked on


def test_slopes_pass_through_the_pieces():
    def total(scale):
        def work(state, x):
            return state + (scale * x).sum(), None

        return over_pieces(work, 0.0, jnp.ones(ROOM), PIECE + 1)[0]

    assert jax.grad(total)(2.0) == 2 * PIECE
