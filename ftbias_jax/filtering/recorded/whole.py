"""Filter a recorded log: joints smoothed, then the noise that the log shows, then the bias, sample by sample.

A recording has the joints' future as well as their past. Smoothed joints have no lag, so the wrench of the tool is
right while the arm accelerates, and their process noise needs no guard. The bias is still filtered: at every sample it
is what the wrench so far says. The log is worked through in parts, so memory does not grow with it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

from ftbias_jax.filtering.adapt.blocks import Blocks, in_blocks, join_blocks, without_jumps
from ftbias_jax.filtering.adapt.log_noise import LEAST_BLOCKS, LogNoise, noise_of_log, with_noise
from ftbias_jax.filtering.adapt.sample_noise import sample_variance, shown_variance, stated_shaking
from ftbias_jax.filtering.pipeline import Options
from ftbias_jax.filtering.recorded.begin_again import filter_or_begin_again
from ftbias_jax.filtering.recorded.bias import filter_prepared
from ftbias_jax.filtering.recorded.prepare import Prepared, prepare
from ftbias_jax.filtering.result import Filtered
from ftbias_jax.io.log import Log
from ftbias_jax.model.params import Params
from ftbias_jax.types import Array

GATE = 6.0
"""Standard deviations: with the noise of the log, spikes and short contacts are off by more, and nothing else is."""
MOST_KEPT = 1 << 19
"""Samples of a log whose joints are kept between the two passes; those of a longer one are smoothed twice."""
MOST_JUDGED = 1 << 17
"""Samples of a log that is filtered again where its gate keeps most of it out. In a longer one it has opened long
before, because the bias is forgotten meanwhile (``process_models.FORGET``)."""
Parts = Callable[[], Iterable[Log]]
"""Reads the log once more, in parts of CHUNK samples but for the last."""


class Recorded(NamedTuple):
    """A log ready to be filtered: what it shows of its noise, and its results part by part."""

    params: Params
    """With the noise of the log."""
    noise: LogNoise
    results: Callable[[], Iterator[Filtered]]


def filter_recorded(params: Params, first_q: Array, parts: Parts, length: int, options: Options) -> Recorded:
    """Look at a whole log, then filter it.

    Args:
        params: with the likeliest process noise of the joints (``filter_log.likeliest_params``).
        first_q: (n,) rad, the first measured position of every joint.
        parts: reads the log; called once or, for a log of more than MOST_KEPT samples, twice.
        length: samples of the log.
        options: of the pipeline.
    """

    def again() -> Iterator[Prepared]:
        return prepare(params, first_q, parts(), options)

    kept = list(again()) if length <= MOST_KEPT else None
    blocks = blocks_of(again() if kept is None else kept, params)
    noise = noise_of_log(blocks, params)
    tuned = with_noise(params, noise)
    by_default = options.gate is None and len(blocks.t) >= LEAST_BLOCKS
    if by_default:  # without the log's noise a gate may keep out anything
        options = options._replace(gate=GATE)

    def run(tuned: Params) -> Iterator[Filtered]:
        parts = again() if kept is None else kept
        return filter_prepared(tuned, (with_variance(part, params, noise) for part in parts), options, noise)

    if kept is None or not by_default or length > MOST_JUDGED:
        return Recorded(tuned, noise, lambda: run(tuned))
    tuned, told, found = filter_or_begin_again(tuned, noise, blocks, kept, run)
    return Recorded(tuned, told, lambda: iter(found))


def with_variance(part: Prepared, params: Params, noise: LogNoise) -> Prepared:
    """A part with the noise of single samples that the log shows beside, or in place of, what the setup states."""
    stated = (params, noise.vibration, part.variance, part.joints.mean[:, 1])
    return part._replace(variance=sample_variance(*stated), shown=shown_variance(*stated))


def blocks_of(parts: Iterable[Prepared], params: Params) -> Blocks:
    """The whole log in blocks, without jumps where the sensor was set to zero; params as it was prepared with."""
    blocks: list[Blocks] = []
    rezeroed_at: tuple[float, ...] = ()
    for part in parts:
        blocks.append(_in_blocks(part, params))
        rezeroed_at = part.log.rezeroed_at
    return without_jumps(join_blocks(blocks), rezeroed_at)


def _in_blocks(part: Prepared, params: Params) -> Blocks:
    velocity = part.joints.mean[:, 1]
    shaking = stated_shaking(params, velocity)
    return in_blocks(part.log.t, part.wrench_tool - part.samples.wrench, velocity, part.variance, shaking)
