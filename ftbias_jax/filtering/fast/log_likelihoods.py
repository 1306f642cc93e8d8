"""The likelihood of a log in chunks of time, of which nothing remains but two sums and the state after each.

The reverse pass starts from those states: it works out every chunk again, with all that its slopes need, while the
chunk is in the processor's cache. So the memory it takes is that of one chunk, whatever the length of the log.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
from jax import Array
from jax.custom_derivatives import SymbolicZero

from ftbias_jax.filtering import bias_filter
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
from ftbias_jax.filtering.process_models import JOINT_MODELS, BiasStrength
from ftbias_jax.filtering.samples import pad
from ftbias_jax.filtering.step import Options, State
from ftbias_jax.model.kinematics.recorded_pose import FreeBody
from ftbias_jax.model.params import Params
from ftbias_jax.runtime.compiled_loops import log_by_log
from ftbias_jax.runtime.side_by_side import Parts, in_tiles, scan_of_logs
from ftbias_jax.types import Sample

if TYPE_CHECKING:
    from jaxtyping import Float

TILE = 16
"""Logs side by side, where there are many."""
TILE_SAMPLES = 512
"""Samples that pass through all stages together, and are worked out again together."""

Nats = tuple[Array, Array]
"""() of the joints, () of the wrench."""
Chunk = tuple[Sample, Array]
"""Samples, and the weights of their likelihoods."""
Wrench = tuple[Array, Array]
"""Of the tool, and the diagonal of R: (T, 6) each."""


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
    count = 1 if params.effects is not None else -(-length // TILE_SAMPLES)
    size = -(-length // count)
    padded = pad(samples, count * size), jnp.pad(weight, (0, count * size - length))
    chunks: Chunk = jax.tree.map(lambda x: x.reshape(count, size, *x.shape[1:]), padded)
    return _in_chunks(options, params, state, chunks)


@partial(jax.custom_vjp, nondiff_argnums=(0,))
def _in_chunks(options: Options, params: Params, state: State, chunks: Chunk) -> Nats:
    found: Nats = _of_many(partial(_all_chunks, options, False), params, chunks[0], options)(params, state, chunks)[0]
    return found


def _forward(options: Options, params: Params, state: State, chunks: Chunk) -> tuple[Nats, Any]:
    """The sums; and for the reverse pass what was given, with the state before every chunk, and the wrenches."""
    leaves, given = jax.tree.flatten((params, chunks))
    state = jax.tree.map(lambda x: x.value, state)
    params, chunks = jax.tree.unflatten(given, [x.value for x in leaves])
    nats, kept = _of_many(partial(_all_chunks, options, True), params, chunks[0], options)(params, state, chunks)
    wanted = [() if x.perturbed else None for x in leaves]  # part of the structure, not a value
    return nats, (wanted, params, *kept, chunks)


def _of_many(work: Callable[..., Any], params: Params, samples: Sample, options: Options) -> Callable[..., Any]:
    """The work, which takes many logs in tiles, or with all that noise and robot may be besides one after the other.

    A gate makes the lanes of one log depend on each other, effects need whole logs, and the others are in no hurry.
    """
    plain = options.gate is None and params.effects is None and samples.rezeroed is None
    plain = plain and not isinstance(params.arm, FreeBody)
    plain = plain and not isinstance(bias_filter.strength(params.bias), BiasStrength)
    return in_tiles(work, TILE) if plain else log_by_log(work)


def _all_chunks(options: Options, keep: bool, params: Params, state: State, chunks: Chunk) -> tuple[Nats, Any]:
    def work(params: Params, state: State, chunk: Chunk) -> tuple[State, tuple[Nats, Any]]:
        after, nats, wrench = _one_chunk(options, params, state, chunk)
        return after, (nats, (state, wrench) if keep else None)

    def pass_over(params: Params, state: State, chunk: Chunk) -> tuple[State, tuple[Nats, Any]]:
        zero, wrench = jnp.zeros_like(chunk[1][0]), jnp.zeros_like(chunk[0].wrench)
        return state, ((zero, zero), (state, (wrench, wrench)) if keep else None)

    _, ((joint, wrench), kept) = scan_of_logs(Parts(work, pass_over, IS_THERE), params, state, chunks)
    return (joint.sum(), wrench.sum()), kept


def _backward(options: Options, residual: Any, bar: Any) -> tuple[Params, State, Chunk]:
    """Slopes in what they are asked for; elsewhere None, which is zero."""
    wanted, *kept = residual
    params, _, _, chunks = kept
    slopes = _of_many(partial(_slopes, options, wanted), params, chunks[0], options)
    bar = tuple(jnp.zeros(x.shape, x.dtype) if isinstance(x, SymbolicZero) else x for x in bar)
    of_params, of_state, of_chunks = slopes(*kept, bar)
    return (
        jax.tree.unflatten(jax.tree.structure(params), of_params),
        of_state,
        jax.tree.unflatten(jax.tree.structure(chunks), of_chunks),
    )


def _slopes(
    options: Options, wanted: list[Any], params: Params, before: State, wrenches: Wrench, chunks: Chunk, bar: Nats
) -> tuple[list[Any], State, list[Any]]:
    """In the leaves of params and chunks that are wanted, None in the others, and in the state before the log."""
    count = len(jax.tree.leaves(params))
    asked, fixed = _apart(params, wanted[:count])

    def work(shared: Any, slopes: Any, sample: tuple[Chunk, State, Wrench]) -> tuple[Any, Any]:
        (params, asked, fixed, bar), (of_params, of_state), (chunk, state, wrench) = shared, slopes, sample
        asked_of_chunk, rest = _apart(chunk, wanted[count:])

        def again(asked: Any, state: State, asked_of_chunk: Any) -> tuple[State, Nats]:
            given = _together(params, asked, fixed), state, _together(chunk, asked_of_chunk, rest)
            return _one_chunk(options, *given, found=wrench)[:2]

        more, before, of_chunk = jax.vjp(again, asked, state, asked_of_chunk)[1]((of_state, bar))
        return (jax.tree.map(jnp.add, of_params, more), before), of_chunk

    def pass_over(shared: Any, slopes: Any, sample: tuple[Chunk, State, Wrench]) -> tuple[Any, Any]:
        return slopes, jax.tree.map(jnp.zeros_like, _apart(sample[0], wanted[count:])[0])

    start = jax.tree.map(jnp.zeros_like, (asked, jax.tree.map(lambda x: x[0], before)))
    shared, log = (params, asked, fixed, bar), (chunks, before, wrenches)
    parts = Parts(work, pass_over, tuple(partial(_of_sample, test) for test in IS_THERE), reverse=True)
    (of_params, of_state), of_chunks = scan_of_logs(parts, shared, start, log)
    return of_params, of_state, of_chunks


def _apart(tree: Any, wanted: list[Any]) -> tuple[list[Any], list[Any]]:
    """Leaves whose slopes are asked for, and the others; None where the other list has the leaf."""
    leaves = jax.tree.leaves(tree)
    asked = [None if w is None else x for x, w in zip(leaves, wanted, strict=True)]
    return asked, [x if w is None else None for x, w in zip(leaves, wanted, strict=True)]


def _together(like: Any, asked: list[Any], fixed: list[Any]) -> Any:
    """The tree that ``_apart`` took apart."""
    leaves = [x if a is None else a for a, x in zip(asked, fixed, strict=True)]
    return jax.tree.unflatten(jax.tree.structure(like), leaves)


_in_chunks.defvjp(_forward, _backward, symbolic_zeros=True)


def _one_chunk(
    options: Options, params: Params, state: State, chunk: Chunk, found: Wrench | None = None
) -> tuple[State, Nats, Wrench]:
    """All stages over a chunk: ``stages.run`` without what it would report of every sample.

    Args:
        options: as above.
        params: as above.
        state: before the chunk.
        chunk: of the log.
        found: the wrenches, if they are known and only their slopes are needed.
    """
    samples, weight = chunk
    joint = filter_sums(JOINT_MODELS[options.joint_model], True, joint_inputs(params, state, samples), weight)
    assert joint.states is not None
    wrench_tool, variance = of_tool = predict_wrenches(params, joint.states, samples, options)
    if found is not None:
        wrench_tool, variance = _found_before(of_tool, found)
    inputs = bias_inputs(params, state, samples, wrench_tool, variance, joint.states.mean[1])
    wrench = filter_sums(gated(inputs, options), False, inputs, weight)
    joint_last = joint_states(Smoothed(joint.mean, joint.covariance))
    bias_last = bias_state(Smoothed(*add_noise(wrench.mean, wrench.covariance, -1)))
    return State(joint_last, bias_last), (joint.nats.sum(), wrench.nats.sum()), of_tool


def _time_passes(chunk: Chunk) -> Array:
    passes: Array = (chunk[0].dt != 0).any()
    return passes


def _is_measured(chunk: Chunk) -> Array:
    samples = chunk[0]
    return jnp.stack([jnp.isfinite(x).any() for x in (samples.q, samples.dq, samples.wrench)]).any()


IS_THERE: tuple[Callable[[Chunk], Array], ...] = (_time_passes, _is_measured)
"""A chunk for which neither holds is padding."""


def _of_sample(test: Callable[[Chunk], Array], sample: tuple[Chunk, State, Wrench]) -> Array:
    return test(sample[0])


@jax.custom_vjp
def _found_before(wrench: Wrench, found: Wrench) -> Wrench:
    """The same, found before: it need not be worked out again."""
    return found


_found_before.defvjp(lambda wrench, found: (found, None), lambda _, bar: (bar, jax.tree.map(jnp.zeros_like, bar)))
