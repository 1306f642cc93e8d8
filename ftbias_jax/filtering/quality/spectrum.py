"""Lines in the spectrum of the innovations: mains hum, and resonances of the arm or the tool."""

from typing import NamedTuple

import numpy as np

from ftbias_jax.filtering.quality.consistency import chi_square_quantile
from ftbias_jax.types import AXES, Array

SEGMENT_SECONDS = 2.0
"""s; the spectrum is averaged over half-overlapping segments of this length, for a resolution of 0.5 Hz. A log too
short for FEWEST_SEGMENTS has shorter ones, but not below SHORTEST_SEGMENT s."""
FEWEST_SEGMENTS, SHORTEST_SEGMENT = 7, 0.5
BASELINE_HERTZ = 12.0
"""Hz; the noise beside a line is the median of the spectrum within this distance."""
FALSE_ALARMS = 1e-3
"""Probability of a false line in one log of white noise, over all frequencies and axes."""
LEAST_RATIO = 3.0
"""Minimum ratio of a line to the noise beside it, so that a merely sloping spectrum shows no line."""
SHARP_BINS = 3.0
"""Bins at half power of a constant tone seen through a Hann window, with margin; a wider peak is a resonance."""
MAINS = (50.0, 60.0)
"""Hz, frequencies of the mains."""
LEAST_SEEN = 0.5
"""Minimum share of the samples of an axis that must be measured."""
MAX_LISTED = 6
"""Maximum number of peaks that are reported."""


class Line(NamedTuple):
    """A peak in the spectrum of the innovations."""

    frequency: float
    """Hz."""
    width: float
    """Hz at half power."""
    amplitude: Array
    """(6,) N, Nm: of a tone with the power of the peak; 0 on axes that do not show it."""
    sharp: bool
    """Whether the peak is as narrow as a constant tone; otherwise it is a resonance or a tone that moves."""
    mains: float
    """Hz: 50 or 60 if this is a multiple of it, or the alias of one; 0 otherwise."""


def find_lines(t: Array, innovation: Array) -> list[Line]:
    """Peaks of Welch's spectrum (1967) above the noise beside them, strongest first; none for a log of less than 2 s.

    White noise would show a peak as high in one log of a thousand. The innovations are (T, 6) N, Nm, NaN = not used, at
    the stamps t (T,) s; short gaps count as zeros.
    """
    if len(t) < 2:
        return []
    step = float(np.median(np.diff(t)))
    if not step > 0:
        return []
    at, rate = np.round((t - t[0]) / step).astype(int), 1 / step
    seconds = min(SEGMENT_SECONDS, 2 * at[-1] * step / (FEWEST_SEGMENTS + 1))
    size = round(seconds / step)
    if size < 16 or seconds < SHORTEST_SEGMENT or at[-1] > 4 * len(t):
        return []
    grid = np.zeros((at[-1] + 1, 6))
    seen = np.isfinite(innovation)
    grid[at] = np.where(seen, innovation, 0)
    spectrum, count = _welch(grid, size)
    df = rate / size
    # Overlapping Hann segments are worth 9/11 of as many separate ones (Welch 1967).
    dof = 2 * max(1.0, 9 / 11 * count)
    bins = len(spectrum) * 6
    threshold = max(LEAST_RATIO, chi_square_quantile(1 - FALSE_ALARMS / bins, dof) / dof)
    noise = _baseline(spectrum, max(8, round(BASELINE_HERTZ / df)))
    usable = seen.mean(0) > LEAST_SEEN
    ratio = np.where(usable & (noise > 0), spectrum / np.where(noise > 0, noise, 1), 0)
    ratio[:2] = 0  # the lowest bins contain the bias
    edges = np.flatnonzero(np.diff(np.r_[False, ratio.max(1) > threshold, False].astype(int)))
    pieces = [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
    lines = [_line(piece, spectrum - noise, ratio, df, rate, threshold) for piece in pieces]
    rms = np.sqrt(np.nansum(innovation**2, axis=0) / np.maximum(seen.sum(0), 1))
    size_of_axes = np.where(rms > 0, rms, 1)
    return sorted(lines, key=lambda line: -float(np.max(line.amplitude / size_of_axes)))


def format_lines(lines: list[Line]) -> str:
    """Lines of text about the MOST_TOLD strongest peaks, of ``find_lines``."""
    text = []
    for line in lines[:MAX_LISTED]:
        sizes = zip(AXES, line.amplitude, strict=True)
        words = ", ".join(f"{name} {x:.2g} {'N' if name[0] == 'f' else 'Nm'}" for name, x in sizes if x)
        what = "tone" if line.sharp else f"resonance or moving tone, {line.width:.2g} Hz wide"
        cause = f": a multiple of {line.mains:.0f} Hz, as mains hum is, or joint readings at that rate"
        text.append(f"{what} at {line.frequency:.1f} Hz ({words}){cause if line.mains else ''}")
    if len(lines) > MAX_LISTED:
        text.append(f"and {len(lines) - MAX_LISTED} weaker ones")
    return "\n".join(text)


def _welch(x: Array, size: int) -> tuple[Array, int]:
    """One-sided power in each bin (F, 6), N^2, Nm^2, and the number of segments."""
    window = np.hanning(size + 1)[:size, None]
    starts = range(0, len(x) - size + 1, size // 2)
    power = np.zeros((size // 2 + 1, 6))
    for i in starts:
        part = x[i : i + size]
        power += np.abs(np.fft.rfft(window * (part - part.mean(0)), axis=0)) ** 2
    return 2 * power / len(starts) / (size * (window**2).sum()), len(starts)


def _baseline(spectrum: Array, reach: int) -> Array:
    """Median (F, 6) of the spectrum within ``reach`` bins."""
    if len(spectrum) <= reach:
        return np.broadcast_to(np.median(spectrum, axis=0), spectrum.shape)
    padded = np.pad(spectrum, [(reach, reach), (0, 0)], mode="reflect")
    return np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1, axis=0), axis=-1)


def _line(piece: slice, excess: Array, ratio: Array, df: float, rate: float, threshold: float) -> Line:
    """The peak in one run of frequencies above the threshold."""
    shown = ratio[piece].max(0) > threshold
    around = slice(max(piece.start - 2, 0), piece.stop + 2)
    power = np.where(shown, np.maximum(excess[around], 0), 0)
    weight = (power / np.maximum(power.max(0), np.finfo(float).tiny)).sum(1)
    frequency = float(np.arange(len(excess))[around] @ weight / weight.sum()) * df
    bins = float((weight > weight.max() / 2).sum())
    sharp = bins <= SHARP_BINS
    near = df / 2 + 2e-3 * frequency  # the mains' frequency moves by 0.2 %
    mains = next((base for base in MAINS if sharp and _is_harmonic(frequency, base, rate, near)), 0.0)
    return Line(frequency, bins * df, np.sqrt(2 * power.sum(0)), sharp, mains)


def _is_harmonic(frequency: float, base: float, rate: float, near: float) -> bool:
    """Whether one of the first ten multiples of ``base``, or its alias at this sampling rate, is near a frequency."""
    multiples = base * np.arange(1, 11)
    folded = np.abs(multiples - rate * np.round(multiples / rate))
    return bool((np.abs(folded - frequency) < near)[: 10 if rate > 20 * base else 4].any())
