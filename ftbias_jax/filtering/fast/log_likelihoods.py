"""The likelihood of a log in chunks of time, of which nothing remains but two sums and the state after each.

The reverse pass starts from those states: it works out every chunk again, with all that its slopes need, while the
chunk is in the processor's cache. So the memory it takes is that of one chunk, whatever the length of the log.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
from jax import Array

from ftbias_jax.filtering.fast.scan import Smoothed
from ftbias_jax.filtering.fast.stages import (
    add_noise,
    bias_inputs,
    bias_state,
    gated,
    joint_inputs,
    joint_states,
    predict_wrenches,
)
from ftbias_jax.filtering.fast.sums import filter_sums
from ftbias_jax.filtering.process_models import JOINT_MODELS
from ftbias_jax.filtering.samples import pad
from ftbias_jax.filtering.step import Options, State
from ftbias_jax.model.params import Params
from ftbias_jax.runtime.compiled_loops import in_tiles, one_at_a_time
from ftbias_jax.types import Sample

if TYPE_CHECKING:
    from jaxtyping import Float

CHUNK = 512
"""Samples that pass through all stages together, and are worked out again together."""

TILE = 8
"""Logs side by side, where there are many."""

Nats = tuple[Array, Array]
"""() of the joints, () of the wrench."""
Chunk = tuple[Sample, Array]
"""Samples, and the weights of their likelihoods."""


@partial(jax.jit, static_argnames="options")
def log_likelihoods(
    params: Params, state: State, samples: Sample, weight: Float[Array, " T"], options: Options
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Weighted sums of the likelihood's increments, of joints and of wrench.

    Args:
        params: as for ``stages.run``, where that applies.
        state: before the first sample.
        samples: the log.
        weight: (T,) of every sample.
        options: of the pipeline.
    """
    length = samples.dt.shape[0]
    count = 1 if params.effects is not None else -(-length // CHUNK)
    size = -(-length // count)
    padded = pad(samples, count * size), jnp.pad(weight, (0, count * size - length))
    chunks: Chunk = jax.tree.map(lambda x: x.reshape(count, size, *x.shape[1:]), padded)
    return _in_chunks(options, params, state, chunks)


@partial(jax.custom_vjp, nondiff_argnums=(0,))
def _in_chunks(options: Options, params: Params, state: State, chunks: Chunk) -> Nats:
    return _forward(options, params, state, chunks)[0]


def _forward(options: Options, params: Params, state: State, chunks: Chunk) -> tuple[Nats, tuple[Params, State, Chunk]]:
    """The sums; and for the reverse pass what was given, with the state before every chunk."""

    def all_chunks(params: Params, state: State, chunks: Chunk) -> tuple[Array, Array, State]:
        def body(state: State, chunk: Chunk) -> tuple[State, tuple[Nats, State]]:
            after, nats = _one_chunk(options, params, state, chunk)
            return after, (nats, state)

        _, ((joint, wrench), before) = jax.lax.scan(body, state, chunks)
        return joint.sum(), wrench.sum(), before

    joint, wrench, before = in_tiles(all_chunks, TILE)(params, state, chunks)
    return (joint, wrench), (params, before, chunks)


def _backward(options: Options, residual: tuple[Params, State, Chunk], bar: Nats) -> tuple[Params, State, Chunk]:
    def all_chunks(params: Params, before: State, chunks: Chunk, bar: Nats) -> tuple[Params, State, Chunk]:
        def body(slopes: tuple[Params, State], sample: tuple[State, Chunk]) -> tuple[Any, Chunk]:
            of_params, of_state = slopes
            pull = jax.vjp(partial(_one_chunk, options), params, *sample)[1]
            more, of_state, of_chunk = pull((of_state, bar))
            return (jax.tree.map(jnp.add, of_params, more), of_state), of_chunk

        start = jax.tree.map(jnp.zeros_like, (params, jax.tree.map(lambda x: x[0], before)))
        (of_params, of_state), of_chunks = jax.lax.scan(body, start, (before, chunks), reverse=True)
        return of_params, of_state, of_chunks

    found: tuple[Params, State, Chunk] = one_at_a_time(all_chunks)(*residual, bar)
    return found


_in_chunks.defvjp(_forward, _backward)


def _one_chunk(options: Options, params: Params, state: State, chunk: Chunk) -> tuple[State, Nats]:
    """All stages over a chunk: ``stages.run`` without what it would report of every sample."""
    samples, weight = chunk
    joint = filter_sums(JOINT_MODELS[options.joint_model], True, joint_inputs(params, state, samples), weight)
    assert joint.states is not None
    wrench_tool, variance = predict_wrenches(params, joint.states, samples, options)
    inputs = bias_inputs(params, state, samples, wrench_tool, variance, joint.states.mean[:, 1])
    wrench = filter_sums(gated(inputs, options), False, inputs, weight)
    joint_last = joint_states(Smoothed(joint.mean, joint.covariance))
    bias_last = bias_state(Smoothed(*add_noise(wrench.mean, wrench.covariance, -1)))
    return State(joint_last, bias_last), (joint.nats.sum(), wrench.nats.sum())
