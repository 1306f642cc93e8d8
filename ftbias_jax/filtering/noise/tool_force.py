"""Whether the force that follows the tool's weight is as large as the setup's tool causes.

A tool that was changed after the setup was written shifts the reading by a share of its weight. The part that varies
with the motion is a slow error to the filter; the constant part looks like a bias, and only the varying part tells how
large it is.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float

from ftbias_jax.filtering.noise.blocks import Blocks, Layout, nan_median
from ftbias_jax.filtering.noise.levels import calmest_level
from ftbias_jax.types import Array

LAG = 2.0
"""s between two blocks that are compared: an arm turns its tool in this time, and the bias hardly moves."""
SEGMENT, FEWEST = 5.0, 6
"""s, and number, of segments whose scatter gives the standard error."""
CHANCE, LEAST = 4.0, 0.02
"""Standard errors, and share of the tool's force, that are not exceeded by a tool that is as stated: sensors are
calibrated to a per cent or two."""
OUTLYING, NORMAL_MEDIAN = 5.0, 0.6745
"""Standard deviations of the changes beyond which something else changed; median size of standard normal numbers."""
CALMER = 0.7
"""Ratio of the spread of the calm part as measured to that without another tool below which the tool is as stated."""
TINY = 1e-12


def error_of_tool_force(blocks: Blocks, free: Bool[Array, " N"], layout: Layout) -> Float[Array, ""]:
    """Relative error of the tool's force as stated, from blocks ``free`` of contact; 0 = none that is significant."""
    if blocks.tool is None:
        return jnp.zeros((), blocks.mean.dtype)
    return _relative_error(blocks.tool[:, :3], blocks.mean[:, :3], free, blocks.t, layout)


def with_tool_as_seen(blocks: Blocks, layout: Layout) -> Blocks:
    """Blocks without the force and the torque that follow the tool beyond what it causes as stated.

    Contact stands out in them whatever the tool is.
    """
    if blocks.tool is None:
        return blocks
    every = jnp.arange(len(blocks.t)) < blocks.number
    force_and_torque = (x.reshape(-1, 2, 3).swapaxes(0, 1) for x in (blocks.tool, blocks.mean))
    factors = jax.vmap(lambda tool, bias: _relative_error(tool, bias, every, blocks.t, layout))(*force_and_torque)
    as_seen = blocks._replace(mean=blocks.mean + jnp.repeat(factors, 3)[None] * blocks.tool)
    # Long contact may follow the tool's force by chance; a tool that is truly another one makes no calm part less calm.
    means = jnp.stack([blocks.mean, as_seen.mean])
    spreads = jax.vmap(lambda mean: calmest_level(blocks._replace(mean=mean), layout).spread[:3])(means)
    stated, seen = jnp.sqrt((spreads**2).sum(1))
    return blocks._replace(mean=jnp.where(stated < CALMER * seen, blocks.mean, as_seen.mean))


def _relative_error(
    tool: Float[Array, "N 3"], bias: Float[Array, "N 3"], free: Bool[Array, " N"], t: Float[Array, " N"], layout: Layout
) -> Float[Array, ""]:
    """Relative error of what the tool causes on three axes; 0 = none that is significant.

    Args:
        tool: N or Nm, means of blocks, as stated.
        bias: N or Nm, what the tool causes as stated minus the reading; NaN = not measured.
        free: blocks that are free of contact.
        t: s, middles of the blocks.
        layout: of the blocks.
    """
    lag = max(1, round(LAG / layout.seconds))
    zero = jnp.zeros((), bias.dtype)
    if len(t) <= lag:
        return zero
    tool, bias = (x[lag:] - x[:-lag] for x in (tool, bias))
    seen = (free[lag:] & free[:-lag])[:, None] & jnp.isfinite(bias)
    # A contact that begins or ends between the two blocks changes the bias by far more than the tool does.
    rest = jnp.abs(bias - _median_slope(tool, bias, seen) * tool)
    scale = nan_median(jnp.where(seen, rest, jnp.nan)) / NORMAL_MEDIAN
    seen &= ~(rest > OUTLYING * scale[None]).any(1, keepdims=True)
    tool, bias = jnp.where(seen, tool, 0), jnp.where(seen, bias, 0)
    power = (tool**2).sum()
    slope = (bias * tool).sum() / jnp.maximum(power, TINY)
    scores = ((bias - slope * tool) * tool).sum(1)
    number = jnp.floor((t[lag:] - t[0]) / SEGMENT).astype(int)
    at = jnp.minimum(number, len(scores) - 1)
    of_segments, counts = (jax.ops.segment_sum(x, at, len(scores)) for x in (scores, seen.any(1).astype(scores.dtype)))
    stderr = jnp.sqrt((of_segments**2).sum()) / jnp.maximum(power, TINY)
    certain = (power > TINY) & ((counts > 0).sum() >= FEWEST) & (jnp.abs(slope) > jnp.maximum(CHANCE * stderr, LEAST))
    return jnp.where(certain, -slope, zero)  # the measured bias is the prediction minus the reading


def _median_slope(x: Float[Array, "N 3"], y: Float[Array, "N 3"], seen: Bool[Array, "N 3"]) -> Float[Array, ""]:
    """Slope of y over x through the origin with the least sum of absolute residuals: a weighted median of y / x."""
    weight = jnp.where(seen, jnp.abs(x), 0).ravel()
    ratio = jnp.where(weight > TINY, y.ravel() / jnp.where(weight > TINY, x.ravel(), 1), 0)
    order = jnp.argsort(ratio)
    upto = jnp.cumsum(weight[order])
    return ratio[order[jnp.searchsorted(upto, upto[-1] / 2)]]
