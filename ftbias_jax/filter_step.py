"""One sample of many small Kalman filters at once, forward, and its adjoint for the reverse pass.

States have two or three entries, of which the first m are measured with independent noise: a joint (position, velocity,
acceleration) or one axis of the bias (bias, drift). Entries of the small matrices are separate arrays over a batch
(joints, axes, logs), so a step is a few vectorised operations instead of many small matrix products; measured entries
are taken one at a time, which is exact for independent noise.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp

from ftbias_jax.noise import ProcessModel
from ftbias_jax.small_matrices import (
    Rows,
    Vector,
    add_at,
    add_column,
    congruence,
    dot,
    joseph,
    plus,
    times,
    transpose,
)
from ftbias_jax.types import Array


class Record(NamedTuple):
    """What the reverse pass needs of one step."""

    column: Rows
    """For each measured entry j: column P[:, j] before its correction."""
    weight: Vector
    """1 / s of each measured entry, 0 where missing."""
    innovation: Vector
    """Of each measured entry given those before it, 0 where missing."""
    lost: Array
    """Whether the filter started again."""


class Step(NamedTuple):
    """One sample of a filter, entries kept apart."""

    mean: Vector
    covariance: Rows
    prediction: Vector
    """Of the measured entries."""
    prediction_variance: Vector
    record: Record


def filter_step(
    model: ProcessModel,
    density: Array,
    restart: Vector,
    state: tuple[Vector, Rows],
    dt: Array,
    y: Vector,
    variance: Vector,
) -> Step:
    """Predict, start again where too little is known, correct by one measured entry after the other."""
    x, P = state
    k = len(x)
    A, Q = model(dt, density)
    rest = _at_rest(x)
    x, P = times(A, x), plus(congruence(A, P), Q)
    lost = (P[0][0] > restart[0]) & (P[1][1] > restart[1])
    x = [jnp.where(lost, still, moved) for still, moved in zip(rest, x, strict=True)]
    P = [[jnp.where(lost, restart[a] if a == b else 0, P[a][b]) for b in range(k)] for a in range(k)]
    m = len(y)
    prediction, spread = x[:m], [P[j][j] for j in range(m)]
    columns: Rows = []
    weights: Vector = []
    innovations: Vector = []
    for j, (measurement, r) in enumerate(zip(y, variance, strict=True)):
        measured = jnp.isfinite(measurement)
        weight = jnp.where(measured, 1 / (P[j][j] + r), 0)
        innovation = jnp.where(measured, measurement - x[j], 0)
        column = [P[a][j] for a in range(k)]
        gain = [entry * weight for entry in column]
        x = [x[a] + gain[a] * innovation for a in range(k)]
        P = joseph(P, gain, j, jnp.where(measured, r, 0), weight)
        columns, weights, innovations = [*columns, column], [*weights, weight], [*innovations, innovation]
    return Step(x, P, prediction, spread, Record(columns, weights, innovations, lost))


class Cotangent(NamedTuple):
    """Of a Track at one sample, entries kept apart."""

    mean: Vector
    covariance: Rows
    innovation: Vector
    innovation_variance: Vector
    nis: Array
    log_likelihood: Array


class Slopes(NamedTuple):
    """Derivatives by what one step was given, entries kept apart."""

    state: tuple[Vector, Rows]
    density: Array
    restart: Vector
    y: Vector
    variance: Vector


def step_back(
    model: ProcessModel, density: Array, dt: Array, record: Record, bar: Cotangent, state: tuple[Vector, Rows]
) -> Slopes:
    """Adjoint of ``filter_step``.

    Args:
        model, density, dt: as there. record: what it kept. bar: derivatives by what is told of the sample.
        state: derivatives by the state after the sample, by way of later samples.
    """
    # x, P: the derivatives dL/dmean and dL/dcovariance, after the sample's correction, then before it.
    x, P, y, variance = _before_corrections(record, bar, *state)
    k, lost = len(x), record.lost
    restart = [jnp.where(lost, P[a][a], 0) for a in range(k)]
    P = [[jnp.where(lost, 0, entry) for entry in row] for row in P]
    (A, _), (_, slope) = jax.jvp(partial(model, dt), (density,), (jnp.ones_like(density),))
    back = transpose(A)
    density_slope = sum((dot(P[a], slope[a]) for a in range(1, k)), dot(P[0], slope[0]))
    x = [jnp.where(lost, rest, moved) for rest, moved in zip(_at_rest(x), times(back, x), strict=True)]
    return Slopes((x, congruence(back, P)), density_slope, restart, y, variance)


def _before_corrections(record: Record, bar: Cotangent, x: Vector, P: Rows) -> tuple[Vector, Rows, Vector, Vector]:
    """Adjoint of the corrections of one sample: of the predicted mean and covariance, of y and of its variance."""
    k, m = len(x), len(record.weight)
    x, P = [a + b for a, b in zip(x, bar.mean, strict=True)], plus(P, bar.covariance)
    y_bar, r_bar = [bar.nis] * m, [bar.nis] * m
    for j in reversed(range(m)):
        p, w, v = record.column[j], record.weight[j], record.innovation[j]
        Pp, px = times(P, p), dot(p, x)
        y_bar[j] = w * (px + (2 * bar.nis - bar.log_likelihood) * v)
        r_bar[j] = -(w**2) * (px * v - dot(p, Pp)) - bar.nis * (v * w) ** 2
        r_bar[j] = r_bar[j] - bar.log_likelihood * (w - (v * w) ** 2) / 2
        p_bar = [w * (x[a] * v - 2 * Pp[a]) for a in range(k)]
        x = add_at(x, j, -y_bar[j])
        P = add_column(P, j, p_bar, r_bar[j])
    for j in range(m):  # the innovations that are reported, all taken from the prediction
        seen = jnp.where(record.weight[j] > 0, bar.innovation[j], 0)
        x = add_at(x, j, -seen)
        P[j] = add_at(P[j], j, bar.innovation_variance[j])
        y_bar[j], r_bar[j] = y_bar[j] + seen, r_bar[j] + bar.innovation_variance[j]
    return x, P, y_bar, r_bar


def _at_rest(x: Vector) -> Vector:
    return [x[0], *(jnp.zeros_like(entry) for entry in x[1:])]
