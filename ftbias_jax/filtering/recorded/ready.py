"""A log made ready to be filtered, as a recording or as a filter on the robot would see it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np

from ftbias_jax.filtering import filter_log as chunks
from ftbias_jax.filtering.adapt.log_noise import LogNoise, nothing, useless
from ftbias_jax.filtering.pipeline import Options, options_from_setup
from ftbias_jax.filtering.recorded.whole import filter_recorded
from ftbias_jax.filtering.result import Filtered, join
from ftbias_jax.filtering.samples import arrays_from_log, first_position
from ftbias_jax.io.log import Log
from ftbias_jax.model.params import Params
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array


class Ready(NamedTuple):
    """What a log is filtered with, and its results part by part."""

    params: Params
    smoothing: Params
    """The same without a guard against the joint filter's lag, which smoothing does not have."""
    noise: LogNoise
    results: Callable[[], Iterator[Filtered]]


def ready_to_filter(
    setup: Setup,
    likeliest: Params,
    first_q: Array,
    parts: Callable[[], Iterable[Log]],
    length: int,
) -> Ready:
    """Look at a log, unless ``[bias] adapt = false`` asks for a filter as it would run on the robot.

    Args:
        setup: of the log.
        likeliest: what ``filter_log.likeliest_params`` gives.
        first_q: (n,) rad, the first measured position of every joint.
        parts: reads the log in parts, as ``in_parts`` cuts it; called once or twice.
        length: samples of the log.
    """
    options = options_from_setup(setup)
    if not setup.bias.adapt:
        guarded = chunks.guard_against_lag(likeliest)
        return Ready(guarded, likeliest, nothing(), lambda: chunks.filter_parts(guarded, first_q, parts(), options))
    found = filter_recorded(likeliest, first_q, parts, length, options)
    return Ready(found.params, found.params, found.noise, found.results)


def in_parts(log: Log, params: Params) -> Iterator[Log]:
    """A log in parts of CHUNK samples; in one part if known effects need it whole."""
    size = chunks.CHUNK if params.effects is None else len(log.t)
    return (log._replace(**chunks.rows_of(log, i, size)) for i in range(0, len(log.t), size))


def smoothed_arrays(ready: Ready, log: Log, options: Options) -> dict[str, Array]:
    """The bias given past and future, by the names of the output file; the log is held in memory, 2 kB a sample."""
    touched = useless(log.t, ready.noise)
    free = log._replace(wrench=np.where(touched[:, None], np.nan, log.wrench))
    rows = np.isfinite(log.wrench).any(1)
    mean, std = chunks.smooth_with_params(ready.smoothing, free, options, at=rows)
    std = std * ready.noise.inflation
    return {
        "bias_smooth": mean[:, 0],
        "drift_smooth": mean[:, 1],
        "bias_smooth_std": std[:, 0],
        "drift_smooth_std": std[:, 1],
    }


def filtered_with(setup: Setup, log: Log) -> tuple[Filtered, Params]:
    """A log filtered as ``ftbias filter`` does it, and the parameters that the filter took."""
    likeliest = chunks.likeliest_params(setup, arrays_from_log(log), options_from_setup(setup))
    first_q = first_position(log.q)
    ready = ready_to_filter(setup, likeliest, first_q, lambda: in_parts(log, likeliest), len(log.t))
    return join(list(ready.results())), ready.params
