"""Effects that are read off the samples before anything is averaged, and the wrench without the samples they destroyed.

Order: repeated rows and lattices (exact numbers), flat tops, spikes, then the white noise of what is left, and whether
it grows with the rate of the wrench. Floors on the size of an effect say what still matters to the owner.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ftbias_jax.gap import samples_exact as exact
from ftbias_jax.gap import samples_findings as findings
from ftbias_jax.gap.samples_jitter import Jitter, measure_jitter
from ftbias_jax.gap.samples_noise import WINDOW, Noise, fast_waves, measure_noise
from ftbias_jax.gap.samples_spikes import REACH, Spikes, find_spikes
from ftbias_jax.gap.samples_types import SampleFindings
from ftbias_jax.types import Array, Log

LEAST_WINDOWS = 8
JITTER_SHAPE = 0.1
"""Relative error of the part of the noise that is put down to jitter: its distribution is not known."""
LEAST_SCATTER = 0.2
"""Stated sigmas: in a quieter log a spike of six of its own sigmas is still within the stated noise."""


class _Samples(NamedTuple):
    """Rows with a wrench. N = rows, k = channels that are measured."""

    row: np.ndarray
    """(N,) of the log."""
    channels: np.ndarray
    """(6,) bool."""
    t: np.ndarray
    """(N,) s."""
    wrench: np.ndarray
    """(N, k) N, Nm."""
    signal: np.ndarray
    """(N, k) N, Nm: the error of the model if known, else the wrench."""
    rate: np.ndarray
    """(N, k) N/s, Nm/s, of the model if known, else of the wrench."""
    stated: np.ndarray
    """(k,) N, Nm, noise."""

    def only(self, keep: np.ndarray) -> _Samples:
        """The rows marked in (N,)."""
        parts = (self.t[keep], self.wrench[keep], self.signal[keep], self.rate[keep])
        return _Samples(self.row[keep], self.channels, *parts, self.stated)


def inspect_samples(
    log: Log, noise_std: Array, error: Array | None = None, rate: Array | None = None
) -> SampleFindings:
    """Find noise_level, outliers, quantisation, saturation, dropped_samples and stamp_jitter.

    Args:
        log: as recorded, NaN = not measured.
        noise_std: (6,) N, Nm, stated white noise of one sample.
        error: (T, 6) N, Nm, the model's prediction less the wrench, if known: slow logs need it, as motion between
            two of their samples looks like noise.
        rate: (T, 6) N/s, Nm/s, the model's dW/dt, if known; else it is taken from the signal.
    """
    stated = np.asarray(noise_std, float)
    samples = _measured(log, stated, error, rate)
    lattices = [exact.find_lattice(x) for x in samples.only(~exact.repeated_rows(samples.wrench)).wrench.T]
    step = np.array([lattice.step for lattice in lattices])
    repeated = _repeated(samples, step)
    dropped = findings.find_dropped(repeated, exact.find_gaps(samples.t))

    kept = samples.only(~repeated)
    tops = [_flat_tops(*column) for column in zip(kept.wrench.T, kept.stated, step, strict=True)]
    saturated = np.stack([_at_top(x, found) for x, found in zip(kept.wrench.T, tops, strict=True)], 1)
    spikes, noise, jitter = _scatter(kept, step, saturated)
    wild = spikes.hit.any(1) & (not spikes.heavy_tailed)

    def six(values: np.ndarray, neutral: float | np.ndarray = 0.0) -> np.ndarray:
        """Channels that are not measured get a neutral value."""
        full = np.array(np.broadcast_to(neutral, (*values.shape[:-1], 6)), values.dtype)
        full[..., samples.channels] = values
        return full

    none = exact.Lattice(0.0, 0.0, 0)
    measured = np.flatnonzero(samples.channels)
    by_channel = dict(zip(measured, zip(lattices, tops, strict=True), strict=True))
    full_noise = Noise(*(six(x, x0) for x, x0 in zip(noise, (stated, 0.0, stated, stated, False), strict=True)))
    clean = np.full((len(log.t), 6), np.nan)
    clean[kept.row] = np.where(wild[:, None] | six(saturated, False), np.nan, np.asarray(log.wrench)[kept.row])
    return SampleFindings(
        findings.judge_noise(full_noise, stated, six(step)),
        findings.find_outliers(spikes._replace(hit=six(spikes.hit), off=six(spikes.off), scale=six(spikes.scale))),
        findings.find_quantisation([by_channel.get(i, (none, []))[0] for i in range(6)], stated),
        findings.find_saturation([by_channel.get(i, (none, []))[1] for i in range(6)]),
        dropped,
        findings.judge_jitter(jitter),
        clean,
        np.where(full_noise.coloured, np.clip(stated, full_noise.low, full_noise.high), full_noise.std),
        full_noise.stderr,
        full_noise.coloured,
        spikes.heavy_tailed,
    )


def _measured(log: Log, stated: np.ndarray, error: Array | None, rate: Array | None) -> _Samples:
    """The rows that have all channels that are measured at all, and a prediction if there is any."""
    wrench = np.asarray(log.wrench, float)
    finite = np.isfinite(wrench)
    channels = finite.sum(0) > finite.sum(0).max() / 2
    complete = finite[:, channels].all(1)
    signal = wrench if error is None else np.asarray(error, float)
    complete &= np.isfinite(signal[:, channels]).all(1)
    row = np.flatnonzero(complete)
    t, measured = np.asarray(log.t, float)[row], wrench[row][:, channels]
    rates = _own_rate(t, measured) if rate is None else np.nan_to_num(np.asarray(rate, float)[row][:, channels])
    return _Samples(row, channels, t, measured, signal[row][:, channels], rates, stated[channels])


def _repeated(samples: _Samples, step: np.ndarray) -> np.ndarray:
    """(N,) rows that repeat the one before; on a coarse lattice (k,) equal numbers are no evidence."""
    fine = step < findings.COARSE * samples.stated
    return exact.repeated_rows(samples.wrench[:, fine]) & fine.any()


def _flat_tops(x: np.ndarray, noise_std: float, step: float) -> list[exact.FlatTop]:
    """Limits of one channel (N,), on either side."""
    tops = (exact.find_flat_top(x, side, noise_std, step) for side in (1.0, -1.0))
    return [top for top in tops if top]


def _at_top(x: np.ndarray, tops: list[exact.FlatTop]) -> np.ndarray:
    """(N,) samples that are at a limit, which may have been rounded to the log's precision."""
    near = 8 * np.finfo(np.float32).eps
    at = [np.sign(top.value) * (x - top.value) >= -near * abs(top.value) for top in tops]
    return np.logical_or.reduce(at) if at else np.zeros(len(x), bool)


def _scatter(samples: _Samples, step: np.ndarray, saturated: np.ndarray) -> tuple[Spikes, Noise, Jitter]:
    """Spikes, white noise and jitter; with jitter, spikes are what is beyond its noise.

    Args:
        step: (k,) N, Nm, of lattices. saturated: (N, k) bool.
    """
    least = np.maximum(step, LEAST_SCATTER * samples.stated)
    blind = np.apply_along_axis(np.convolve, 0, saturated, np.ones(2 * REACH + 1), "same") > 0.5
    floor = np.where(blind, np.inf, least)
    for _ in range(2):
        spikes = find_spikes(samples.signal, floor)
        wild = spikes.hit.any(1) & (not spikes.heavy_tailed)
        noise, jitter = _noise(samples.only(~wild & ~saturated.any(1)), step, spikes.heavy_tailed)
        if not jitter.detected:
            break
        late = jitter.std * np.abs(samples.rate)
        floor = np.where(blind, np.inf, np.maximum(np.hypot(noise.std, late), least))
    return spikes, noise, jitter


def _noise(samples: _Samples, step: np.ndarray, heavy_tailed: bool) -> tuple[Noise, Jitter]:
    """White noise (k,) and jitter of the rows that nothing else has spoiled; the stated noise for too few rows."""
    stated = samples.stated
    none = Jitter(0.0, 0.0, 0.0, 0.0, 0.0, stated)
    if len(samples.t) < LEAST_WINDOWS * WINDOW:
        return Noise(stated, np.zeros_like(stated), stated, stated, np.zeros(len(stated), bool)), none
    waves = fast_waves(samples.t, samples.signal)
    noise = measure_noise(waves, samples.signal, heavy_tailed)
    fine = (step < stated) & (noise.std > 0)  # on a coarser lattice the error of rounding grows with the rate
    if fine.sum() < 2:  # nothing lies across the direction of change
        return noise, none
    rate = samples.rate[waves.row].mean(1)
    jitter = measure_jitter(waves.amplitude[..., fine], rate[:, fine], noise.std[fine])
    if jitter.detected:
        std = noise.std.copy()
        std[fine] = jitter.noise_std
        stderr = np.hypot(noise.stderr, JITTER_SHAPE * (noise.std - std))
        low, high = np.where(fine, std, noise.low), np.where(fine, std, noise.high)
        noise = Noise(std, stderr, low, high, noise.coloured & ~fine)
    return noise, jitter


def _own_rate(t: np.ndarray, wrench: np.ndarray) -> np.ndarray:
    """(N, k) N/s, Nm/s: from the mean of the WINDOW samples before to that of the WINDOW samples after each."""
    padded = np.pad(np.column_stack([t, wrench]), ((WINDOW, WINDOW), (0, 0)), mode="edge").cumsum(0)
    total = np.pad(padded, ((1, 0), (0, 0)))
    mean = (total[WINDOW:] - total[:-WINDOW]) / WINDOW
    change = mean[WINDOW + 1 : WINDOW + 1 + len(t)] - mean[: len(t)]
    rate: np.ndarray = change[:, 1:] / change[:, :1]
    return rate
