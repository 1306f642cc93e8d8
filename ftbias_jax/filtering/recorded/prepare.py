"""The joints of a recorded log smoothed, and the wrench that the tool must cause, part by part."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.filtering import pipeline
from ftbias_jax.filtering.fast.rts import smooth_track
from ftbias_jax.filtering.fast.scan import Smoothed, filter_scan
from ftbias_jax.filtering.fast.stages import (
    joint_inputs,
    joint_states,
    predict_wrenches,
    signals_of,
)
from ftbias_jax.filtering.filter_log import CHUNK, padded_length, without_useless
from ftbias_jax.filtering.pipeline import Options, State
from ftbias_jax.filtering.process_models import JOINT_MODELS
from ftbias_jax.filtering.samples import pad, samples_from_log
from ftbias_jax.io.log import Log
from ftbias_jax.model.effects import compose
from ftbias_jax.model.params import Params
from ftbias_jax.types import Array, Sample

LOOKAHEAD = 2048
"""Samples after a part from which its joints are smoothed; smoothing forgets in a small fraction of that."""


class Prepared(NamedTuple):
    """A part of a log with its joints smoothed; numpy arrays over its samples."""

    log: Log
    samples: Sample
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
    dtype = params.theta.dtype
    state, before, room = None, None, 0
    for part, following in _with_next(parts):
        part = without_useless(part, params)
        samples = _samples(params, part, before)
        if state is None:
            state = pipeline.init(params, samples._replace(q=jnp.asarray(first_q, dtype)[None]))
        length = len(part.t)
        room = max(room, padded_length(length))
        seen = samples if following is None else _append(samples, _samples(params, following, part.t[-1]))
        whole = pad(seen, room + (LOOKAHEAD if room == CHUNK else 0))
        state, kept = _smooth_part(params, state, whole, options, length)
        joints, wrench_tool, variance, known, nats = jax.tree.map(np.asarray, kept)
        joints = Smoothed(*(x[:length] for x in joints))
        variance = variance[:length]
        yield Prepared(part, samples, joints, wrench_tool[:length], variance, variance, known[:length], float(nats))
        before = part.t[-1]


@partial(jax.jit, static_argnames="options")
def _smooth_part(
    params: Params, state: State, samples: Sample, options: Options, length: int
) -> tuple[State, tuple[Smoothed, Array, Array, Array, Array]]:
    """The filtered state of the joints after ``length`` samples, and what is known of each with hindsight."""
    model, inputs = JOINT_MODELS[options.joint_model], joint_inputs(params, state, samples)
    track = filter_scan(model, inputs)
    joints = smooth_track(model, inputs, track)
    wrench_tool, variance = predict_wrenches(params, joints, samples, options)
    known = jnp.zeros_like(wrench_tool)
    if params.effects is not None:
        known = compose.bias(signals_of(params, jnp.swapaxes(joints.mean, 1, 2), samples), params.effects)
    counted = jnp.arange(samples.dt.shape[0]) < length
    nats = jnp.where(counted, track.log_likelihood.sum(1), 0).sum()
    end = joint_states(Smoothed(track.mean[length - 1], track.covariance[length - 1]))
    return state._replace(joint=end), (joints, wrench_tool, variance, known, nats)


def _samples(params: Params, log: Log, before: float | None) -> Sample:
    samples = samples_from_log(log, params.theta.dtype, before)
    return samples if params.effects is not None else samples._replace(temperature=None, columns=None)


def _append(samples: Sample, following: Sample) -> Sample:
    """Samples, and the first LOOKAHEAD of those that follow, without a wrench: it is not needed."""
    more = jax.tree.map(lambda x: x[:LOOKAHEAD], following)
    appended: Sample = jax.tree.map(lambda x, y: jnp.concatenate([x, y]), samples, more)
    return appended


def _with_next(parts: Iterable[Log]) -> Iterator[tuple[Log, Log | None]]:
    """Every part with the one after it."""
    rest = iter(parts)
    here = next(rest)
    for following in rest:
        yield here, following
        here = following
    yield here, None
