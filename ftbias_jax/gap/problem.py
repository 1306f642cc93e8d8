"""A log made ready for the diagnosis: smoothed joints, cleaned wrench, averaged to bins, and the noise of each bin."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from ftbias_jax import batch, pipeline, smooth, staged
from ftbias_jax.effects.chain import fill_temperature
from ftbias_jax.effects.types import Model, Signals, Values
from ftbias_jax.gap.samples import inspect_samples
from ftbias_jax.gap.samples_types import SampleFindings
from ftbias_jax.likelihood import WrenchProblem
from ftbias_jax.pipeline import Options, Params
from ftbias_jax.setup_types import Setup
from ftbias_jax.types import Log

SHORTEST_BIN = 0.01
"""s; a 25 Hz ringing of the tool is still seen."""
BINS = (1024, 2048, 4096, 8192)
"""Lengths that binned logs are padded to, so that they share compiled programs."""
MOST_BINS = 4096
"""Longer logs get longer bins."""


class Problem(NamedTuple):
    """One log in bins. B = bins, padded; a padded bin has no measurement."""

    signals: Signals
    """Motion at the bins, and what the setup says about robot and tool."""
    wrench: WrenchProblem
    """The bias filter on the bins: mean readings (B, 6), NaN = none, and their noise variance."""
    samples: np.ndarray
    """(B, 6) how many in each bin."""
    used: int
    """Bins before the padding."""
    duration: float
    """s."""
    noise_std: np.ndarray
    """(6,) N, Nm, of one sample."""
    stated_std: np.ndarray
    """(6,) the same as the setup states it."""
    known: Values
    """Effects that the setup knows of."""


def make_problem(setup: Setup, log: Log) -> tuple[Problem, SampleFindings]:
    """Smooth the joints, examine the samples, and average what is left over short bins.

    Args:
        setup: beliefs. log: as read.

    Returns:
        the problem of the effects that change the mean reading, and what was read off single samples.
    """
    options = Options(joint_model=setup.joints.model)
    samples = pipeline.samples_from_log(log)
    length = samples.dt.shape[0]
    samples = pipeline.pad(samples, batch.CHUNK * -(-length // batch.CHUNK) if length > 8192 else 8192)
    params = batch.likeliest_params(setup, samples, options)
    joints = smooth.smooth_joints(params, pipeline.init(params, samples), samples, options)
    reading, variance = (np.asarray(x)[:length] for x in staged.predict_wrenches(params, joints, samples, options))
    rate = np.gradient(reading, log.t, axis=0)
    found = inspect_samples(log, setup.sensor.noise_std, reading - log.wrench, rate)
    states = np.asarray(joints.mean)[:length]
    joint_variance = variance - np.asarray(params.bias.wrench_variance)
    return _bin(params, log, states, joint_variance, found.clean_wrench, found.noise_std, setup), found


def _bin(
    params: Params,
    log: Log,
    states: np.ndarray,
    joint_variance: np.ndarray,
    wrench: np.ndarray,
    noise_std: np.ndarray,
    setup: Setup,
) -> Problem:
    rows = np.isfinite(wrench).any(1)
    t, duration = log.t[rows], float(log.t[-1])
    width = max(SHORTEST_BIN, duration / MOST_BINS)
    # Bins without a sample are left out: a bin of a slow log is a sample.
    _, index = np.unique((t / width).astype(int), return_inverse=True)
    used = int(index[-1]) + 1
    padded = next((size for size in BINS if size >= used), used)

    def mean(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        flat = x.reshape(len(x), -1)
        known = np.isfinite(flat)
        count = np.stack([np.bincount(index, column, used) for column in known.T], -1)
        total = np.stack([np.bincount(index, column, used) for column in np.where(known, flat, 0).T], -1)
        with np.errstate(invalid="ignore"):
            return (total / count).reshape(used, *x.shape[1:]), count.reshape(used, *x.shape[1:])

    def pad(x: np.ndarray, value: float | None = None) -> np.ndarray:
        filler = x[-1:] if value is None else np.full_like(x[-1:], value)
        return np.concatenate([x, np.repeat(filler, padded - used, 0)])

    reading, count = mean(wrench[rows])
    joints, _ = mean(states[rows])
    spread, _ = mean(joint_variance[rows])
    stamps = pad(mean(t)[0])
    temperature = pad(mean(fill_temperature(log.t, log.temperature)[rows])[0])
    q, dq, ddq = np.moveaxis(pad(joints), 2, 0)
    stated = Model(params.arm, params.gravity, params.theta)
    place = jnp.asarray
    signals = Signals(place(stamps), place(q), place(dq), place(ddq), place(temperature), stated)
    # The smoothed joints' error hangs together over longer than a bin, so averaging does not reduce it.
    variance = np.where(count > 0, noise_std**2 / np.maximum(count, 1) + spread, 1.0)
    bins = WrenchProblem(
        jnp.asarray(np.diff(stamps, prepend=stamps[0])),
        jnp.asarray(pad(reading, np.nan)),
        jnp.asarray(pad(variance, 1.0)),
        params.bias.density,
        params.bias.prior_std,
    )
    return Problem(
        signals, bins, pad(count, 0), used, duration, noise_std, setup.sensor.noise_std, params.effects or {}
    )
