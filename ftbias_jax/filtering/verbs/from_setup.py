"""The verbs of filtering: everything they need is in a setup and a log."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ftbias_jax.filtering import filter_log as chunks
from ftbias_jax.filtering.pipeline import options_from_setup
from ftbias_jax.filtering.quality import observability
from ftbias_jax.filtering.quality.summary import summarise
from ftbias_jax.filtering.samples import samples_from_log
from ftbias_jax.filtering.verbs.results import FilterResult, SmoothResult
from ftbias_jax.io.log import Log
from ftbias_jax.model.params import Params
from ftbias_jax.runtime.jax_config import in_float64
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Sample


def _nobody(done: int) -> None:
    """Progress that nobody wants to know."""


@in_float64
def filter_log(
    setup: Setup, log: Log, *, smooth: bool = False, progress: Callable[[int], None] = _nobody
) -> FilterResult:
    """Bias, drift and corrected wrench of a log, each from the samples before it.

    Computes in float64 whatever JAX's setting is, and keeps compiled programs in the user's cache folder
    (``FTBIAS_CACHE=off`` does not). The joints' process noise is what the setup states, or the likeliest of the log,
    and LAG_GUARD times as much, as by ``params_for_log``.

    Args:
        setup: robot, sensor, tool and noise.
        log: what ``read_log`` gives.
        smooth: add the bias given past and future, as ``smooth_log`` finds it.
        progress: told the samples done so far.

    Returns:
        arrays at the stamps of the wrench; ``print`` shows what ``ftbias filter`` prints.
    """
    options = options_from_setup(setup)
    likeliest = chunks.likeliest_params(setup, samples_from_log(log), options)
    params = chunks.guard_against_lag(likeliest)
    filtered = chunks.filter_with_params(params, log, options, progress)
    extra = {}
    if smooth:
        mean, std = chunks.smooth_with_params(likeliest, log, options)
        extra = {"bias_smooth": mean[:, 0], "drift_smooth": mean[:, 1]}
        extra |= {"bias_smooth_std": std[:, 0], "drift_smooth_std": std[:, 1]}
    turning = observability.add(observability.start(), params, filtered)
    return FilterResult(
        **filtered._asdict(),
        params=params,
        joint_model=setup.joints.model,
        repairs=(*log.repairs, *observability.remarks(turning)),
        start=log.start,
        summary=summarise(filtered),
        **extra,
    )


@in_float64
def smooth_log(setup: Setup, log: Log) -> SmoothResult:
    """Bias, drift and corrected wrench of a log, each from all samples, past and future; no lag is left.

    Computes in float64, see ``filter_log``. The whole log is held in memory, about 2 kB a sample.

    Args:
        setup: robot, sensor, tool and noise.
        log: what ``read_log`` gives.

    Returns:
        arrays at the stamps of the wrench.
    """
    options = options_from_setup(setup)
    params = chunks.likeliest_params(setup, samples_from_log(log), options)
    mean, std = chunks.smooth_with_params(params, log, options)
    rows = np.isfinite(log.wrench).any(1)
    return SmoothResult(
        t=log.t[rows] + log.start,
        bias=mean[:, 0],
        drift=mean[:, 1],
        bias_std=std[:, 0],
        drift_std=std[:, 1],
        wrench_unbiased=log.wrench[rows] + mean[:, 0],
        start=log.start,
    )


def params_for_log(setup: Setup, log: Log | Sample) -> Params:
    """Parameters that the verbs filter a log with, as arrays of JAX: for programs of your own.

    Args:
        setup: robot, sensor, tool and noise.
        log: what ``read_log`` gives, or ``samples_from_log`` of it; a joint process noise that the setup leaves open
            is the likeliest of this log.

    Returns:
        a pytree in JAX's own precision (float32, unless ``jax_enable_x64`` is set).
    """
    samples = samples_from_log(log) if isinstance(log, Log) else log
    return chunks.params_for_log(setup, samples, options_from_setup(setup))
