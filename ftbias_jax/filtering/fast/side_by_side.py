"""Many logs as further lanes of one loop.

LLVM unrolls a loop over few lanes and works them out number by number; from some forty lanes on it takes vectors.
Every array of such a loop has the lanes as its last axis, or 1 where all lanes share a number.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import jax
import jax.custom_batching
import jax.numpy as jnp
from jax import Array


def many_as_lanes(loop: Callable[..., Any]) -> Callable[..., Any]:
    """The same loop, which takes what ``vmap`` maps over as further lanes: each with its own clock and weights."""
    together: Any = jax.custom_batching.custom_vmap(loop)

    def rule(count: int, is_mapped: Any, *arguments: Any) -> tuple[Any, Any]:
        leaves, structure = jax.tree.flatten(arguments)
        mapped = jax.tree.leaves(tuple(is_mapped))
        lanes = max(x.shape[-1] for x in leaves)

        def side_by_side(x: Array, mapped: bool) -> Array:
            if not mapped:
                return x if x.shape[-1] < lanes else jnp.concatenate([x] * count, -1)
            x = jnp.broadcast_to(x, (*x.shape[:-1], lanes))
            return jnp.moveaxis(x, 0, -2).reshape(*x.shape[1:-1], count * lanes)

        def apart(x: Array) -> Array:
            return jnp.moveaxis(x.reshape(*x.shape[:-1], count, lanes), -2, 0)

        whole = [side_by_side(x, m) for x, m in zip(leaves, mapped, strict=True)]
        found = jax.tree.map(apart, together(*jax.tree.unflatten(structure, whole)))
        return found, jax.tree.map(lambda _: True, found)

    together.def_vmap(rule)
    return cast("Callable[..., Any]", together)
