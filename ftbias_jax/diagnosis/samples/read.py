"""Effects found in single samples before anything is averaged, and the wrench without the samples they destroyed.

Order: repeated rows and lattices (exact numbers), flat tops, spikes, then the white noise of the remaining samples, and
whether it grows with the rate of the wrench or with the speed of the joints. Lower limits on the size of an effect
state what still matters to the owner.
"""

from typing import NamedTuple, Self

import numpy as np

from ftbias_jax.diagnosis.samples import exact
from ftbias_jax.diagnosis.samples.bins import moving_mean
from ftbias_jax.diagnosis.samples.growth import Growth, measure_growth, no_growth
from ftbias_jax.diagnosis.samples.jitter import Jitter, correlation_along, measure_jitter, no_jitter
from ftbias_jax.diagnosis.samples.noise import WINDOW, Noise, fast_waves, judge_noise, measure_noise
from ftbias_jax.diagnosis.samples.spikes import REACH, Spikes, find_outliers, find_spikes
from ftbias_jax.diagnosis.samples.types import Finding, SampleFindings, log_likelihood_ratio
from ftbias_jax.diagnosis.thresholds import AROUND_CLIPPED, COARSE, FORM_LOSS, LEAST_SCATTER, LEAST_WINDOWS, SURPRISING
from ftbias_jax.io.log import Log
from ftbias_jax.model.motion_noise import MotionNoise
from ftbias_jax.types import Array

JITTER_SHAPE = 0.1
"""Relative error of the part of the noise that is attributed to jitter, whose distribution is not known."""


class Samples(NamedTuple):
    """The N rows of a log that have a wrench, in k channels, with the model's error and rate at these rows."""

    row: np.ndarray
    """(N,) indices of the rows in the log."""
    channels: np.ndarray
    """(6,) bool: which channels are used."""
    t: np.ndarray
    """(N,) s."""
    wrench: np.ndarray
    """(N, k) N, Nm."""
    error: np.ndarray
    """(N, k) N, Nm, error of the model."""
    rate: np.ndarray
    """(N, k) N/s, Nm/s, dW/dt of the model."""
    stated: np.ndarray
    """(k,) N, Nm, stated noise."""
    speed: np.ndarray
    """(N, n) rad/s, speeds of the joints; n = 0 if there are none."""

    def only(self, keep: np.ndarray) -> Self:
        """Only the rows marked in (N,)."""
        per_row = ("row", "t", "wrench", "error", "rate", "speed")
        return self._replace(**{name: getattr(self, name)[keep] for name in per_row})

    def at_rest(self, growth: MotionNoise) -> Self:
        """Samples with the fast part of the error, scaled to the noise at rest; growth: per variance at rest."""
        if not self.speed.size or not growth.per_speed.any():
            return self
        louder = np.sqrt(1 + growth.variance(self.speed))
        fast = self.error - moving_mean(self.error)  # a slow error divided by a fast factor would look like noise
        return self._replace(error=fast / louder, rate=self.rate / louder)


def inspect_samples(
    log: Log,
    noise_std: Array,
    error: Array,
    rate: Array,
    speed: Array | None = None,
    in_motion: MotionNoise | None = None,
    touched: Array | None = None,
) -> SampleFindings:
    """Find the signs of effects in single samples (``fitting.SIGNS``).

    Args:
        log: as recorded, NaN = not measured.
        noise_std: (6,) N, Nm, stated white noise of one sample.
        error: (T, 6) N, Nm, the model's prediction minus the wrench.
        rate: (T, 6) N/s, Nm/s, the model's dW/dt.
        speed: (T, n) rad/s, of the joints, if known; without it noise is not expected to grow with the motion.
        in_motion: growth of the noise with the motion in six channels as stated in the setup; it is then not measured
            again. None = not stated.
        touched: (T,) samples in contact, whose fluctuations say nothing of the sensor's noise and clock. None = none.
    """
    stated = np.asarray(noise_std, float)
    samples = _select(log, stated, error, rate, speed)
    known = MotionNoise(np.zeros((1, 6))) if in_motion is None else in_motion.as_numbers()
    if len(samples.t) < LEAST_WINDOWS * WINDOW:
        return _nothing(log, stated, known, f"only {len(samples.t)} samples of the wrench")
    samples = samples.at_rest(known._replace(per_speed=(known.per_speed / stated**2)[:, samples.channels]))
    lattices = [exact.find_lattice(x) for x in samples.only(~exact.repeated_rows(samples.wrench)).wrench.T]
    step, step_stderr = (np.array([lattice[i] for lattice in lattices], float) for i in range(2))
    fine = step < COARSE * samples.stated  # on a coarse lattice equal numbers are no evidence
    repeated, by_chance = exact.repeated_rows(samples.wrench) & fine.any(), exact.repeated_by_chance(samples.wrench)
    if log_likelihood_ratio(repeated.sum(), by_chance) < SURPRISING:
        repeated[:] = False

    kept = samples.only(~repeated)
    tops = [exact.find_flat_tops(*column) for column in zip(kept.wrench.T, kept.stated, step, strict=True)]
    at_limit = np.stack([exact.at_top(x, found) for x, found in zip(samples.wrench.T, tops, strict=True)], 1)
    # Rows in which every axis is clipped are equal too, but none of them is lost.
    dropped = exact.find_dropped(repeated & ~at_limit[:, fine].all(1), exact.find_gaps(samples.t), by_chance)
    saturated = at_limit[~repeated]
    usable = np.asarray(~saturated.any(1))
    if touched is not None and (free := usable & ~touched[kept.row]).sum() >= LEAST_WINDOWS * WINDOW:
        usable = free
    spikes, noise, jitter = _scatter(kept, step, saturated, usable)
    growth = no_growth(1, noise.std**2)
    if in_motion is None and not jitter.detected:
        growth = _growth(kept.only(usable & ~spikes.outlier_rows), step)
    if growth.detected:
        as_at_rest = kept.at_rest(growth.relative)
        spikes, noise, jitter = _scatter(as_at_rest, step, saturated, usable)
        if jitter.detected and jitter.nats < FORM_LOSS * growth.nats:  # within the form error of the growth
            spikes, noise, jitter = _scatter(as_at_rest, step, saturated, usable, late_stamps=False)

    def six(values: np.ndarray, neutral: float | np.ndarray = 0.0) -> np.ndarray:
        """Expand to six channels: those that are not measured get a neutral value."""
        return _among(values, samples.channels, neutral)

    std, stderr, low, high = six(noise.std, stated), six(noise.stderr), six(noise.low, stated), six(noise.high, stated)
    if growth.detected:
        lower, upper = (six(edge(1, growth.rest_factor), 1.0) for edge in (np.minimum, np.maximum))
        low, high = low * lower, high * upper
    noise = Noise(std, stderr, low, high, six(noise.coloured))
    growth = growth._replace(variance=six(growth.variance), stderr=six(growth.stderr))
    clean = np.array(log.wrench, float)
    clean[samples.row[repeated]] = np.nan
    # Near a limit noise takes the higher readings of a pose to it, so the mean of the remaining ones is too low.
    near_limit = six(_around(saturated, AROUND_CLIPPED))
    clean[kept.row] = np.where(spikes.outlier_rows[:, None] | near_limit, np.nan, clean[kept.row])
    moving = MotionNoise(growth.variance, growth.speed) if growth.detected else known
    of_channel = dict(zip(np.flatnonzero(samples.channels).tolist(), tops, strict=True))
    return SampleFindings(
        judge_noise(noise, stated, six(step), bool(moving.per_speed.any()), growth.shows_rest),
        find_outliers(spikes._replace(hit=six(spikes.hit), off=six(spikes.off), scale=six(spikes.scale))),
        exact.find_quantisation(lattices, six(step), six(step_stderr), stated),
        exact.find_saturation([of_channel.get(i, []) for i in range(6)]),
        dropped,
        jitter.finding,
        growth.finding,
        clean,
        std,
        stderr,
        spikes.heavy_tailed,
        moving,
    )


def _select(log: Log, stated: np.ndarray, error: Array, rate: Array, speed: Array | None) -> Samples:
    """Rows with all channels that share the clock of the most frequent one; arguments as of ``inspect_samples``."""
    wrench, error = np.asarray(log.wrench, float), np.asarray(error, float)
    finite = np.isfinite(wrench)
    most = finite[:, finite.sum(0).argmax()]
    channels = (finite & most[:, None]).sum(0) > most.sum() / 2
    row = np.flatnonzero((finite & np.isfinite(error))[:, channels].all(1) & most)
    rates = np.nan_to_num(np.asarray(rate, float)[row][:, channels])
    speeds = np.zeros((len(row), 0)) if speed is None else np.asarray(speed, float)[row]
    measured, errors = (x[row][:, channels] for x in (wrench, error))
    return Samples(row, channels, np.asarray(log.t, float)[row], measured, errors, rates, stated[channels], speeds)


def _nothing(log: Log, stated: np.ndarray, known: MotionNoise, reason: str) -> SampleFindings:
    """Findings of a log that cannot be examined: nothing is detected, for this reason."""
    a, b, c, d, e, f, g = (Finding(name, False, {}, {}, 0.0, reason) for name in SampleFindings._fields[:7])
    return SampleFindings(a, b, c, d, e, f, g, np.array(log.wrench, float), stated, np.zeros(6), False, known)


def _among(values: np.ndarray, marked: np.ndarray, neutral: float | np.ndarray) -> np.ndarray:
    """(..., k) values of the channels marked in (c,) -> (..., c), neutral for the others."""
    full = np.array(np.broadcast_to(neutral, (*values.shape[:-1], len(marked))), values.dtype)
    full[..., marked] = values
    return full


def _around(marked: np.ndarray, reach: int) -> np.ndarray:
    """(N, k) samples that are marked, or within ``reach`` samples of a marked one."""
    counts = np.apply_along_axis(np.convolve, 0, marked, np.ones(2 * reach + 1))
    return counts[reach : reach + len(marked)] > 0.5  # also correct for fewer samples than the window


def _scatter(
    samples: Samples, step: np.ndarray, saturated: np.ndarray, usable: np.ndarray, *, late_stamps: bool = True
) -> tuple[Spikes, Noise, Jitter]:
    """Spikes, white noise and, if searched for, jitter; spikes are then what exceeds the noise with jitter.

    Noise and jitter are measured in the ``usable`` rows (N,).
    """
    least = np.maximum(step, LEAST_SCATTER * samples.stated)
    blind = _around(saturated, REACH)
    floor = np.where(blind, np.inf, least)
    for _ in range(2):
        spikes = find_spikes(samples.error, floor)
        noise, jitter = _noise(samples.only(usable & ~spikes.outlier_rows), step, spikes.heavy_tailed, late_stamps)
        if not jitter.detected:
            break
        late = jitter.std * np.abs(samples.rate)
        floor = np.where(blind, np.inf, np.maximum(np.hypot(noise.std, late), least))
    return spikes, noise, jitter


def _growth(samples: Samples, step: np.ndarray) -> Growth:
    """Growth of the noise with the speed of the joints, from rows that no other effect has corrupted.

    On a lattice coarser than the stated noise the rounding error grows with the rate of the wrench.
    """
    fine, speed, rest = step < samples.stated, samples.speed, samples.stated**2
    if not speed.size or not fine.any() or len(samples.t) < LEAST_WINDOWS * WINDOW:
        return no_growth(max(speed.shape[1], 1), rest)
    waves = fast_waves(samples.t, samples.error)
    row = waves.row.reshape(-1)
    growth = measure_growth(samples.t[row], waves.top_squares[:, fine], speed[row], len(samples.t))
    return growth._replace(
        variance=_among(growth.variance, fine, 0.0),
        stderr=_among(growth.stderr, fine, 0.0),
        rest=_among(growth.rest, fine, rest),
        rest_factor=_among(growth.rest_factor, fine, 1.0),
    )


def _noise(samples: Samples, step: np.ndarray, heavy_tailed: bool, late_stamps: bool) -> tuple[Noise, Jitter]:
    """White noise (k,) and jitter of rows that no other effect has corrupted; the stated noise for too few rows."""
    stated = samples.stated
    none = no_jitter(stated)
    if len(samples.t) < LEAST_WINDOWS * WINDOW:
        return Noise(stated, np.zeros_like(stated), stated, stated, np.zeros(len(stated), bool)), none
    waves = fast_waves(samples.t, samples.error)
    noise = measure_noise(waves, samples.error, stated, heavy_tailed)
    fine = (step < stated) & (noise.std > 0)  # on a coarser lattice the rounding error grows with the rate
    if not late_stamps or fine.sum() < 2:  # one channel has no direction across the change
        return noise, none
    jitter = measure_jitter(waves.top[..., fine], samples.rate[waves.row].mean(1)[:, fine], noise.std[fine])
    if jitter.detected:
        along = correlation_along(samples.error[:, fine], samples.rate[:, fine], jitter.noise_std)
        jitter = jitter._replace(correlation=along)
    if jitter.detected:
        std = noise.std.copy()
        std[fine] = jitter.noise_std
        stderr = np.hypot(noise.stderr, JITTER_SHAPE * (noise.std - std))
        low, high = np.where(fine, std, noise.low), np.where(fine, std, noise.high)
        noise = Noise(std, stderr, low, high, noise.coloured & ~fine)
    return noise, jitter
