"""The method over a log too long to be held in memory: part by part, twice where its noise must be found first."""

from collections.abc import Callable, Iterable, Iterator
from itertools import chain, pairwise
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.filtering import bias_filter, pipeline
from ftbias_jax.filtering.method.filter_samples import PASSES
from ftbias_jax.filtering.method.look import blocks_in, noise_in
from ftbias_jax.filtering.method.passes import filter_bias, summarise, with_noise
from ftbias_jax.filtering.method.work import Infos, States, Work
from ftbias_jax.filtering.noise.blocks import Blocks, Layout, layout_of
from ftbias_jax.filtering.noise.contact import in_contact, listed
from ftbias_jax.filtering.noise.fit_noise import Noise
from ftbias_jax.filtering.noise.joint_scatter import no_less_than_shown
from ftbias_jax.filtering.params_for_log import MOST_SAMPLES, guard_against_lag, max_likelihood_density
from ftbias_jax.filtering.pipeline import Options, State
from ftbias_jax.filtering.samples import arrays_from_log, pad
from ftbias_jax.io.log import Log
from ftbias_jax.model.params import BiasNoise, Params
from ftbias_jax.runtime.kept_programs import keep_program
from ftbias_jax.types import Array, Sample

PART = 1 << 16
"""Samples of a part; it need not be a whole number of blocks, since a remainder of a block is not used."""
LOOKAHEAD = 2048
"""Samples after a part that are used to smooth its joints; smoothing forgets in a small fraction of that."""

Parts = Callable[[int], Iterator[Log]]
Found = tuple[Params, Noise | None, Layout, Iterable[tuple[Log, States, Infos]]]


def filter_parts(params: Params, parts: Parts, first_q: Array, options: Options, method: tuple[str, ...]) -> Found:
    """Filter a long log by a method of ``filter_samples`` that does not smooth the bias.

    ``parts`` (samples per part -> the log in parts) is called two or three times.

    Returns:
        the parameters and the noise of the log, and its parts with their states and infos, one at a time.
    """
    dtype = params.theta.dtype
    first = arrays_from_log(next(parts(MOST_SAMPLES)), dtype)
    layout = layout_of(first.dt)
    if "smooth_joints" in method:
        params = params._replace(joint=no_less_than_shown(params.joint, first))
    if "fit_joint_noise" in method:
        density = max_likelihood_density(params.joint, first.dt, first.q, first.dq, model=options.joint_model)
        params = params._replace(joint=params.joint._replace(process_density=density))
    if "guard_joints" in method:
        params = guard_against_lag(params)
    nothing: Any = None
    start = pipeline.init(params, Sample(nothing, np.asarray(first_q, dtype)[None], nothing, nothing))
    joints = "smooth_joints" if "smooth_joints" in method else "filter_joints"
    noise = _fitted(params, parts, start, options, layout) if "fit_noise" in method else None
    contacts = [] if noise is None else listed(noise[1].contacts, noise[1].block_times, layout)

    def results(state: State) -> Iterator[tuple[Log, States, Infos]]:
        for part, sizes, t, samples in _padded(parts, dtype):
            given = (params, noise, state, samples, (t, in_contact(t, contacts, layout.seconds)), sizes)
            state, states, infos = _filter(*given, options=options, joints=joints, layout=layout)
            yield part, *jax.tree.map(np.asarray, (states, infos))

    if noise is None:
        return params, None, layout, results(start)
    found = results(start._replace(bias=bias_filter.init(noise[0])))
    return params._replace(bias=noise[0]), noise[1], layout, found


def _fitted(params: Params, parts: Parts, state: State, options: Options, layout: Layout) -> tuple[BiasNoise, Noise]:
    """Noise of the filter, and the noise that the whole log shows."""
    blocks, jumps = [], []
    for _, sizes, t, samples in _padded(parts, params.theta.dtype):
        state, found, jumped = blocks_in(params, state, samples, t, sizes, options=options, layout=layout)
        number = int(found.number)
        blocks.append(jax.tree.map(lambda x, n=number: np.asarray(x)[:n], found._replace(number=np.zeros(number))))
        jumps.append(np.asarray(jumped)[:number])
    whole = Blocks(*map(np.concatenate, zip(*blocks, strict=True)))
    whole = whole._replace(number=np.asarray(len(whole.t)))
    _, fitted = noise_in(params.bias, whole, np.concatenate(jumps), layout=layout, enough=True)
    return jax.tree.map(np.asarray, fitted)


def _padded(parts: Parts, dtype: Any) -> Iterator[tuple[Log, tuple[Array, Array], Array, Sample]]:
    """Every part, its length without and with the first samples of the next part, stamps and samples."""
    before = None
    for part, following in pairwise(chain(parts(PART), [None])):
        assert part is not None
        samples = arrays_from_log(part, dtype, before)._replace(temperature=None, columns=None)
        count = len(part.t)
        if following is not None:
            after = arrays_from_log(following, dtype, part.t[-1])._replace(temperature=None, columns=None)
            samples = jax.tree.map(lambda x, y: np.concatenate([x, y[:LOOKAHEAD]]), samples, after)
        there = len(samples.dt)
        samples = pad(samples, PART + LOOKAHEAD)
        t = (part.t[0] - samples.dt[0] + np.cumsum(samples.dt, dtype=float)).astype(samples.dt.dtype)
        yield part, (np.asarray(count), np.asarray(there)), t, samples
        before = part.t[-1]


@keep_program("options", "joints", "layout")
def _filter(
    params: Params,
    noise: tuple[BiasNoise, Noise] | None,
    state: State,
    samples: Sample,
    at: tuple[Array, Array],
    sizes: tuple[Array, Array],
    *,
    options: Options,
    joints: str,
    layout: Layout,
) -> tuple[State, States, Infos]:
    """Filter a part, and return the state after it."""
    (length, seen), (t, touched) = sizes, at
    work = PASSES[joints](Work(params, state, samples, t, length, layout, options, seen))
    # No time passes and nothing is measured at the samples of the next part.
    here = jnp.arange(len(samples.dt)) < length
    wrench = jnp.where(here[:, None], samples.wrench, jnp.nan)
    rezeroed = None if samples.rezeroed is None else jnp.where(here, samples.rezeroed, 0)
    here_alone = samples._replace(dt=jnp.where(here, samples.dt, 0), wrench=wrench, rezeroed=rezeroed)
    work = work._replace(samples=here_alone)
    work = filter_bias(work if noise is None else with_noise(work, *noise)._replace(touched=touched))
    return work.end, *summarise(work)[1:]
