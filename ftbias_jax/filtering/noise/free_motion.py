"""Whether a log has any free motion: where it has none, its bias is indistinguishable from contact forces.

A hand that guides the robot, or a tool that slides on a surface, never pushes constantly for a second. Errors of the
tool model follow the motion instead, and are small beside the tool's weight: 2 % of it and less in the calmest two
seconds of recorded logs, where pushed ones have 6 % and more. A push that is constant from the first to the last sample
looks like a bias and cannot be detected.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float

from ftbias_jax.filtering.noise.blocks import Blocks, Layout, nan_median
from ftbias_jax.filtering.noise.levels import white_std
from ftbias_jax.model.params import BiasNoise
from ftbias_jax.types import Array

WINDOW = 1.0
"""s in which a push is never constant; windows overlap by half."""
FEWEST_WINDOWS = 6
OF_NOISE = 4.0
"""Standard deviations of a block's mean that a steady reading does not exceed."""
OF_TOOL = 0.03
"""Share of the tool's force that the variation of a steady reading by errors of its model does not exceed."""
OF_MOTION = 0.7
"""N: the corresponding limit where the controller subtracts the weight, so that there is no tool force to compare."""
CALM = 0.06
"""Share of the windows, and at least one window, that must be calm in a log with free motion."""
NOTHING, TINY = 1e-3, 1e-30
"""Relative size of a column below which it depends linearly on the others, and a size for columns that are zero."""
MOST_OFF = 4.0
"""Standard deviations of its prior by which contact may have displaced a bias; beyond, it is a sensor offset."""


def hidden_bias(blocks: Blocks, tool: Float[Array, "N 6"], layout: Layout, stated: BiasNoise) -> Float[Array, " 6"]:
    """Possible error (6,) N, Nm of the bias because the tool is touched throughout; zeros for a log with free motion.

    The bias may be anything between what the setup expects and the median of the log; each axis gets the worst of force
    or torque, because a push may hide the bias of one axis by chance.

    ``tool`` is N, Nm, mean of the wrench in each block that it must cause; zeros where the controller subtracts its
    weight, which leaves unknown how large model errors may be.
    """
    seen, y, middle = _about_the_middle(blocks)
    scatter = jnp.sqrt((y**2).sum(0) / jnp.maximum(seen.sum(), 1))
    off = jnp.minimum(jnp.abs(middle - stated.prior_mean[:6]), MOST_OFF * stated.prior_std[:6])
    worst = jnp.repeat(jnp.nan_to_num(off).reshape(2, 3).max(1), 3)
    return jnp.where(is_touched_all_along(blocks, tool, layout) & jnp.isfinite(middle), jnp.hypot(scatter, worst), 0.0)


def is_touched_all_along(blocks: Blocks, tool: Float[Array, "N 6"], layout: Layout) -> Bool[Array, ""]:
    """Whether hardly a second of a log is calm; arguments as for ``hidden_bias``."""
    seen, y, _ = _about_the_middle(blocks)
    # In a calm interval the reading itself may be steady, but not its residual once pushes elsewhere affect the fit.
    read, left = (
        _loud_windows(blocks, tool, layout, x, seen) for x in (y, _residual_after_regression(blocks.t, tool, y, seen))
    )
    loud, valid = read[0] & left[0], read[1]
    calm = (valid & ~loud).sum()
    return (valid.sum() >= FEWEST_WINDOWS) & (calm < jnp.maximum(1, CALM * valid.sum()))


def _about_the_middle(blocks: Blocks) -> tuple[Array, Array, Array]:
    """Which blocks (N,) are measured, the measured bias (N, 6) minus its median, 0 where it is not, and the median."""
    there = jnp.arange(len(blocks.t)) < blocks.number
    middle = nan_median(jnp.where(there[:, None], blocks.mean, jnp.nan))
    seen = there & jnp.isfinite(blocks.mean).any(1)
    return seen, jnp.where(seen[:, None] & jnp.isfinite(blocks.mean), blocks.mean - middle[None], 0), middle


def _residual_after_regression(
    t: Float[Array, " N"], tool: Float[Array, "N 6"], y: Float[Array, "N 6"], seen: Array
) -> Float[Array, "N 6"]:
    """Residual (N, 6) of y regressed on the tool's wrench and its rate: no wrong tool, gain or lag explains it."""
    rate, passed = jnp.diff(tool, axis=0, append=tool[-1:]), (t - t[0])[:, None]
    X = jnp.where(seen[:, None], jnp.concatenate([jnp.ones_like(passed), passed, tool, rate], 1), 0)
    X = X / jnp.maximum(jnp.sqrt((X**2).sum(0)), TINY)[None]

    def project(left: tuple[Array, Array], k: Array) -> tuple[tuple[Array, Array], None]:
        X, y = left
        size = jnp.sqrt((X[:, k] ** 2).sum())
        unit = jnp.where(size > NOTHING, X[:, k] / jnp.maximum(size, NOTHING), 0)
        return (X - unit[:, None] * (unit @ X)[None], y - unit[:, None] * (unit @ y)[None]), None

    # Gram-Schmidt is used because a program that calls LAPACK cannot be kept between processes.
    (_, left), _ = jax.lax.scan(project, (X, y), jnp.arange(X.shape[1]))
    return left


def _loud_windows(
    blocks: Blocks, tool: Float[Array, "N 6"], layout: Layout, left: Float[Array, "N 6"], seen: Array
) -> tuple[Array, Array]:
    """Windows (W,) in which the force is not steady, and those that have enough blocks to decide."""
    size = max(4, round(WINDOW / layout.seconds))
    number = len(left) // size + 1
    room, half = (number + 1) * size, size // 2

    def cut(x: Array) -> Array:
        padded = jnp.pad(x, [(0, room - len(x)), *[(0, 0)] * (x.ndim - 1)])
        rows = (padded[begin : begin + number * size] for begin in (0, half))
        return jnp.concatenate([x.reshape(number, size, *x.shape[1:]) for x in rows])

    here = cut(seen.astype(left.dtype))[:, :, None]
    count = jnp.maximum(here.sum(1), 1)
    force = cut(left[:, :3])
    varied = ((force - ((force * here).sum(1) / count)[:, None]) ** 2 * here).sum(1) / count
    noise = (cut(jnp.where(seen[:, None], white_std(blocks)[:, :3] ** 2, 0)) * here).sum(1) / count
    weight = jnp.where(seen, (tool[:, :3] ** 2).sum(1), 0).sum() / jnp.maximum(seen.sum(), 1)
    of_model = jnp.where(weight > 0, OF_TOOL**2 * weight, OF_MOTION**2)
    loud = varied.sum(1) > jnp.maximum(OF_NOISE**2 * noise.sum(1), of_model)
    return loud, count[:, 0] > size / 2
