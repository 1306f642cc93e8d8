"""Logs made ready for the diagnosis: smoothed joints, cleaned wrench, averaged to bins, and the noise of each bin."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
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
from ftbias_jax.types import Array, Log, Sample

SHORTEST_BIN = 0.01
"""s; a 25 Hz ringing of the tool is still seen."""
BINS = (1024, 2048, 4096, 8192)
"""Lengths that binned logs are padded to, so that they share compiled programs."""
MOST_BINS = 4096
"""Longer logs get longer bins."""


class Part(NamedTuple):
    """One log in bins, padded to B of them; a padded bin has no measurement."""

    signals: Signals
    """Motion at the bins, and what the setup says about robot and tool."""
    wrench: WrenchProblem
    """The bias filter on the bins: mean readings without the stated bias (B, 6), NaN = none, and their noise."""
    used: int
    """Bins before the padding."""


class Problem(NamedTuple):
    """One log, or several of one robot end to end. U = bins of all logs, without padding."""

    parts: tuple[Part, ...]
    t: np.ndarray
    """(U,) s since the start of the bin's own log."""
    log: np.ndarray
    """(U,) number of the bin's log."""
    samples: np.ndarray
    """(U, 6) how many in each bin."""
    variance: np.ndarray
    """(U, 6) N^2, Nm^2: noise of the bins' means, with that of the joints."""
    temperature: np.ndarray
    """(U,) deg C."""
    durations: tuple[float, ...]
    """s, of each log."""
    noise_std: np.ndarray
    """(6,) N, Nm, of one sample, as measured."""
    known: Values
    """Effects that the setup knows of."""

    @property
    def duration(self) -> float:
        """s, of all logs together."""
        return sum(self.durations)

    @property
    def joints(self) -> int:
        """Number of the robot's joints."""
        return int(self.parts[0].signals.q.shape[1])

    def block(self, seconds: float) -> np.ndarray:
        """(U,) numbers 0, 1, ... of pieces of so many seconds; none reaches over two logs."""
        return np.unique(np.stack([self.log, self.t // seconds]), axis=1, return_inverse=True)[1].reshape(-1)


def make_problem(setup: Setup, logs: Sequence[Log]) -> tuple[Problem, tuple[SampleFindings, ...]]:
    """Smooth the joints, examine the samples, and average what is left over short bins.

    Args:
        setup: beliefs. logs: as read, of one robot.

    Returns:
        the problem of the effects that change the mean reading, and what was read off each log's single samples.
    """
    prepared = [_prepare(setup, log) for log in logs]
    parts = tuple(part for part, *_ in prepared)
    found = tuple(found for *_, found in prepared)
    used = [part.used for part in parts]

    def join(arrays: Sequence[np.ndarray]) -> np.ndarray:
        return np.concatenate([np.asarray(array)[:length] for array, length in zip(arrays, used, strict=True)])

    return Problem(
        parts=parts,
        t=join([part.signals.t for part in parts]),
        log=np.repeat(np.arange(len(parts)), used),
        samples=join([count for _, count, _, _ in prepared]),
        variance=join([part.wrench.variance for part in parts]),
        temperature=join([part.signals.temperature for part in parts]),
        durations=tuple(float(log.t[-1]) for log in logs),
        noise_std=np.sqrt(np.mean([one.noise_std**2 for one in found], axis=0)),
        known=prepared[0][2],
    ), found


def _prepare(setup: Setup, log: Log) -> tuple[Part, np.ndarray, Values, SampleFindings]:
    """One log: bins, samples in each (B, 6), effects the setup knows of, and what the samples show."""
    options = Options(joint_model=setup.joints.model)
    samples = pipeline.samples_from_log(log)
    length = samples.dt.shape[0]
    samples = pipeline.pad(samples, batch.CHUNK * -(-length // batch.CHUNK) if length > 8192 else 8192)
    params = batch.likeliest_params(setup, samples, options)
    joints, reading, variance = (np.asarray(x)[:length] for x in _smooth(params, samples, options))
    rate = np.gradient(reading, log.t, axis=0)
    found = inspect_samples(log, setup.sensor.noise_std, reading - log.wrench, rate)
    joint_variance = variance - np.asarray(params.bias.wrench_variance)
    noise_std, coherent = noise_on_lattice(found, setup.sensor.noise_std)
    found = found._replace(noise_std=noise_std)
    late = float(np.max(found.stamp_jitter.parameters["std"])) if found.stamp_jitter.detected else 0.0
    part, count = _bin(params, log, joints, joint_variance + coherent, (late * rate) ** 2, found)
    return part, count, params.effects or {}, found


def noise_on_lattice(found: SampleFindings, stated_std: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Noise of one sample (6,) N, Nm with that of rounding, and the variance (6,) that averaging does not reduce.

    Noise smaller than the lattice's step hardly shows in the readings: there the stated one is believed. The error
    of rounding then follows the signal; the share of its variance that the noise leaves coherent is that of its first
    harmonic, exp(-4 pi^2 (noise / step)^2).
    """
    step = np.broadcast_to(np.asarray(found.quantisation.parameters.get("step", 0.0), float), (6,))
    coarse = step > stated_std
    noise_std = np.where(coarse, np.hypot(stated_std, step / np.sqrt(12)), found.noise_std)
    dither = np.exp(-((2 * np.pi * stated_std / np.where(coarse, step, 1.0)) ** 2))
    return noise_std, np.where(coarse, step**2 / 12 * dither, 0.0)


def bins_of(t: np.ndarray, duration: float) -> tuple[np.ndarray, int, int]:
    """The bin (T,) of every sample with a measurement, how many bins there are, and how many with their padding.

    Args:
        t: (T,) s, stamps of the samples. duration: s, of the log.
    """
    width = max(SHORTEST_BIN, np.nextafter(duration / MOST_BINS, np.inf))  # so that the last sample is in the last bin
    # Bins without a sample are left out: a bin of a slow log is a sample.
    found, index = np.unique((t / width).astype(int), return_inverse=True)
    used = len(found)
    return index, used, next((size for size in BINS if size >= used), used)


@partial(jax.jit, static_argnames="options")
def _smooth(params: Params, samples: Sample, options: Options) -> tuple[Array, Array, Array]:
    """Joint states (T, n, 3) given the whole log, the wrench (T, 6) they make the tool cause, and its variance."""
    joints = smooth.smooth_joints(params, pipeline.init(params, samples), samples, options)
    return joints.mean, *staged.predict_wrenches(params, joints, samples, options)


def _bin(
    params: Params,
    log: Log,
    states: np.ndarray,
    joint_variance: np.ndarray,
    jitter_variance: np.ndarray,
    found: SampleFindings,
) -> tuple[Part, np.ndarray]:
    wrench = found.clean_wrench
    rows = np.isfinite(wrench).any(1)
    t, duration = log.t[rows], float(log.t[-1])
    index, used, padded = bins_of(t, duration)

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
    late, _ = mean(jitter_variance[rows])
    stamps = pad(mean(t)[0])
    level, drift = np.asarray(params.bias.prior_mean).reshape(2, 6)
    temperature = pad(mean(fill_temperature(log.t, log.temperature)[rows])[0])
    q, dq, ddq = np.moveaxis(pad(joints), 2, 0)
    stated = Model(params.arm, params.gravity, params.theta)
    place = jnp.asarray
    signals = Signals(place(stamps), place(q), place(dq), place(ddq), place(temperature), stated)
    # The smoothed joints' error hangs together over longer than a bin, so averaging does not reduce it.
    variance = np.where(count > 0, (found.noise_std**2 + late) / np.maximum(count, 1) + spread, 1.0)
    bins = WrenchProblem(
        place(np.diff(stamps, prepend=stamps[0])),
        place(pad(reading + level + drift * mean(t)[0][:, None], np.nan)),
        place(pad(variance, 1.0)),
        params.bias.density,
        params.bias.prior_std,
    )
    return Part(signals, bins, used), count
