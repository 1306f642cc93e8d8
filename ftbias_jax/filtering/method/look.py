"""Noise of a log without filtering it, for tuning and diagnosis, which work on its blocks."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ftbias_jax.filtering import pipeline
from ftbias_jax.filtering.method.joints import smooth_joints
from ftbias_jax.filtering.method.passes import blocks_of
from ftbias_jax.filtering.method.work import Work
from ftbias_jax.filtering.noise.blocks import (
    LEAST_BLOCKS,
    Blocks,
    Layout,
    in_blocks,
    jumps_in,
    layout_of,
    without_jumps,
)
from ftbias_jax.filtering.noise.contact import Contact, Contacts, find_contacts, listed
from ftbias_jax.filtering.noise.fit_noise import Noise, fit_noise
from ftbias_jax.filtering.noise.free_motion import is_touched_all_along
from ftbias_jax.filtering.noise.levels import slow_std
from ftbias_jax.filtering.noise.log_noise import LogNoise, log_noise_from, nothing
from ftbias_jax.filtering.noise.tool_force import with_tool_as_seen
from ftbias_jax.filtering.noise.vibration import fit_vibration
from ftbias_jax.filtering.params_for_log import without_useless
from ftbias_jax.filtering.pipeline import Options, State
from ftbias_jax.filtering.samples import room_for, samples_of
from ftbias_jax.io.log import Log
from ftbias_jax.model.params import BiasNoise, Params
from ftbias_jax.runtime.kept_programs import keep_program
from ftbias_jax.types import Array, Sample


class InBlocks(NamedTuple):
    """A log with smoothed joints in blocks, to be examined with any noise of the bias."""

    blocks: Blocks
    """Blocks with padding."""
    jumps: Array
    """(N,) not 0 for blocks in which the sensor was set to zero."""
    layout: Layout
    enough: bool
    """Whether the log is long enough to show its noise."""


def look_at(params: Params, log: Log, options: Options) -> tuple[Blocks, LogNoise]:
    """Blocks and noise of a log, with its joints smoothed by their most likely noise; NumPy arrays."""
    return noise_of_blocks(params.bias, log_in_blocks(params, log, options))


def log_in_blocks(params: Params, log: Log, options: Options) -> InBlocks:
    """A log in blocks, with its joints smoothed by their most likely noise."""
    log = without_useless(log, params)
    samples = samples_of(params, log)
    layout, length = layout_of(samples.dt), np.asarray(len(log.t))
    given = (params, pipeline.init(params, samples), samples, np.cumsum(samples.dt), (length, length))
    _, blocks, jumps = blocks_in(*given, options=options, layout=layout)
    return InBlocks(blocks, jumps, layout, len(log.t) // layout.size >= LEAST_BLOCKS)


def noise_of_blocks(bias: BiasNoise, log: InBlocks) -> tuple[Blocks, LogNoise]:
    """Blocks and noise as from ``look_at``, for a log in blocks that were made with the same noise of samples."""
    blocks, jumps, layout, enough = log
    blocks, fitted = jax.tree.map(np.asarray, noise_in(bias, blocks, jumps, layout=layout, enough=enough))
    stated = bias.correlated_std is not None
    noise = nothing() if fitted is None else log_noise_from(fitted[1], layout, slow_is_stated=stated)
    number = int(blocks.number)
    trimmed: Blocks = jax.tree.map(lambda x: x[:number], blocks._replace(number=blocks.t))
    return trimmed._replace(number=blocks.number), noise


@keep_program("options", "layout")
def blocks_in(
    params: Params,
    state: State,
    samples: Sample,
    t: Array,
    sizes: tuple[Array, Array],
    *,
    options: Options,
    layout: Layout,
) -> tuple[State, Blocks, Array]:
    """A log, or a part of one: the joints after it, its blocks, and the blocks in which the sensor was set to zero."""
    length, seen = sizes
    work = smooth_joints(Work(params, state, samples, t, length, layout, options, seen))
    blocks = blocks_of(work)
    return work.end, blocks, blocks.t * 0 if samples.rezeroed is None else jumps_in(layout, samples.rezeroed)


@keep_program("layout", "enough")
def noise_in(
    stated: BiasNoise, blocks: Blocks, jumps: Array, *, layout: Layout, enough: bool
) -> tuple[Blocks, tuple[BiasNoise, Noise] | None]:
    """The blocks of a whole log without jumps, and the result of ``fit_noise`` if the log is long ``enough``."""
    blocks = without_jumps(blocks, jumps)
    return blocks, fit_noise(stated, blocks, layout) if enough else None


class Touched(NamedTuple):
    """Contact with the tool in a log, by the rules of the filter."""

    contacts: tuple[Contact, ...] = ()
    """Intervals in which the reading leaves the model suddenly and returns."""
    all_along: bool = False
    """Whether the log has no free motion."""


def contacts_in(
    log: Log,
    tool: Float[np.ndarray, "T 6"],
    speed: Float[np.ndarray, "T n"],
    variance: Float[np.ndarray, "T 6"],
    weighs: bool = True,
) -> Touched:
    """Contact of a log, from the wrench, N, Nm, that the tool must cause, joint speed, rad/s, and variance of a sample.

    ``weighs`` states whether the tool's weight is in the reading.
    """
    layout = layout_of(np.diff(log.t))
    if len(log.t) // layout.size < LEAST_BLOCKS:
        return Touched()
    given = _padded(log, tool - log.wrench, speed, variance, tool if weighs else 0 * tool)
    contacts, middles, all_along = jax.tree.map(np.asarray, _contacts(*given, layout=layout))
    return Touched(listed(contacts, middles, layout), bool(all_along))


@keep_program("layout")
def _contacts(
    columns: tuple[Array, ...], jumps: Array | None, length: Array, *, layout: Layout
) -> tuple[Contacts, Array, Array]:
    blocks = _blocks(columns, jumps, length, layout)
    assert blocks.tool is not None
    as_seen = with_tool_as_seen(blocks, layout)
    contacts = find_contacts(as_seen, layout, slow_std(as_seen, layout))
    return contacts, blocks.t, is_touched_all_along(blocks, blocks.tool, layout)


def scatter_at_rest(
    log: Log,
    error: Float[np.ndarray, "T 6"],
    speed: Float[np.ndarray, "T n"],
    variance: Float[np.ndarray, "T 6"],
    noise_std: Float[np.ndarray, " 6"],
) -> Float[np.ndarray, " 6"]:
    """Scatter of readings within a block at rest, relative to the stated noise, as the filter finds and reports it.

    The error is the model's prediction minus the wrench, N, Nm, all else as for ``contacts_in``; ones if the log is too
    short.
    """
    layout = layout_of(np.diff(log.t))
    if len(log.t) // layout.size < LEAST_BLOCKS:
        return np.ones(6)
    level = _level(*_padded(log, error, speed, variance), noise_std**2, layout=layout)
    return np.sqrt(np.asarray(level))


def _padded(log: Log, *columns: np.ndarray) -> tuple[tuple[np.ndarray, ...], np.ndarray | None, np.ndarray]:
    """Stamps and columns of a log and the samples at which the sensor was set to zero, padded, and its length."""
    length = len(log.t)
    more = room_for(length) - length
    padded = tuple(np.pad(x, [(0, more), *[(0, 0)] * (x.ndim - 1)], mode="edge") for x in (log.t, *columns))
    jumps = np.asarray(log.is_rezeroed(log.t, None), float) if log.rezeroed_at else None
    return padded, None if jumps is None else np.pad(jumps, (0, more)), np.asarray(length)


@keep_program("layout")
def _level(
    columns: tuple[Array, ...], jumps: Array | None, length: Array, sensor: Array, *, layout: Layout
) -> Float[Array, " 6"]:
    blocks = _blocks(columns, jumps, length, layout)
    free = ~find_contacts(blocks, layout, slow_std(blocks, layout)).near & (jnp.arange(len(blocks.t)) < blocks.number)
    return fit_vibration(blocks, layout, free, sensor).level


def _blocks(columns: tuple[Array, ...], jumps: Array | None, length: Array, layout: Layout) -> Blocks:
    t, error, speed, variance, *tool = columns
    blocks = in_blocks(layout, t, error, speed, variance, length=length, tool=tool[0] if tool else None)
    return blocks if jumps is None else without_jumps(blocks, jumps_in(layout, jumps))
