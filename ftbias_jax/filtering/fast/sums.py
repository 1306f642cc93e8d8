"""The recursion of scan.py where only sums are asked for: the likelihood is added up in the loop, nothing is stored.

What the loop does not store it need not write to memory and read again, which costs three times the arithmetic. The
reverse pass is that of ``scan.filter_scan``.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.custom_batching
import jax.numpy as jnp
from jax import Array

from ftbias_jax.filtering.fast.scan import (
    Inputs,
    Packed,
    Seen,
    Smoothed,
    Track,
    advance,
    filter_scan,
    nats_of,
    packed,
    samples_of,
    start_of,
)
from ftbias_jax.filtering.process_models import Gated, ProcessModel
from ftbias_jax.runtime.compiled_loops import compile_whole, one_at_a_time
from ftbias_jax.runtime.lanes import from_upper

if TYPE_CHECKING:
    from jaxtyping import Float


class Sums(NamedTuple):
    """What a run comes to."""

    nats: Float[Array, " B"]
    """(B,) weighted sum of the likelihood's increments."""
    mean: Float[Array, "k B"]
    """(k, B) after the last sample."""
    covariance: Float[Array, "k k B"]
    """(k, k, B) after the last sample."""
    states: Smoothed | None
    """Filtered states of every sample, where they are asked for."""


@partial(jax.custom_vjp, nondiff_argnums=(0, 1))
def filter_sums(model: ProcessModel, keep: bool, inputs: Inputs, weight: Float[Array, " T"]) -> Sums:
    """Equal to sums over ``scan.filter_scan``.

    Args:
        model: as for ``scan.filter_scan``.
        keep: whether the states of all samples are asked for.
        inputs: as for ``scan.filter_scan``.
        weight: (T,) of every sample's likelihood.
    """
    (mean, triangle), nats, kept = _over_logs(model, keep)(inputs, weight)
    states = None if kept is None else Smoothed(jnp.stack(kept[0], 1), _matrix(kept[1], len(mean), 1))
    return Sums(nats, jnp.stack(mean), _matrix(triangle, len(mean), 0), states)


def _over_logs(model: ProcessModel, keep: bool) -> Any:
    """The loop, which takes the filters of many logs as lanes of one: each with its own clock and weights."""
    loop = partial(_loop, model, keep)
    if isinstance(model, Gated):  # its lanes depend on each other
        return one_at_a_time(loop)
    together: Any = jax.custom_batching.custom_vmap(loop)

    def rule(count: int, is_mapped: Any, inputs: Inputs, weight: Array) -> tuple[Any, Any]:
        lanes = inputs.mean.shape[-1]

        def of_all(x: Array, mapped: bool) -> Array:
            return x if mapped else jnp.broadcast_to(x[None], (count, *x.shape))

        def side_by_side(x: Array) -> Array:
            return jnp.moveaxis(x, 0, -2).reshape(*x.shape[1:-1], count * lanes)

        def apart(x: Array) -> Array:
            return jnp.moveaxis(x.reshape(*x.shape[:-1], count, lanes), -2, 0)

        inputs, weight = jax.tree.map(of_all, (inputs, weight), tuple(is_mapped))
        dt, weight = (jnp.broadcast_to(x[..., None], (*x.shape, lanes)) for x in (inputs.dt, weight))
        found = jax.tree.map(apart, loop(*jax.tree.map(side_by_side, (inputs._replace(dt=dt), weight))))
        return found, jax.tree.map(lambda _: True, found)

    together.def_vmap(rule)
    return together


def _loop(model: ProcessModel, keep: bool, inputs: Inputs, weight: Array) -> tuple[Packed, Array, Packed | None]:
    """The state after the last sample, the sums, and the states of all samples."""

    @compile_whole
    def loop(inputs: Inputs, weight: Array) -> Any:
        def body(carry: tuple[Packed, Array], sample: tuple[Seen, Array]) -> Any:
            (state, nats), (seen, weight) = carry, sample
            step = advance(model, inputs, state, seen)
            after = packed(step)
            return (after, nats + weight * nats_of(step.record)[1]), after if keep else None

        start = (start_of(inputs), jnp.zeros_like(inputs.mean[0]))
        (last, nats), kept = jax.lax.scan(body, start, (samples_of(inputs), weight))
        return last, nats, kept

    found: tuple[Packed, Array, Packed | None] = loop(inputs, weight)
    return found


def _matrix(triangle: list[Array], k: int, axis: int) -> Array:
    """Entries of the upper triangle -> a matrix, whose rows and columns are axes after the first ``axis``."""
    return jnp.stack([jnp.stack(row, axis) for row in from_upper(k, triangle)], axis)


def _sums_of(keep: bool, track: Track, weight: Array) -> Sums:
    """The same from the track of every sample."""
    states = Smoothed(track.mean, track.covariance) if keep else None
    return Sums((weight[:, None] * track.log_likelihood).sum(0), track.mean[-1], track.covariance[-1], states)


def _forward(model: ProcessModel, keep: bool, inputs: Inputs, weight: Array) -> tuple[Sums, Any]:
    found: tuple[Sums, Any] = jax.vjp(lambda x, w: _sums_of(keep, filter_scan(model, x), w), inputs, weight)
    return found


def _backward(model: ProcessModel, keep: bool, pull: Any, bar: Sums) -> Any:
    return pull(bar)


filter_sums.defvjp(_forward, _backward)
