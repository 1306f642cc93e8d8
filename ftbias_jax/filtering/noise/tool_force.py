"""Whether the force that follows the tool's weight is as large as the setup's tool causes.

A tool that was changed after the setup was written shifts the reading by a share of its weight. The part that varies
with the motion is a slow error to the filter; the constant part looks like a bias, and only the varying part tells how
large it is.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float

from ftbias_jax.filtering.noise.blocks import Blocks, Layout
from ftbias_jax.types import Array

LAG = 2.0
"""s between two blocks that are compared: an arm turns its tool in this time, and the bias hardly moves."""
SEGMENT, FEWEST = 5.0, 6
"""s, and number, of segments whose scatter gives the standard error."""
CHANCE, LEAST = 4.0, 0.02
"""Standard errors, and share of the tool's force, that are not exceeded by a tool that is as stated: sensors are
calibrated to a per cent or two."""
TINY = 1e-12


def error_of_tool_force(blocks: Blocks, free: Bool[Array, " N"], layout: Layout) -> Float[Array, ""]:
    """Relative error of the tool's force as stated, from blocks ``free`` of contact; 0 = none that is significant."""
    lag = max(1, round(LAG / layout.seconds))
    zero = jnp.zeros((), blocks.mean.dtype)
    if blocks.tool is None or len(blocks.t) <= lag:
        return zero
    tool, bias = (x[lag:, :3] - x[:-lag, :3] for x in (blocks.tool, blocks.mean))
    seen = (free[lag:] & free[:-lag])[:, None] & jnp.isfinite(bias)
    tool, bias = jnp.where(seen, tool, 0), jnp.where(seen, bias, 0)
    power = (tool**2).sum()
    slope = (bias * tool).sum() / jnp.maximum(power, TINY)
    scores = ((bias - slope * tool) * tool).sum(1)
    number = jnp.floor((blocks.t[lag:] - blocks.t[0]) / SEGMENT).astype(int)
    at = jnp.minimum(number, len(scores) - 1)
    of_segments, counts = (jax.ops.segment_sum(x, at, len(scores)) for x in (scores, seen.any(1).astype(scores.dtype)))
    stderr = jnp.sqrt((of_segments**2).sum()) / jnp.maximum(power, TINY)
    certain = (power > TINY) & ((counts > 0).sum() >= FEWEST) & (jnp.abs(slope) > jnp.maximum(CHANCE * stderr, LEAST))
    return jnp.where(certain, -slope, zero)  # the measured bias is the prediction minus the reading
