"""A log in blocks of a few hundredths of a second: what is slow in their means, what is fast in their scatter."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from ftbias_jax.model.motion_noise import effective_speed_squared
from ftbias_jax.types import Array

BLOCK_SECONDS = 0.05
"""Vibration of arms and tools, 10 Hz and above, averages out in a block; what moves the bias does not."""
SPEEDS = (None, *(0.5 * 2 ** (-k / 2) for k in range(13)))
"""rad/s from which vibration may grow with the speed and no longer with its square; None = never."""
FEWEST = 10
"""Samples of a block: the scatter of fewer about a line tells neighbours apart more than it tells noise."""
BESIDE = 10
"""Blocks before and after the sensor was set to zero, whose medians say by how much the bias jumped."""


class Blocks(NamedTuple):
    """A log in N blocks of equally many samples; what is left at the end is not used."""

    t: Array
    """(N,) s, the middle of each block."""
    size: int
    """Samples in a block."""
    mean: Array
    """(N, 6) N, Nm of the measured bias D theta - W; NaN where nothing was measured."""
    count: Array
    """(N, 6) samples that were measured."""
    scatter: Array
    """(N, 6) N^2, Nm^2: variance of the samples about a straight line through the block."""
    motion: Array
    """(N, S, n) (rad/s)^2, mean of the joints' ``effective_speed_squared`` for each of SPEEDS."""
    stated: Array
    """(N, 6) N^2, Nm^2, mean variance of a sample as the setup states it, with the joints' share."""
    shaking: Array
    """(N, 6) N^2, Nm^2: the part of ``stated`` that is vibration which the setup states; 0 where it states none."""


def in_blocks(t: Array, y: Array, velocity: Array, variance: Array, shaking: Array | None = None) -> Blocks:
    """Cut a log into blocks.

    Args:
        t: (T,) s.
        y: (T, 6) N, Nm, D theta - W; NaN = not measured.
        velocity: (T, n) rad/s.
        variance: (T, 6) N^2, Nm^2, diagonal of R.
        shaking: (T, 6) N^2, Nm^2, the part of it that is vibration; None = none.
    """
    step = float(np.median(np.diff(t))) if len(t) > 1 else BLOCK_SECONDS
    size = max(FEWEST, round(BLOCK_SECONDS / step))
    number = len(t) // size

    def cut(x: Array) -> Array:
        return np.asarray(x[: number * size], float).reshape(number, size, *x.shape[1:])

    times, values = cut(t), cut(y)
    seen = np.isfinite(values)
    count = seen.sum(1)
    # A straight line through each block: slow changes are none of its scatter.
    offset = times - times.mean(1, keepdims=True)
    clean = np.where(seen, values, 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = clean.sum(1) / np.where(count > 0, count, np.nan)
        x = np.where(seen, offset[:, :, None], 0)
        x = np.where(seen, x - (x.sum(1) / np.maximum(count, 1))[:, None], 0)
        centred = np.where(seen, values - mean[:, None], 0)
        slope = (x * centred).sum(1) / np.where((x**2).sum(1) > 0, (x**2).sum(1), np.inf)
        scatter = ((centred - slope[:, None] * x) ** 2).sum(1) / np.where(count > 2, count - 2, np.nan)
    speeds = [np.asarray(effective_speed_squared(cut(velocity), most)).mean(1) for most in SPEEDS]
    motion = np.stack(speeds, 1)
    stated = cut(variance).mean(1)
    shaken = np.zeros_like(stated) if shaking is None else cut(shaking).mean(1)
    return Blocks(times.mean(1), size, mean, count, scatter, motion, stated, shaken)


def join_blocks(parts: list[Blocks]) -> Blocks:
    """The blocks of consecutive parts as one."""
    columns = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in Blocks._fields if name != "size"
    }
    return Blocks(size=parts[0].size, **columns)


def without_jumps(blocks: Blocks, times: Sequence[float]) -> Blocks:
    """The blocks as if the sensor had never been set to zero: what its noise is does not change by that.

    Args:
        blocks: of the whole log.
        times: s, when it was; those outside of the log count nothing.
    """
    mean, half = blocks.mean.copy(), (blocks.t[1] - blocks.t[0]) / 2 if len(blocks.t) > 1 else 0.0
    for at in sorted(times):
        first, after = np.searchsorted(blocks.t, [at - half, at + half])
        if not 0 < first < len(mean) or after >= len(mean):
            continue
        mean[first:after] = np.nan  # it has samples of both sides
        with unmeasured_axes():
            sides = [
                np.nanmedian(side, 0) for side in (mean[max(0, first - BESIDE) : first], mean[after : after + BESIDE])
            ]
        mean[after:] -= np.nan_to_num(sides[1] - sides[0])
    return blocks._replace(mean=mean, count=np.where(np.isfinite(mean), blocks.count, 0))


def room_for(count: int) -> int:
    """Blocks of the shortest program that takes so many: 64, 96, 128, 192 and so on."""
    half = 1 << max(0, (count - 1).bit_length() - 1)
    return max(64, half + half // 2 if count <= half + half // 2 else 2 * half)


@contextmanager
def unmeasured_axes() -> Iterator[None]:
    """NumPy without its warnings of medians and means of nothing: an axis may never have been measured."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "All-NaN|Mean of empty", RuntimeWarning)
        yield
