"""Stateful parts of a simulated sensor, sample by sample, in NumPy or JAX: a low-pass and a delay."""

import numpy as np

from ftbias_jax.model.effects.responses import (
    BUTTERWORTH,
    FIRST,
    SECOND,
    lag_factors,
    oscillator_factors,
    oscillator_step,
)
from ftbias_jax.model.effects.types import EffectValues
from ftbias_jax.types import Array

PASSES_ALL = 1e6
"""Hz, replaces an infinite cutoff, for which the oscillation factors of the second-order filter do not exist."""


def lagging_behind(low_pass: EffectValues, lag: Array, gained: Array, dt: Array) -> tuple[Array, Array]:
    """(N, 6) output of a low-pass minus its input, and the next ``lag``; ``responses.lagged`` has the equations.

    Args:
        low_pass: cutoff, Hz, and order.
        lag: (N, 3, 6) output minus input; for order 2 its oscillating part, that part's rate, and the input's slope.
        gained: (N, 6) change of the input in this step.
        dt: (N, 1) s, duration of this step.
    """
    xp = dt.__array_namespace__()
    w = 2 * np.pi * xp.minimum(low_pass["cutoff"], PASSES_ALL)
    decay, passed = lag_factors(dt, low_pass["cutoff"])
    first, slope, settled = decay * lag[:, 0] - passed * gained, gained / dt, 2 * BUTTERWORTH / w
    kick = lag[:, 2] - slope
    factors = oscillator_factors(dt, w, BUTTERWORTH)
    swing, rate = oscillator_step(lag[:, 0] - settled * kick, lag[:, 1] + kick, w, BUTTERWORTH, *factors)
    is_first = low_pass["order"] < (FIRST + SECOND) / 2
    following = xp.where(is_first, xp.stack([first, lag[:, 1], lag[:, 2]], 1), xp.stack([swing, rate, slope], 1))
    return xp.where(is_first, first, swing - settled * slope), following


def delayed_by(delay: Array, ages: Array, history: Array) -> Array:
    """(N, 6) wrench ``delay`` () s ago, interpolated linearly in samples (N, L, 6) of ages (N, L) s, oldest first.

    A negative delay (wrenches ahead of the joints) counts as zero, because future wrenches are unknown.
    """
    xp = ages.__array_namespace__()
    before = xp.clip((ages >= delay).sum(1) - 1, 0, ages.shape[1] - 2)[:, None]
    older, newer = (xp.take_along_axis(ages, i, 1) for i in (before, before + 1))
    one, other = (xp.take_along_axis(history, i[..., None], 1)[:, 0] for i in (before, before + 1))
    length = older - newer
    share = xp.clip((older - delay) / xp.where(length > 0, length, 1.0), 0.0, 1.0)
    return one + share * (other - one)
