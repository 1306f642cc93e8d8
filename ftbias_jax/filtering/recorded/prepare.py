"""The joints of a recorded log smoothed, and the wrench that the tool must cause, part by part."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.filtering.fast.rts import smooth_track
from ftbias_jax.filtering.fast.scan import Smoothed, filter_scan
from ftbias_jax.filtering.fast.stages import (
    joint_inputs,
    joint_states,
    predict_wrenches,
    signals_of,
)
from ftbias_jax.filtering.filter_log import CHUNK, padded_length, start_at, without_useless
from ftbias_jax.filtering.pipeline import Options, State
from ftbias_jax.filtering.process_models import JOINT_MODELS
from ftbias_jax.filtering.samples import arrays_from_log, pad, without_unsettled
from ftbias_jax.io.log import Log
from ftbias_jax.model.effects import compose
from ftbias_jax.model.params import Params
from ftbias_jax.runtime.pieces import over_pieces
from ftbias_jax.types import Array, Gaussian, Sample

LOOKAHEAD = 2048
"""Samples after a part from which its joints are smoothed; smoothing forgets in a small fraction of that."""


class Prepared(NamedTuple):
    """A part of a log with its joints smoothed; numpy arrays over its samples."""

    log: Log
    samples: Sample
    """The wrench is NaN, too, where effects with a memory have not yet settled."""
    joints: Smoothed
    """Position, velocity and acceleration: mean (T, 3, n)."""
    wrench_tool: Array
    """(T, 6) N, Nm; with the known effects, if there are any."""
    variance: Array
    """(T, 6) N^2, Nm^2, diagonal of R as the setup states it."""
    shown: Array
    """(T, 6) N^2, Nm^2, the same as the scatter of the log shows it; what is stated until that is known."""
    known_bias: Array
    """(T, 6) N, Nm, what known effects add to the bias."""
    joint_log_likelihood: float


def prepare(params: Params, first_q: Array, parts: Iterable[Log], options: Options) -> Iterator[Prepared]:
    """Smooth the joints of a log part by part, each with LOOKAHEAD samples of the next.

    Args:
        params: of the pipeline, with the likeliest process noise of the joints: smoothing needs no guard.
        first_q: (n,) rad, the first measured position of every joint.
        parts: of the log, in the order of time.
        options: of the pipeline.
    """
    state, before, room = start_at(params, first_q), None, 0
    for part, following in _with_next(parts):
        part = without_useless(part, params)
        samples = _samples(params, part, before)
        length = len(part.t)
        room = max(room, padded_length(length))
        seen = samples if following is None else _append(samples, _samples(params, following, part.t[-1]))
        whole = pad(seen, room + (LOOKAHEAD if room == CHUNK else 0))
        state, kept = _smooth_part(params, state, whole, options, length, len(seen.dt))
        joints, wrench_tool, variance, known, nats = jax.tree.map(np.asarray, kept)
        joints = Smoothed(*(x[:length] for x in joints))
        variance = variance[:length]
        yield Prepared(part, samples, joints, wrench_tool[:length], variance, variance, known[:length], float(nats))
        before = part.t[-1]


@partial(jax.jit, static_argnames="options")
def _smooth_part(
    params: Params, state: State, samples: Sample, options: Options, length: int, seen: int
) -> tuple[State, tuple[Smoothed, Array, Array, Array, Array]]:
    """The filtered state of the joints after ``length`` samples, and what is known of each with hindsight.

    After ``seen`` samples there is padding alone.
    """
    model, alone = JOINT_MODELS[options.joint_model], params.effects is None
    counted = jnp.arange(samples.dt.shape[0]) < length

    def forward(joint: Gaussian, piece: tuple[Sample, Array]) -> tuple[Gaussian, tuple[Smoothed, Array]]:
        samples, counted = piece
        track = filter_scan(model, joint_inputs(params, state._replace(joint=joint), samples))
        nats = jnp.where(counted, track.log_likelihood.sum(1), 0)
        states = Smoothed(track.mean, track.covariance)
        return joint_states(jax.tree.map(lambda x: x[-1], states)), (states, nats)

    def backward(after: Smoothed, piece: tuple[Sample, Array, Smoothed]) -> tuple[Smoothed, tuple[Smoothed, Any]]:
        samples, dt_after, filtered = piece
        inputs = joint_inputs(params, state, samples)._replace(dt=jnp.concatenate([dt_after[:1], dt_after]))
        whole = jax.tree.map(lambda x, end: jnp.concatenate([x, end[None]]), filtered, after)
        joints: Smoothed = jax.tree.map(lambda x: x[:-1], smooth_track(model, inputs, whole))
        found = predict_wrenches(params, joints, samples, options) if alone else None
        return jax.tree.map(lambda x: x[0], joints), (joints, found)

    last, (filtered, nats) = over_pieces(forward, state.joint, (samples, counted), seen)
    dt_after = jnp.append(samples.dt[1:], 0)  # after the last sample nothing happens
    end = Smoothed(last.mean.T, jnp.moveaxis(last.covariance, 0, -1))
    _, (joints, found) = over_pieces(backward, end, (samples, dt_after, filtered), seen, reverse=True)
    wrench_tool, variance = predict_wrenches(params, joints, samples, options) if found is None else found
    known = jnp.zeros_like(wrench_tool)
    if params.effects is not None:
        known = compose.bias(signals_of(params, jnp.swapaxes(joints.mean, 1, 2), samples), params.effects)
    after = joint_states(jax.tree.map(lambda x: x[length - 1], filtered))
    return state._replace(joint=after), (joints, wrench_tool, variance, known, nats.sum())


def _samples(params: Params, log: Log, before: float | None) -> Sample:
    samples = without_unsettled(arrays_from_log(log, params.theta.dtype, before), log.t, params)
    return samples if params.effects is not None else samples._replace(temperature=None, columns=None)


def _append(samples: Sample, following: Sample) -> Sample:
    """Samples, and the first LOOKAHEAD of those that follow, without a wrench: it is not needed."""
    more = jax.tree.map(lambda x: x[:LOOKAHEAD], following)
    appended: Sample = jax.tree.map(lambda x, y: np.concatenate([x, y]), samples, more)
    return appended


def _with_next(parts: Iterable[Log]) -> Iterator[tuple[Log, Log | None]]:
    """Every part with the one after it."""
    rest = iter(parts)
    here = next(rest)
    for following in rest:
        yield here, following
        here = following
    yield here, None
