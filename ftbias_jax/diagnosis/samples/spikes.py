"""Spikes, isolated samples far from both neighbours, and how they are distinguished from heavy-tailed noise."""

from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.samples.exact import runs
from ftbias_jax.diagnosis.samples.types import Finding, Numbers, log_likelihood_ratio
from ftbias_jax.diagnosis.thresholds import (
    FEW_SPIKES,
    HEALTHY_RATE,
    LEAST_HITS,
    LEAST_RATE,
    LEAST_SPIKES,
    LONGEST_RUN,
    MIDDLE,
    OFF_NEIGHBOURS,
    SPIKE,
    SURPRISING,
    TAILS,
)
from ftbias_jax.model.effects.fitting import SPIKES

NORMAL_MEDIAN = 0.6745
"""Median of the absolute value of a standard normal."""
NORMAL_BEYOND_MIDDLE = 6.3e-5
REACH = 3
BLOCK = 32


class Spikes(NamedTuple):
    """Which samples are spikes."""

    hit: np.ndarray
    """(N, k) bool, channel by channel."""
    off: np.ndarray
    """(N, k) N, Nm, distance of each sample from its neighbourhood."""
    scale: np.ndarray
    """(k,) N, Nm, standard deviation of ``off`` away from spikes."""
    middle: int
    """Isolated samples between MIDDLE and SPIKE, beyond those of normal noise."""
    far: int
    """Isolated samples beyond SPIKE."""

    @property
    def row(self) -> np.ndarray:
        """(N,) rows with a spike in any channel."""
        return np.asarray(self.hit.any(1))

    @property
    def outlier_rows(self) -> np.ndarray:
        """(N,) rows with a spike; none if the large values belong to heavy-tailed noise."""
        return np.zeros(len(self.hit), bool) if self.heavy_tailed else self.row

    @property
    def heavy_tailed(self) -> bool:
        """Whether the large values continue into the others without a gap."""
        return self.middle > max(self.far, TAILS)


def find_spikes(signal: np.ndarray, floor: np.ndarray) -> Spikes:
    """Spikes of a signal (N, k) N, Nm without missing samples.

    ``floor`` (N, k) is the least scatter to assume (lattice, few digits, jitter); inf where a sample is uninformative.
    """
    off = signal - _neighbourhood(signal)
    seen = np.isfinite(floor)
    usual = np.array([_normal_std(x[keep]) for x, keep in zip(off.T, seen.T, strict=True)])
    scale = np.maximum(usual, floor)
    size = np.abs(off) / np.maximum(_local_scale(off), scale)
    isolated = (size > MIDDLE) & (_off_of_neighbours(signal, off) < OFF_NEIGHBOURS * np.abs(off))
    far = isolated & (size > SPIKE)
    by_noise = NORMAL_BEYOND_MIDDLE * off.size
    middle = int((isolated & ~far).sum() - by_noise - 4 * np.sqrt(by_noise))
    hit = far
    if far.any(1).sum() >= LEAST_SPIKES:  # two spikes may be neighbours by chance: not isolated, but in a short run
        beyond = size > SPIKE
        hit = far | (beyond & _in_short_run(beyond.any(1))[:, None])
    return Spikes(hit, off, usual, middle, int(far.sum()))


def _normal_std(x: np.ndarray) -> float:
    """Standard deviation of (N,) from its middle half as if normal; 0 if there is none."""
    return float(np.median(np.abs(x)) / NORMAL_MEDIAN) if len(x) else 0.0


def _off_of_neighbours(signal: np.ndarray, off: np.ndarray) -> np.ndarray:
    """(N, k) distance of the farther neighbour from the neighbourhood of each sample; of the only one at the ends."""
    step = np.diff(signal, axis=0)
    none = np.zeros_like(off[:1])
    of_last = np.concatenate([none, np.abs(off[1:] - step)])
    of_next = np.concatenate([np.abs(off[:-1] + step), none])
    return np.maximum(of_last, of_next)


def _neighbourhood(signal: np.ndarray) -> np.ndarray:
    """(N, k) median of the three samples before and the three after each; straight lines pass unchanged."""
    padded = np.concatenate([_continued(signal)[::-1], signal, _continued(signal[::-1])])
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * REACH + 1, axis=0)
    return np.median(np.delete(windows, REACH, axis=-1), -1)


def _continued(signal: np.ndarray) -> np.ndarray:
    """(REACH, k) samples before the first one, backwards in time: the next ones reflected about its neighbour.

    The level of that neighbour is the median of the first three, so that a spike in the first is not continued.
    """
    after = np.minimum(np.arange(3, 3 + REACH), len(signal) - 1)
    return np.asarray(2 * np.median(signal[:3], 0) - signal[after])


def _local_scale(off: np.ndarray) -> np.ndarray:
    """(N, k) standard deviation in the noisiest of three blocks around each sample, so that vibration is no spike."""
    n, k = off.shape
    blocks = -(-n // BLOCK)
    padded = np.pad(np.abs(off), ((0, blocks * BLOCK - n), (0, 0)), mode="reflect" if n > BLOCK else "edge")
    scale = np.median(padded.reshape(blocks, BLOCK, k), 1) / NORMAL_MEDIAN
    ends = np.pad(scale, ((1, 1), (0, 0)), mode="edge")
    return np.repeat(np.maximum(np.maximum(ends[:-2], ends[1:-1]), ends[2:]), BLOCK, 0)[:n]


def _in_short_run(row: np.ndarray) -> np.ndarray:
    """(N,) marked rows that are in a run of at most LONGEST_RUN."""
    lengths, short = runs(row), row.copy()
    short[row] = np.repeat(lengths <= LONGEST_RUN, lengths)
    return short


def find_outliers(spikes: Spikes) -> Finding:
    """Finding of spikes in six channels, unless they are the tail of the noise."""
    count, samples = int(spikes.row.sum()), len(spikes.hit)
    by_channel = spikes.hit.mean(0)
    rate = float(by_channel[by_channel >= FEW_SPIKES * by_channel.max()].mean())  # of the channels that have spikes
    nats = log_likelihood_ratio(count, HEALTHY_RATE * samples)
    size, stderr = np.zeros(6), np.zeros(6)
    for channel, hit in enumerate(spikes.hit.T):
        if hit.sum() >= LEAST_HITS:
            square = spikes.off[hit, channel] ** 2 - spikes.scale[channel] ** 2
            size[channel] = np.sqrt(max(square.mean(), 0.0))
            error = max(square.std(), 2 * size[channel] * spikes.scale[channel]) / np.sqrt(hit.sum())
            stderr[channel] = error / (2 * size[channel])
    detected = count >= LEAST_SPIKES and count >= LEAST_RATE * samples and nats > SURPRISING and not spikes.heavy_tailed
    sentence = f"{count} of {samples} samples are alone beyond six sigmas of both neighbours"
    if spikes.heavy_tailed:
        sentence += f", but {spikes.middle} more lie between them and the rest: the tail of the noise"
    # Standard error of a proportion with a count of at least one.
    of_rate = float(np.sqrt(max(rate * (1 - rate), rate / samples, 1 / samples**2) / samples))
    errors: Numbers = {"rate": of_rate, "size": stderr.tolist()}
    return Finding(SPIKES, detected, {"rate": rate, "size": size.tolist()}, errors, nats, sentence)
