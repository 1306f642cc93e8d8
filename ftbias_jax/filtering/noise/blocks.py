"""A log in blocks of a few hundredths of a second: slow variation is in their means, fast noise in their scatter."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from ftbias_jax.types import Array

BLOCK_SECONDS = 0.05
"""s; vibration of arms and tools, 10 Hz and above, averages out in a block, changes of the bias do not."""
FEWEST = 10
"""Minimum samples of a block: the scatter of fewer about a line reflects differences of neighbours more than noise."""
LEAST_BLOCKS = 40
"""Minimum number of blocks; a shorter log does not constrain its noise."""
BESIDE = 10
"""Number of blocks before and after the sensor was set to zero whose medians give the jump of the bias."""


class Layout(NamedTuple):
    """How a log is cut into blocks: static under jit, because the shapes depend on it."""

    size: int
    """Samples per block."""
    seconds: float
    """s, length of a block."""


class Blocks(NamedTuple):
    """A log in N blocks of equally many samples; a remainder at the end is not used."""

    t: Float[Array, " N"]
    """s, the middle of each block."""
    mean: Float[Array, "N 6"]
    """N, Nm, mean of the measured bias D theta - W; NaN where nothing was measured."""
    count: Float[Array, "N 6"]
    """Number of measured samples."""
    scatter: Float[Array, "N 6"]
    """N^2, Nm^2: variance of the samples about a straight line through the block."""
    motion: Float[Array, "N n"]
    """(rad/s)^2, mean square of the joints' velocities."""
    stated: Float[Array, "N 6"]
    """N^2, Nm^2, mean variance of a sample as the setup states it, with the joints' share."""
    shaking: Float[Array, "N 6"]
    """N^2, Nm^2: the part of ``stated`` that is vibration stated by the setup; 0 where it states none."""
    number: Int[Array, ""]
    """Number of blocks that belong to the log; those after them are padding."""
    tool: Float[Array, "N 6"] | None = None
    """N, Nm: mean wrench that the tool must cause, 0 where its weight is not in the reading; None = contact throughout
    the log is not tested."""


def layout_of(dt: np.ndarray) -> Layout:
    """The layout for a log's sampling intervals dt (T,) s; padding, where dt is 0, does not count."""
    steps = dt[dt > 0]
    step = float(np.median(steps)) if len(steps) else BLOCK_SECONDS
    size = max(FEWEST, round(BLOCK_SECONDS / step))
    return Layout(size, float(f"{size * step:.2g}"))


def in_blocks(
    layout: Layout,
    t: Float[Array, " T"],
    y: Float[Array, "T 6"],
    velocity: Float[Array, "T n"],
    variance: Float[Array, "T 6"],
    shaking: Float[Array, "T 6"] | None = None,
    length: int | Array | None = None,
    tool: Float[Array, "T 6"] | None = None,
) -> Blocks:
    """Cut a log into blocks: y = D theta - W, NaN = not measured, and the diagonal of R, which includes vibration.

    The first ``length`` samples belong to the log, None = all; ``tool`` is the wrench, N, Nm, that the tool must cause.
    """
    size = layout.size
    room = len(t) // size
    number = jnp.asarray(room if length is None else length // size)
    there = (jnp.arange(room) < number)[:, None]

    def cut(x: Array) -> Array:
        return x[: room * size].reshape(room, size, *x.shape[1:])

    times, values = cut(t), cut(y)
    seen = jnp.isfinite(values) & there[:, None]
    count = seen.sum(1).astype(y.dtype)
    # A straight line is fitted to each block, so that slow changes do not count as scatter.
    offset = times - times.mean(1, keepdims=True)
    clean = jnp.where(seen, values, 0)
    mean = jnp.where(count > 0, clean.sum(1) / jnp.maximum(count, 1), jnp.nan)
    x = jnp.where(seen, offset[:, :, None], 0)
    x = jnp.where(seen, x - (x.sum(1) / jnp.maximum(count, 1))[:, None], 0)
    centred = jnp.where(seen, values - jnp.nan_to_num(mean)[:, None], 0)
    squares = (x**2).sum(1)
    slope = (x * centred).sum(1) / jnp.where(squares > 0, squares, jnp.inf)
    residual = ((centred - slope[:, None] * x) ** 2).sum(1)
    scatter = jnp.where(count > 2, residual / jnp.maximum(count - 2, 1), jnp.nan)
    stated = cut(variance).mean(1)
    shaken = jnp.zeros_like(stated) if shaking is None else cut(shaking).mean(1)
    motion, of_tool = (cut(velocity) ** 2).mean(1), None if tool is None else cut(tool).mean(1)
    return Blocks(times.mean(1), mean, count, scatter, motion, stated, shaken, number, of_tool)


def without_jumps(blocks: Blocks, jumps: Float[Array, " N"]) -> Blocks:
    """The blocks of a whole log with the jumps of the bias removed, which are in the blocks where ``jumps`` is not 0.

    The noise is not affected.
    """
    nothing = jnp.full((BESIDE, 6), jnp.nan, blocks.mean.dtype)
    ahead = jnp.concatenate([blocks.mean, nothing])
    after = nan_median(jnp.stack([ahead[1 + i : 1 + i + len(blocks.mean)] for i in range(BESIDE)]))
    inside = (jnp.arange(len(blocks.mean)) > 0) & (jnp.arange(len(blocks.mean)) < blocks.number - 1)

    def step(carry: tuple[Array, Array], block: tuple[Array, Array, Array]) -> tuple[tuple[Array, Array], Array]:
        (shift, before), (value, following, jumped) = carry, block
        by = jnp.nan_to_num(following - shift - nan_median(before))
        shift, value = jnp.where(jumped, shift + by, shift), jnp.where(jumped, jnp.nan, value - shift)
        return (shift, jnp.concatenate([before[1:], value[None]])), value

    start = (jnp.zeros(6, blocks.mean.dtype), nothing)
    _, mean = jax.lax.scan(step, start, (blocks.mean, after, (jumps != 0) & inside))
    return blocks._replace(mean=mean, count=jnp.where(jnp.isfinite(mean), blocks.count, 0))


def jumps_in(layout: Layout, rezeroed: Float[Array, " T"]) -> Float[Array, " N"]:
    """Number (N,) of samples of each block at which the sensor was set to zero."""
    room = len(rezeroed) // layout.size
    return rezeroed[: room * layout.size].reshape(room, layout.size).sum(1)


def to_samples(layout: Layout, x: Array, length: int) -> Array:
    """Values of blocks (N, ...) repeated for ``length`` samples; those after the last block take its value."""
    return jnp.pad(jnp.repeat(x, layout.size, 0), (0, length - layout.size * len(x)), mode="edge")


def nan_median(x: Float[Array, "N ..."]) -> Float[Array, " ..."]:
    """Median over the first axis without NaN; NaN = there is nothing. Has a third of the code of ``jnp.nanmedian``."""
    ordered, count = jnp.sort(x, 0), (~jnp.isnan(x)).sum(0)
    low, high = (jnp.take_along_axis(ordered, k[None], 0)[0] for k in ((count - 1) // 2, count // 2))
    return jnp.where(count > 0, (low + high) / 2, jnp.nan)
