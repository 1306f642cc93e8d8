"""The reverse pass of sums.py: the adjoint of kalman_step.py where of a run only sums and states are told.

It is that of kalman_step_back.py without what reports of single samples would add, and the slopes in a covariance are
kept as the upper triangle of a symmetric matrix.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ftbias_jax.filtering.fast.kalman_step import Tape, at_rest
from ftbias_jax.filtering.process_models import ProcessModel, as_arrays
from ftbias_jax.runtime.compiled_loops import compile_whole
from ftbias_jax.runtime.lanes import (
    Vector,
    add_at,
    congruence,
    dot,
    from_upper,
    symmetric,
    times,
    total,
    transpose,
    upper,
)
from ftbias_jax.runtime.side_by_side import for_lanes, many_as_lanes

Packed = tuple[Vector, Vector]
"""Slopes in a state: in the mean, and in the upper triangle of the covariance."""


class Bars(NamedTuple):
    """Slopes in what ``filter_sums`` returns."""

    nats: Array
    """(B,)."""
    last: Packed
    """In the state after the last sample."""
    states: Packed | None
    """In those of all samples, entries (T, B)."""


class Slopes(NamedTuple):
    """Slopes in what ``filter_sums`` is given."""

    prior: Packed
    density: Array
    restart: Vector
    y: Vector
    """m arrays (T, B)."""
    variance: Vector
    """m arrays (T, B)."""


def slopes_of_sums(model: ProcessModel, dt: Array, density: Array, weight: Array, record: Tape, bars: Bars) -> Slopes:
    """From the last sample to the first.

    Args:
        model: of the process, whose transition has no parameters.
        dt: (T,) s.
        density: (B,) strength of the process noise.
        weight: (T,) of every sample's likelihood.
        record: of every step, entries (T, B).
        bars: slopes in the results.
    """
    found: Slopes = many_as_lanes(partial(_loop, model))(density, dt[:, None], weight[:, None], record, bars)
    return found


def _loop(model: ProcessModel, density: Array, dt: Array, weight: Array, record: Tape, bars: Bars) -> Slopes:
    @compile_whole
    def loop(density: Array, dt: Array, weight: Array, record: Tape, bars: Bars) -> Slopes:
        def body(carry: tuple[Packed, Array, Vector], sample: Any) -> Any:
            (state, slope, restart), (dt, weight, record, bar) = carry, sample
            dt, weight = (for_lanes(x, len(slope)) for x in (dt, weight))
            if bar is not None:
                state = total(state[0], bar[0]), total(state[1], bar[1])
            state, y, variance = _before_corrections(record, weight * bars.nats, *state)
            state, more, lost = compile_whole(partial(_before_prediction, model))(density, dt, record.lost, *state)
            return (state, slope + more, total(restart, lost)), (y, variance)

        start = bars.last, jnp.zeros_like(density), [jnp.zeros_like(density)] * len(bars.last[0])
        samples = (dt, weight, record, bars.states)
        (prior, slope, restart), (y, variance) = jax.lax.scan(body, start, samples, reverse=True)
        return Slopes(prior, slope, restart, y, variance)

    whole: Slopes = loop(density, dt, weight, record, bars)
    return whole


def _before_corrections(record: Tape, log_bar: Array, x: Vector, triangle: Vector) -> tuple[Packed, Vector, Vector]:
    """Adjoint of the corrections of one sample; slopes in its measurements and in their variances."""
    m = len(record.weight)
    y, variance = [log_bar] * m, [log_bar] * m
    for j in reversed(range(m)):
        correction = (record.column[j], record.weight[j], record.innovation[j], log_bar)
        x, triangle, y[j], variance[j] = compile_whole(partial(_before_correction, j))(*correction, x, triangle)
    return (x, triangle), y, variance


def _before_correction(
    j: int, p: Vector, w: Array, v: Array, log_bar: Array, x: Vector, triangle: Vector
) -> tuple[Vector, Vector, Array, Array]:
    """``kalman_step_back._before_correction`` for a triangle."""
    k = len(x)
    P = from_upper(k, triangle)
    Pp, px = times(P, p), dot(p, x)
    pulled = v * w
    y_bar = w * px - log_bar * pulled
    r_bar = w * (w * dot(p, Pp) - pulled * px) - log_bar * (w - pulled**2) / 2
    p_bar = [pulled * x_a - 2 * w * Pp_a for x_a, Pp_a in zip(x, Pp, strict=True)]

    def entry(a: int, b: int) -> Array:
        if a == b == j:
            return P[j][j] + p_bar[j] + r_bar
        return P[a][b] + p_bar[a + b - j] / 2 if j in (a, b) else P[a][b]

    return add_at(x, j, -y_bar), upper(symmetric(k, entry)), y_bar, r_bar


def _before_prediction(
    model: ProcessModel, density: Array, dt: Array, lost: Array, x: Vector, triangle: Vector
) -> tuple[Packed, Array, Vector]:
    """Adjoint of the prediction; slopes in the density and in what a filter starts again from."""
    k = len(x)
    P = from_upper(k, triangle)
    restart = [jnp.where(lost, P[a][a], 0) for a in range(k)]
    P = symmetric(k, lambda a, b: jnp.where(lost, 0, P[a][b]))
    A = model(dt, density)[0]
    _, slope = jax.jvp(lambda density: as_arrays(model(dt, density)[1]), (density,), (jnp.ones_like(density),))
    density_slope = sum((dot(P[a], slope[a]) for a in range(1, k)), dot(P[0], slope[0]))
    back = transpose(A)
    x = [jnp.where(lost, rest, moved) for rest, moved in zip(at_rest(x), times(back, x), strict=True)]
    return (x, upper(congruence(back, P))), density_slope, restart
