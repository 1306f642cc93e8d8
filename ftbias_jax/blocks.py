"""A scan over a long log in blocks of time that run side by side, equal to the plain scan.

A recursion that forgets its start (the filter of a measured joint does within some milliseconds) can begin anywhere:
each block starts from a guess, the state after a warm-up on the samples before it. Then all blocks run at once, and a
block whose start is not the end of the one before it runs again from there, until all agree. Every round makes at least
one more block final, so the result is that of the plain scan to round-off whatever the data; one round is usual.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from ftbias_jax.types import Array

WARM_UP = 512
"""Samples that a guess is made of."""
SHORTEST = 1024
"""Samples of a block, at least: the warm-up is to be a small part of it."""
MOST = 32
"""Blocks; more of them save nothing, for their lanes no longer fit the processor's fastest cache."""

Body = Callable[[Any, Any, Any, Any], tuple[Any, Any, Any]]
"""(constants, state, sums, sample) -> state, sums and what is kept; all leaves are arrays over the lanes."""
Cold = Callable[[Any, Any], Any]
"""(start of the log, first sample of a warm-up) -> the state that the warm-up starts from; all over the lanes."""
Agree = Callable[[Any, Any], Array]
"""Whether two states, leaves (blocks, B), are equal but for round-off."""


def count_blocks(length: int) -> int:
    """How many blocks a log of so many samples is cut into; they need not divide it."""
    return max(1, min(MOST, length // SHORTEST))


def scan_blocks(
    body: Body,
    constants: Any,
    start: Any,
    sums: Any,
    xs: Any,
    blocks: int,
    agree: Agree,
    cold: Cold = lambda start, sample: start,
    reverse: bool = False,
) -> tuple[Any, Any, Any]:
    """``lax.scan`` of a body over independent lanes.

    Args:
        body: the recursion. constants, start, sums: leaves (B,). xs: leaves (T, B), blocks divides T.
        blocks: how many, 1 = the plain scan. agree: decides when a round was the last.
        cold: state that a warm-up starts from, of the start of the log and the first sample of the warm-up.
        reverse: from the end.

    Returns:
        the last state and the sums, leaves (B,), and what was kept, leaves (T, B).
    """
    if blocks == 1:
        (state, sums), kept = jax.lax.scan(_step(body, constants), (start, sums), xs, reverse=reverse)
        return state, sums, kept

    xs, shapes = jax.tree.map(lambda x: _fold(x, blocks), xs), jax.tree.map(jnp.shape, start)
    step = _step(body, jax.tree.map(lambda x: jnp.tile(x, blocks), constants))
    no_sums = jax.tree.map(lambda x: jnp.zeros((blocks, *x.shape), x.dtype).reshape(-1), sums)

    def ends(starts: Any, xs: Any) -> Any:
        lanes = jax.tree.map(lambda x: x.reshape(-1), starts)
        (state, sums), kept = jax.lax.scan(step, (lanes, no_sums), xs, reverse=reverse)
        return jax.tree.map(lambda x, shape: x.reshape(blocks, *shape), state, shapes), sums, kept

    def follow(ends: Any) -> Any:
        """Starts of all blocks when each follows the one before it."""
        if reverse:
            return jax.tree.map(lambda x, first: jnp.concatenate([x[1:], first[None]]), ends, start)
        return jax.tree.map(lambda x, first: jnp.concatenate([first[None], x[:-1]]), ends, start)

    def again(carry: Any) -> Any:
        rounds, _, starts, *_ = carry
        state, sums, kept = ends(starts, xs)
        following = follow(state)
        return rounds + 1, agree(starts, following), following, state, sums, kept

    near = jax.tree.map(lambda x: x[:WARM_UP] if reverse else x[-WARM_UP:], xs)
    everywhere = jax.tree.map(lambda x: jnp.tile(x, blocks), start)
    guess = follow(ends(cold(everywhere, jax.tree.map(lambda x: x[-1 if reverse else 0], near)), near)[0])
    empty = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), jax.eval_shape(ends, guess, xs))
    first = (0, jnp.array(False), guess, *empty)
    # After as many rounds as blocks the last one has started from an end that is final.
    *_, state, sums, kept = jax.lax.while_loop(lambda carry: ~carry[1] & (carry[0] < blocks), again, first)
    last = 0 if reverse else -1
    sums = jax.tree.map(lambda x: x.reshape(blocks, -1).sum(0), sums)
    return jax.tree.map(lambda x: x[last], state), sums, jax.tree.map(lambda x: _unfold(x, blocks), kept)


def _step(body: Body, constants: Any) -> Callable[[Any, Any], tuple[Any, Any]]:
    def step(carry: tuple[Any, Any], sample: Any) -> tuple[Any, Any]:
        state, sums, kept = body(constants, carry[0], carry[1], sample)
        return (state, sums), kept

    return step


def _fold(x: Array, blocks: int) -> Array:
    """(T, B) -> (T / blocks, blocks B): every block of time becomes lanes of its own."""
    return jnp.swapaxes(x.reshape(blocks, -1, x.shape[1]), 0, 1).reshape(x.shape[0] // blocks, -1)


def _unfold(x: Array, blocks: int) -> Array:
    """The way back."""
    return jnp.swapaxes(x.reshape(x.shape[0], blocks, -1), 0, 1).reshape(x.shape[0] * blocks, -1)
