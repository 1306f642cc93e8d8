"""Loops over a padded log that leave out what is padding alone.

Logs are padded to powers of two, so that logs of many lengths share a few programs. On a processor the work is done in
pieces, and a piece without a sample of the log is passed over, so of a program for 8,192 samples a log of 5,000 takes
the time of 5,120.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from ftbias_jax.runtime.compiled_loops import on_cpu

PIECE = 256
"""Samples: of a log as many as half of that are padding, on average."""


def over_pieces(
    work: Callable[[Any, Any], tuple[Any, Any]], state: Any, log: Any, length: int | Array, *, reverse: bool = False
) -> tuple[Any, Any]:
    """Carry a state through the pieces of a padded log.

    Args:
        work: state, and a piece of the log -> the state after it, and results with a leading time axis; padding must
            not change the state.
        state: before the first piece, or after the last one.
        log: a tree of arrays (T, ...).
        length: samples at the start that are of the log; what is worked out for the others means nothing.
        reverse: from the last piece to the first.

    Returns:
        the last state and the results (T, ...).
    """
    room = len(jax.tree.leaves(log)[0])
    if room <= PIECE or room % PIECE or not on_cpu():
        return work(state, log)
    pieces = jax.tree.map(lambda x: x.reshape(-1, PIECE, *x.shape[1:]), log)
    shapes = jax.eval_shape(work, state, jax.tree.map(lambda x: x[0], pieces))[1]

    def pass_over(state: Any, piece: Any) -> tuple[Any, Any]:
        return state, jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shapes)

    def body(state: Any, numbered: Any) -> tuple[Any, Any]:
        first, piece = numbered
        found: tuple[Any, Any] = jax.lax.cond(first < length, work, pass_over, state, piece)
        return found

    numbered = (jnp.arange(0, room, PIECE), pieces)
    last, found = jax.lax.scan(body, state, numbered, reverse=reverse)
    return last, jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), found)
