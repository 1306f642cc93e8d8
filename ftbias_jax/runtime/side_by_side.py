"""Many logs side by side in one loop, the log as the fastest axis.

LLVM unrolls a loop over few lanes (seven joints, six axes) and works them out number by number; from some forty lanes
on it takes vectors. Under ``vmap`` the logs become further lanes. Every such function takes them in the same order, so
what one brings apart and the next brings together again is no copy: XLA leaves out both.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, cast

import jax
import jax.custom_batching
import jax.numpy as jnp
from jax import Array

from ftbias_jax.runtime.compiled_loops import log_by_log, on_cpu, unmapped_apart

FEW = 8
"""Logs: fewer than these fill the vectors so badly that one after the other is quicker."""


def many_as_lanes(loop: Callable[..., Any]) -> Callable[..., Any]:
    """The same loop, which takes what ``vmap`` maps over as further lanes: each with its own clock and weights.

    Every array of such a loop has the lanes as its last axis, or 1 where all lanes share a number. What a log has
    one of, as its clock, then is one number a log, which ``for_lanes`` repeats.
    """
    together: Any = jax.custom_batching.custom_vmap(loop)

    def rule(count: int, is_mapped: Any, *arguments: Any) -> tuple[Any, Any]:
        leaves, structure = jax.tree.flatten(arguments)
        mapped = jax.tree.leaves(tuple(is_mapped))

        def side_by_side(x: Array, mapped: bool) -> Array:
            if not mapped:
                return x if x.shape[-1] == 1 else jnp.repeat(x, count, -1)
            return jnp.moveaxis(x, 0, -1).reshape(*x.shape[1:-1], x.shape[-1] * count)

        whole = [side_by_side(x, m) for x, m in zip(leaves, mapped, strict=True)]
        found = jax.tree.map(partial(_apart, count), together(*jax.tree.unflatten(structure, whole)))
        return found, jax.tree.map(lambda _: True, found)

    together.def_vmap(rule)
    return cast("Callable[..., Any]", together)


def _apart(count: int, x: Array) -> Array:
    """(..., lanes * logs) -> (logs, ..., lanes)."""
    return jnp.moveaxis(x.reshape(*x.shape[:-1], -1, count), -1, 0)


def for_lanes(row: Array, lanes: int) -> Array:
    """Numbers of logs (..., logs) as numbers of lanes (..., lanes), or the one that all share, as it is."""
    logs = row.shape[-1]
    return row if logs in (1, lanes) else jnp.tile(row, lanes // logs)


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


class Parts(NamedTuple):
    """How a loop goes through the parts of a log."""

    work: Callable[[Any, Any, Any], tuple[Any, Any]]
    """What all parts share, state, part -> state after it, and results."""
    pass_over: Callable[[Any, Any, Any], tuple[Any, Any]]
    """The same for a part that is empty."""
    is_there: tuple[Callable[[Any], Array], ...]
    """Part -> whether it is not empty: tests of which one suffices, the cheapest first."""
    reverse: bool = False
    """From the last part to the first."""


def scan_of_logs(parts: Parts, shared: Any, start: Any, log: Any) -> tuple[Any, Any]:
    """``lax.scan`` over the parts of a log, where empty ones are passed over.

    Of the logs that ``vmap`` maps over, a part is brought side by side when it is its turn, in the cache; it is passed
    over where it is empty in all of them.

    Args:
        parts: how.
        shared: for every part.
        start: state before the first part, or after the last one.
        log: arrays (parts, ...).
    """
    at = partial(jax.lax.dynamic_index_in_dim, keepdims=False)

    def one(shared: Any, start: Any, log: Any) -> tuple[Any, Any]:
        def part_of(i: Array) -> Any:
            return jax.tree.map(lambda x: at(x, i, 0), log)

        return _scan(partial(_on_part, parts, shared), start, part_of, len(jax.tree.leaves(log)[0]), parts.reverse)

    together: Any = jax.custom_batching.custom_vmap(one)

    def rule(count: int, is_mapped: Any, shared: Any, start: Any, log: Any) -> tuple[Any, Any]:
        def all_mapped(x: Array, mapped: bool) -> Array:
            return x if mapped else jnp.broadcast_to(x, (count, *x.shape))

        of_shared = jax.tree.map(lambda m: 0 if m else None, is_mapped[0])
        start, log = jax.tree.map(all_mapped, (start, log), tuple(is_mapped[1:]))
        many = partial(jax.vmap, in_axes=(of_shared, 0, -1), axis_size=count)
        tests = tuple(jax.vmap(test, -1) for test in parts.is_there)
        of_all = Parts(many(parts.work), many(parts.pass_over), tests)

        def part_of(i: Array) -> Any:
            return jax.tree.map(lambda x: jnp.moveaxis(at(x, i, 1), 0, -1), log)

        length = jax.tree.leaves(log)[0].shape[1]
        state, found = _scan(partial(_on_part, of_all, shared), start, part_of, length, parts.reverse)
        found = state, jax.tree.map(lambda x: jnp.moveaxis(x, 1, 0), found)
        return found, jax.tree.map(lambda _: True, found)

    together.def_vmap(rule)
    return cast("tuple[Any, Any]", together(shared, start, log))


def _on_part(parts: Parts, shared: Any, state: Any, part: Any) -> tuple[Any, Any]:
    """Work, or pass over."""
    there = jnp.array(False)
    for test in parts.is_there:
        there = jax.lax.cond(there, lambda: jnp.array(True), lambda test=test: test(part).any())
    found: tuple[Any, Any] = jax.lax.cond(there, parts.work, parts.pass_over, shared, state, part)
    return found


def _scan(on_part: Any, start: Any, part_of: Callable[[Array], Any], count: int, reverse: bool) -> tuple[Any, Any]:
    return jax.lax.scan(lambda state, i: on_part(state, part_of(i)), start, jnp.arange(count), reverse=reverse)


def in_tiles(function: Callable[..., Any], size: int) -> Callable[..., Any]:
    """The same function, of which ``vmap`` on a processor takes tiles of so many logs, one tile after the other.

    Where it maps over the first argument too, what logs share, it takes one log after the other.

    Args:
        function: of what logs share, and of one log.
        size: logs of a tile, at the most.
    """
    if not on_cpu():
        return function
    tiled: Any = jax.custom_batching.custom_vmap(function)
    one = log_by_log(function)

    def rule(count: int, is_mapped: Any, *arguments: Any) -> tuple[Any, Any]:
        axes = jax.tree.map(lambda m: 0 if m else None, tuple(is_mapped))
        if any(jax.tree.leaves(is_mapped[0])) or count < FEW:
            found = jax.vmap(one, axes, axis_size=count)(*arguments)
            return found, jax.tree.map(lambda _: True, found)
        tiles = -(-count // size)
        logs = -(-count // tiles)  # of nearly equal tiles; the last log fills the last tile

        def cut(x: Array) -> Array:
            more = tiles * logs - count
            x = jnp.concatenate([x, jnp.repeat(x[-1:], more, 0)]) if more else x
            return x.reshape(tiles, logs, *x.shape[1:])

        tile = log_by_log(jax.vmap(function, axes, axis_size=logs))
        whole = jax.tree.map(lambda x, m: cut(x) if m else x, arguments, tuple(is_mapped))
        found = jax.lax.map(*unmapped_apart(tile, is_mapped, whole))
        found = jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:])[:count], found)
        return found, jax.tree.map(lambda _: True, found)

    tiled.def_vmap(rule)
    return cast("Callable[..., Any]", tiled)
