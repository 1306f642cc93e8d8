"""The method over a log that is too long to be held: part by part, twice where its noise is to be found first."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.filtering import bias_filter, pipeline
from ftbias_jax.filtering.joint_noise import MOST_SAMPLES, likeliest_density
from ftbias_jax.filtering.method.filter_samples import PASSES
from ftbias_jax.filtering.method.passes import Work, blocks_of, summarise, with_noise
from ftbias_jax.filtering.method.results import Infos, States
from ftbias_jax.filtering.noise.blocks import Blocks, Layout, jumps_in, layout_of, without_jumps
from ftbias_jax.filtering.noise.contact import in_contact, listed
from ftbias_jax.filtering.noise.fit_noise import Noise, fit_noise
from ftbias_jax.filtering.params_for_log import guard_against_lag
from ftbias_jax.filtering.pipeline import Options, State
from ftbias_jax.filtering.samples import arrays_from_log, pad
from ftbias_jax.io.log import Log
from ftbias_jax.model.params import BiasNoise, Params
from ftbias_jax.runtime.kept_programs import keep_program
from ftbias_jax.types import Array, Sample

PART = 1 << 16
"""Samples of a part; an even number of blocks of any length is not asked for, what is left of a block is not used."""
LOOKAHEAD = 2048
"""Samples after a part from which its joints are smoothed; smoothing forgets in a small fraction of that."""

Parts = Callable[[int], Iterator[Log]]
Found = tuple[Params, Noise | None, Layout, Iterable[tuple[Log, States, Infos]]]


def filter_parts(params: Params, parts: Parts, first_q: Array, options: Options, method: tuple[str, ...]) -> Found:
    """Filter a long log.

    Args:
        params: as stated.
        parts: samples at once -> the log, read in parts; called two or three times.
        first_q: (n,) rad, the first measured position of every joint.
        options: of the pipeline.
        method: as for ``filter_samples``, without smoothing of the bias.

    Returns:
        the parameters and the noise of the log, and its parts with their states and infos, one at a time.
    """
    dtype = params.theta.dtype
    first = arrays_from_log(next(parts(MOST_SAMPLES)), dtype)
    layout = layout_of(first.dt)
    if "fit_joint_noise" in method:
        density = likeliest_density(params.joint, first.dt, first.q, first.dq, model=options.joint_model)
        params = params._replace(joint=params.joint._replace(process_density=density))
    if "guard_joints" in method:
        params = guard_against_lag(params)
    nothing: Any = None
    start = pipeline.init(params, Sample(nothing, np.asarray(first_q, dtype)[None], nothing, nothing))
    if "fit_noise" not in method:
        passes = tuple(name for name in method if name in ("smooth_joints", "filter_joints", "filter_bias"))
        return params, None, layout, _results(params, None, start, parts, (options, passes, layout))
    blocks, jumps, state = [], [], start
    for _, sizes, t, samples in _padded(parts, dtype):
        state, found, jumped = _look(params, state, samples, t, sizes, options=options, layout=layout)
        number = int(found.number)
        blocks.append(jax.tree.map(lambda x, n=number: np.asarray(x)[:n], found._replace(number=np.zeros(number))))
        jumps.append(np.asarray(jumped)[:number])
    whole = Blocks(*(np.concatenate(x) for x in zip(*blocks, strict=True)))
    whole = whole._replace(number=np.asarray(len(whole.t)))
    noise, shown = jax.tree.map(np.asarray, _fit(params.bias, whole, np.concatenate(jumps), layout=layout))
    start = start._replace(bias=bias_filter.init(noise))
    program = (options, ("smooth_joints", "filter_bias"), layout)
    return params._replace(bias=noise), shown, layout, _results(params, (noise, shown), start, parts, program)


def _results(
    params: Params,
    noise: tuple[BiasNoise, Noise] | None,
    state: State,
    parts: Parts,
    program: tuple[Options, tuple[str, ...], Layout],
) -> Iterator[tuple[Log, States, Infos]]:
    options, method, layout = program
    contacts = [] if noise is None else listed(noise[1].contacts, noise[1].block_times, layout)
    for part, sizes, t, samples in _padded(parts, params.theta.dtype):
        touched = in_contact(t, contacts, layout.seconds)
        state, states, infos = _filter(
            params, noise, state, samples, (t, touched), sizes, options=options, method=method, layout=layout
        )
        yield part, *jax.tree.map(np.asarray, (states, infos))


def _padded(parts: Parts, dtype: Any) -> Iterator[tuple[Log, tuple[Array, Array], Array, Sample]]:
    """Every part, its samples and those that are there with the first ones of the next part, stamps and samples."""
    before = None
    for part, following in _with_next(parts(PART)):
        samples = arrays_from_log(part, dtype, before)._replace(temperature=None, columns=None)
        count = len(part.t)
        if following is not None:
            after = arrays_from_log(following, dtype, part.t[-1])._replace(temperature=None, columns=None)
            more = jax.tree.map(lambda x: x[:LOOKAHEAD], after)
            samples = jax.tree.map(lambda x, y: np.concatenate([x, y]), samples, more)
        there = len(samples.dt)
        samples = pad(samples, PART + LOOKAHEAD)
        t = (part.t[0] - samples.dt[0] + np.cumsum(samples.dt, dtype=float)).astype(samples.dt.dtype)
        yield part, (np.asarray(count), np.asarray(there)), t, samples
        before = part.t[-1]


def _with_next(parts: Iterator[Log]) -> Iterator[tuple[Log, Log | None]]:
    """Every part with the one after it."""
    here = next(parts)
    for following in parts:
        yield here, following
        here = following
    yield here, None


@keep_program("options", "layout")
def _look(
    params: Params,
    state: State,
    samples: Sample,
    t: Array,
    sizes: tuple[Array, Array],
    *,
    options: Options,
    layout: Layout,
) -> tuple[State, Blocks, Array]:
    """The joints after a part, and its blocks."""
    length, seen = sizes
    work = PASSES["smooth_joints"](Work(params, state, samples, t, length, layout, options, seen))
    assert work.end is not None
    blocks = blocks_of(work)
    jumps = blocks.t * 0 if samples.rezeroed is None else jumps_in(layout, samples.rezeroed)
    return work.end, blocks, jumps


@keep_program("layout")
def _fit(stated: BiasNoise, blocks: Blocks, jumps: Array, *, layout: Layout) -> tuple[BiasNoise, Noise]:
    return fit_noise(stated, without_jumps(blocks, jumps), layout)


@keep_program("options", "method", "layout")
def _filter(
    params: Params,
    noise: tuple[BiasNoise, Noise] | None,
    state: State,
    samples: Sample,
    at: tuple[Array, Array],
    sizes: tuple[Array, Array],
    *,
    options: Options,
    method: tuple[str, ...],
    layout: Layout,
) -> tuple[State, States, Infos]:
    """A part, and the state after it."""
    (length, seen), (t, touched) = sizes, at
    work = Work(params, state, samples, t, length, layout, options, seen)
    for name in method:
        if name == "filter_bias":
            work = work._replace(samples=_without_rest(samples, length))
            work = work if noise is None else with_noise(work, *noise)._replace(touched=touched)
        work = PASSES[name](work)
    assert work.end is not None
    return work.end, *summarise(work)[1:]


def _without_rest(samples: Sample, length: Array) -> Sample:
    """The samples of a part, with nothing happening at those of the next part."""
    here = jnp.arange(len(samples.dt)) < length
    wrench = jnp.where(here[:, None], samples.wrench, jnp.nan)
    rezeroed = None if samples.rezeroed is None else jnp.where(here, samples.rezeroed, 0)
    return samples._replace(dt=jnp.where(here, samples.dt, 0), wrench=wrench, rezeroed=rezeroed)
