"""Many logs side by side in one loop, the log as the fastest axis.

LLVM unrolls a loop over few lanes (seven joints, six axes) and works them out number by number; from some forty lanes
on it takes vectors. Under ``vmap`` the logs become further lanes. Every such function takes them in the same order, so
what one brings apart and the next brings together again is no copy: XLA leaves out both.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.custom_batching
import jax.numpy as jnp
from jax import Array

from ftbias_jax.runtime.compiled_loops import unmapped_apart


def samples_as_lanes(work: Callable[[Any, Any], Any], most: int) -> Callable[[Any, Any], Any]:
    """Work without memory on series (T, n): a lane is a sample, and under ``vmap`` one of any of the logs.

    Args:
        work: what all samples share, and pieces of the series (pieces, n, lanes) -> pieces of other series. Where
            ``vmap`` maps over what is shared as well, it takes one log after the other.
        most: lanes of a piece, at the most.
    """

    def one_piece_after_the_other(shared: Any, series: Any) -> Any:
        length, _, logs = jax.tree.leaves(series)[0].shape
        size = -(-length // -(-length * logs // max(most, logs)))  # time steps of a piece
        found = work(shared, jax.tree.map(partial(_cut, size), series))
        return jax.tree.map(partial(_join, length, logs), found)

    together: Any = jax.custom_batching.custom_vmap(one_piece_after_the_other)

    def rule(count: int, is_mapped: Any, shared: Any, series: Any) -> tuple[Any, Any]:
        if any(jax.tree.leaves(is_mapped[0])):
            found = jax.lax.map(*unmapped_apart(together, is_mapped, (shared, series)))
            return found, jax.tree.map(lambda _: True, found)

        def side_by_side(x: Array, mapped: bool) -> Array:
            x = jnp.moveaxis(x, 0, -1) if mapped else jnp.broadcast_to(x[..., None], (*x.shape, count))
            return x.reshape(*x.shape[:-2], -1)

        found = jax.tree.map(partial(_apart, count), together(shared, jax.tree.map(side_by_side, series, is_mapped[1])))
        return found, jax.tree.map(lambda _: True, found)

    together.def_vmap(rule)

    def of_one(shared: Any, series: Any) -> Any:
        found = together(shared, jax.tree.map(lambda x: x[..., None], series))
        return jax.tree.map(lambda x: x[..., 0], found)

    return of_one


def _cut(size: int, x: Array) -> Array:
    """(T, n, logs) -> (pieces, n, size * logs)."""
    x = jnp.pad(x, ((0, -x.shape[0] % size), (0, 0), (0, 0)))
    x = x.reshape(-1, size, *x.shape[1:])
    return jnp.swapaxes(x, 1, 2).reshape(x.shape[0], x.shape[2], -1)


def _join(length: int, logs: int, x: Array) -> Array:
    """(pieces, n, size * logs) -> (T, n, logs)."""
    x = x.reshape(*x.shape[:2], -1, logs)
    return jnp.swapaxes(x, 1, 2).reshape(-1, x.shape[1], logs)[:length]


def _apart(count: int, x: Array) -> Array:
    """(..., lanes * logs) -> (logs, ..., lanes)."""
    return jnp.moveaxis(x.reshape(*x.shape[:-1], -1, count), -1, 0)
