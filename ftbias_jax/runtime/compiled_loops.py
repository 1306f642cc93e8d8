"""Loops over many short arrays, compiled as one function.

XLA starts a kernel for every few operations, and for arrays of a few numbers starting costs fifty times the arithmetic.
A call that carries XLA's mark of small calls is compiled as a whole instead, its loops included. A version of XLA that
does not know the mark ignores it: results are the same and take longer. Matrix products have no place in such a call.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import jax
import jax.custom_batching
import jax.numpy as jnp
from jax import Array
from jax.experimental.xla_metadata import set_xla_metadata

P = ParamSpec("P")
R = TypeVar("R")


def compile_whole(function: Callable[P, R]) -> Callable[P, R]:
    """The same function of arrays, compiled as a whole on a processor; on an accelerator as ever.

    Inside such a function it also marks a part whose results are to be worked out once: XLA would work cheap terms out
    again for every result that needs them, ten times over in a step of a filter.
    """

    @jax.jit
    def whole(*arguments: P.args, **named: P.kwargs) -> R:
        # The mark is for this call and not for those inside it, to which JAX would pass it on.
        with set_xla_metadata(xla_cpu_small_call="false", inlineable="true"):
            return function(*arguments, **named)

    def call(*arguments: P.args, **named: P.kwargs) -> R:
        if not on_cpu():
            return function(*arguments, **named)
        # XLA crashes on a marked call into which it has moved a constant argument; none passes a barrier.
        arguments, named = jax.lax.optimization_barrier((arguments, named))
        with set_xla_metadata(xla_cpu_small_call="true", inlineable="false"):
            result: R = whole(*arguments, **named)
        return result

    return call


def one_at_a_time(function: Callable[..., Any]) -> Callable[..., Any]:
    """The same function, which ``vmap`` on a processor turns into a loop: the arrays of one call stay in the cache."""
    if not on_cpu():
        return function
    looped: Any = jax.custom_batching.custom_vmap(function)

    def rule(count: int, is_mapped: Any, *arguments: Any) -> tuple[Any, Any]:
        leaves, structure = jax.tree.flatten(arguments)
        mapped = jax.tree.leaves(tuple(is_mapped))

        def one(parts: list[Array]) -> Any:
            rest = iter(parts)
            whole = [next(rest) if m else x for x, m in zip(leaves, mapped, strict=True)]
            return function(*jax.tree.unflatten(structure, whole))

        found = jax.lax.map(one, [x for x, m in zip(leaves, mapped, strict=True) if m])
        return found, jax.tree.map(lambda _: True, found)

    looped.def_vmap(rule)
    return cast("Callable[..., Any]", looped)


def in_tiles(function: Callable[..., Any], most: int) -> Callable[..., Any]:
    """The same function, which ``vmap`` on a processor applies to tiles of at most so many, one tile after the other.

    What is worked out for a tile stays in the cache, and fills the vector registers. Pairs are taken one at a time.
    """
    if not on_cpu():
        return function
    tiled: Any = jax.custom_batching.custom_vmap(function)

    def rule(count: int, is_mapped: Any, *arguments: Any) -> tuple[Any, Any]:
        leaves, structure = jax.tree.flatten(arguments)
        mapped = jax.tree.leaves(tuple(is_mapped))
        tiles = -(-count // most)
        size = 1 if count < 3 else -(-count // tiles)
        tiles = -(-count // size)
        padding = jnp.minimum(jnp.arange(tiles * size), count - 1).reshape(tiles, size)
        axes = jax.tree.unflatten(structure, [0 if m else None for m in mapped])

        def tile(parts: list[Array]) -> Any:
            rest = iter(parts)
            whole = jax.tree.unflatten(structure, [next(rest) if m else x for x, m in zip(leaves, mapped, strict=True)])
            return jax.vmap(function, axes, axis_size=size)(*whole)

        found = jax.lax.map(tile, [x[padding] for x, m in zip(leaves, mapped, strict=True) if m])
        found = jax.tree.map(lambda x: x.reshape(tiles * size, *x.shape[2:])[:count], found)
        return found, jax.tree.map(lambda _: True, found)

    tiled.def_vmap(rule)
    return cast("Callable[..., Any]", tiled)


def on_cpu() -> bool:
    """Whether programs run on the processor, where loops of short steps are quick."""
    return jax.default_backend() == "cpu"
