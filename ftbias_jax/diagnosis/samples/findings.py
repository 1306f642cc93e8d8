"""From measurements on samples to findings: parameters of the catalogue, their errors, the floor of each effect."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ftbias_jax.diagnosis.samples.exact import FlatTop, Gaps, runs
from ftbias_jax.diagnosis.samples.jitter import Jitter
from ftbias_jax.diagnosis.samples.noise import Noise
from ftbias_jax.diagnosis.samples.spikes import Spikes
from ftbias_jax.diagnosis.samples.types import Finding, Numbers, name_channels, surprise
from ftbias_jax.diagnosis.samples.vibration import Growth
from ftbias_jax.diagnosis.thresholds import (
    COARSE,
    FEW_SPIKES,
    HEALTHY_RATE,
    LEAST_HITS,
    LEAST_LOST,
    LEAST_RATE,
    LEAST_SPIKES,
    LOUDER,
    LOUDER_IF_COLOURED,
    QUIETER,
    STATED_WITHIN,
    SURELY_LOUDER,
    SURELY_QUIETER,
    SURPRISING,
)
from ftbias_jax.model.effects.fitting import FLAT_TOPS, GROWTH, JITTER, LATTICE, LEVEL, LOST, SPIKES


def find_dropped(repeated: np.ndarray, gaps: Gaps) -> Finding:
    """Rows that repeat the one before, marked in (N,) bool, and rows that the clock lacks."""
    samples, copies, missing = len(repeated), int(repeated.sum()), int(gaps.lost.sum())
    total, lost = samples + missing, copies + missing
    rate, share = lost / total, copies / lost if lost else 1.0
    nats = surprise(lost, HEALTHY_RATE * total)
    detected = rate >= LEAST_RATE and lost >= LEAST_LOST and nats > SURPRISING
    sentence = f"{copies} of {samples} rows repeat the row before, {missing} are missing from a clock of "
    sentence += f"{1e3 * gaps.period:.3g} ms" if gaps.period else "no steady period"
    sentence += f"; {gaps.pauses} pauses" if gaps.pauses else ""
    # Samples are lost in runs: the runs are independent, their samples are not.
    square = (runs(repeated) ** 2).sum() + (gaps.lost**2).sum()
    scatter = float(np.sqrt(max(square, 1)))
    error = {"rate": scatter / total, "repeated": (1 + scatter * np.sqrt(share * (1 - share))) / max(lost, 1)}
    return Finding(LOST, detected, {"rate": rate, "repeated": share}, error, nats, sentence)


def find_quantisation(step: np.ndarray, stderr: np.ndarray, on_lattice: int, noise_std: np.ndarray) -> Finding:
    """Lattices that are coarse against the stated noise.

    Args:
        step: (6,) N, Nm, 0 = no lattice.
        stderr: (6,).
        on_lattice: samples, of the best channel.
        noise_std: (6,) N, Nm.
    """
    coarse = step >= COARSE * noise_std
    detected = bool(coarse.any())
    nats = surprise(on_lattice, 0.1 * on_lattice) if detected else 0.0  # a tenth would be as near by chance
    sentence = "readings lie on no coarse lattice"
    if detected:
        ratio = (step / noise_std)[coarse].max()
        sentence = f"readings of {name_channels(coarse)} are multiples of a step of up to {ratio:.2g} noise sigmas"
    return Finding(LATTICE, detected, {"step": step.tolist()}, {"step": stderr.tolist()}, nats, sentence)


def find_saturation(tops: Sequence[Sequence[FlatTop]]) -> Finding:
    """Flat tops on either side of six channels; the one with more samples gives the limit."""
    limits, words, nats = [float("inf")] * 6, [], 0.0
    for channel, found in enumerate(tops):
        if found:
            top = max(found, key=lambda top: top.ties)
            limits[channel] = abs(top.value)
            nats = max(nats, top.nats)
            marked = name_channels(np.arange(6) == channel)
            words += [f"{top.ties} samples of {marked} at exactly {top.value:.6g}" for top in found]
    stderr = [1e-6 * limit if np.isfinite(limit) else 0.0 for limit in limits]  # float32
    sentence = "; ".join(words) or "no readings pile up at an extreme value"
    return Finding(FLAT_TOPS, bool(words), {"limits": limits}, {"limits": stderr}, nats, sentence)


def find_outliers(spikes: Spikes) -> Finding:
    """Isolated wild samples, unless they are the tail of the noise; spikes of all six channels."""
    rows = spikes.row
    count, samples = int(rows.sum()), len(rows)
    by_channel = spikes.hit.mean(0)
    rate = float(by_channel[by_channel >= FEW_SPIKES * by_channel.max()].mean())  # of the channels that have spikes
    nats = surprise(count, HEALTHY_RATE * samples)
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
    parameters: Numbers = {"rate": rate, "size": size.tolist()}
    errors: Numbers = {"rate": _share_error(rate, samples), "size": stderr.tolist()}
    return Finding(SPIKES, detected, parameters, errors, nats, sentence)


def judge_noise(noise: Noise, noise_std: np.ndarray, step: np.ndarray, grows: bool, rests: bool) -> Finding:
    """White noise (6 channels) against the stated (6,) N, Nm, after the share of a lattice with steps (6,) N, Nm.

    Hum must not make a channel loud, nor a filter make it quiet: the quietest band must be loud, the loudest quiet.
    Of noise that grows with the motion what it is at rest depends on how exactly it grows,
    and in a log that never rests on nothing else.

    Args:
        noise: of six channels, as it is at rest.
        noise_std: (6,) N, Nm, stated.
        step: (6,) N, Nm, of lattices.
        grows: the noise grows with the motion.
        rests: the log shows what it is at rest.
    """

    def ratio(std: np.ndarray) -> np.ndarray:
        result: np.ndarray = np.sqrt(np.maximum(std**2 - step**2 / 12, 0)) / noise_std
        return result

    scale, low, high = ratio(noise.std), ratio(noise.low), ratio(noise.high)
    stderr = np.maximum(noise.stderr / noise.std * scale, 1e-6)
    # A step of more than two sigmas hides the noise: it passes a level seldom.
    told = (step < 2 * noise_std) & np.isfinite(scale) & (rests or not grows)
    floor = np.where(noise.coloured | grows, LOUDER_IF_COLOURED, LOUDER)
    ceiling = 1 / LOUDER_IF_COLOURED if grows else QUIETER
    louder = told & (low > floor) & (low - 1 - STATED_WITHIN > SURELY_LOUDER * stderr)
    quieter = told & (high < ceiling) & (1 - STATED_WITHIN - high > SURELY_QUIETER * stderr)  # a band: twice the error
    wrong = louder | quieter
    scale, stderr = np.where(told, scale, 1.0), np.where(told, stderr, 0.0)
    dof = 1 / (2 * np.maximum(stderr / scale, 1e-3) ** 2)
    nats = float((dof / 2 * (scale**2 - 1 - np.log(scale**2)))[wrong].sum())
    sentence = "the fastest part of the signal is as large as the stated noise"
    if wrong.any():
        words = " ".join(f"{x:.2f}" for x in scale)
        sentence = f"white noise of {name_channels(wrong)} is not the stated: {words} times as large"
    if noise.coloured.any():
        sentence += f"; {name_channels(noise.coloured)} not white (hum, vibration, ringing or a filter)"
    return Finding(LEVEL, bool(wrong.any()), {"scale": scale.tolist()}, {"scale": stderr.tolist()}, nats, sentence)


def judge_growth(growth: Growth) -> Finding:
    """Noise of six channels that grows with the speeds of the joints."""
    sentence = "the noise does not grow with the speed of the joints, or no more than it may by chance"
    if growth.detected:
        grown = name_channels(np.asarray(growth.variance.any(0)))
        sentence = f"noise of {grown} grows with the motion, up to {growth.visible:.3g} times in the fastest tenth of "
        sentence += "the log; the gain is beyond that of a constant of the best size"
    parameters: Numbers = {"variance": growth.variance.tolist()}
    errors: Numbers = {"variance": growth.stderr.tolist()}
    if growth.speed is not None:
        parameters["speed"], errors["speed"] = growth.speed, growth.speed_stderr
    return Finding(GROWTH, growth.detected, parameters, errors, max(growth.nats, 0.0), sentence, growth.nats_stderr)


def judge_jitter(jitter: Jitter) -> Finding:
    """Scatter along the direction in which the wrench changes."""
    sentence = "the noise does not grow with the rate of the wrench, in its direction"
    if jitter.detected:
        sentence = (
            f"noise along dW/dt grows with it, by {jitter.visible:.2g} sigmas where it is fast; across it does not"
        )
    return Finding(JITTER, jitter.detected, {"std": jitter.std}, {"std": jitter.stderr}, jitter.nats, sentence)


def _share_error(share: float, count: int) -> float:
    """Standard error of a share of a count, of a count of one at least."""
    return float(np.sqrt(max(share * (1 - share), share / count, 1 / count**2) / count))
