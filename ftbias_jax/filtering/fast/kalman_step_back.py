"""The adjoint of kalman_step.py, for the reverse pass of scan.py."""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ftbias_jax.filtering.fast.gate import before_growth
from ftbias_jax.filtering.fast.kalman_step import Tape, at_rest
from ftbias_jax.filtering.process_models import ProcessModel, as_arrays
from ftbias_jax.runtime.compiled_loops import compile_whole
from ftbias_jax.runtime.lanes import (
    Rows,
    Table,
    Vector,
    add_at,
    add_column,
    congruence,
    dot,
    from_upper,
    plus,
    product,
    times,
    total,
    transpose,
)


class Cotangent(NamedTuple):
    """Of a Track at one sample, entries kept apart."""

    mean: Vector
    covariance: Rows
    innovation: Vector
    innovation_variance: Vector
    nis: Array
    log_likelihood: Array


class Slopes(NamedTuple):
    """Derivatives with respect to the inputs of one step, entries kept apart."""

    state: tuple[Vector, Rows]
    density: Any
    restart: Vector
    y: Vector
    variance: Vector


def step_back(
    model: ProcessModel, density: Any, dt: Array, record: Tape, bar: Cotangent, state: tuple[Vector, Rows]
) -> Slopes:
    """Adjoint of ``filter_step``.

    Args:
        model: as for ``filter_step``.
        density: as for ``filter_step``.
        dt: () s, as for ``filter_step``.
        record: what ``filter_step`` kept of the sample.
        bar: derivatives with respect to what is reported of the sample.
        state: derivatives with respect to the state after the sample, through later samples.
    """
    # x, P: the derivatives dL/dmean and dL/dcovariance, after the sample's correction, then before it.
    x, P, y, variance = _before_corrections(record, bar, *state)
    if record.grown is not None:
        P = before_growth(P, record.grown)
    return compile_whole(partial(_before_prediction, model))(density, dt, record.lost, record.before, x, P, y, variance)


def _before_corrections(record: Tape, bar: Cotangent, x: Vector, P: Rows) -> tuple[Vector, Rows, Vector, Vector]:
    """Adjoint of the corrections of one sample: of the predicted mean and covariance, of y and of its variance."""
    m = len(record.weight)
    x, P = total(x, bar.mean), plus(P, bar.covariance)
    y_bar, r_bar = [bar.nis] * m, [bar.nis] * m
    for j in reversed(range(m)):
        correction = (record.column[j], record.weight[j], record.innovation[j])
        x, P, y_bar[j], r_bar[j] = compile_whole(partial(_before_correction, j))(
            *correction, bar.nis, bar.log_likelihood, x, P
        )
    for j in range(m):  # the innovations that are reported, all taken from the prediction
        seen = jnp.where(record.weight[j] > 0, bar.innovation[j], 0)
        x = add_at(x, j, -seen)
        P[j] = add_at(P[j], j, bar.innovation_variance[j])
        y_bar[j], r_bar[j] = y_bar[j] + seen, r_bar[j] + bar.innovation_variance[j]
    return x, P, y_bar, r_bar


def _before_correction(
    j: int, p: Vector, w: Array, v: Array, nis_bar: Array, log_bar: Array, x: Vector, P: Rows
) -> tuple[Vector, Rows, Array, Array]:
    """Adjoint of one correction: p = P[:, j], w = 1 / s and v its innovation, x and P the slopes after it."""
    Pp, px = times(P, p), dot(p, x)
    y_bar = w * (px + (2 * nis_bar - log_bar) * v)
    r_bar = -(w**2) * (px * v - dot(p, Pp)) - nis_bar * (v * w) ** 2 - log_bar * (w - (v * w) ** 2) / 2
    p_bar = [w * (x_a * v - 2 * Pp_a) for x_a, Pp_a in zip(x, Pp, strict=True)]
    return add_at(x, j, -y_bar), add_column(P, j, p_bar, r_bar), y_bar, r_bar


def _before_prediction(
    model: ProcessModel,
    density: Any,
    dt: Array,
    lost: Array,
    before: Any,
    x: Vector,
    P: Rows,
    y: Vector,
    variance: Vector,
) -> Slopes:
    k = len(x)
    restart = [jnp.where(lost, P[a][a], 0) for a in range(k)]
    P = [[jnp.where(lost, 0, entry) for entry in row] for row in P]
    if isinstance(density, tuple):
        A, density_slope = _by_strength(model, density, dt, lost, before, x, P)
    else:
        A = model(dt, density)[0]
        _, slope = jax.jvp(lambda density: as_arrays(model(dt, density)[1]), (density,), (jnp.ones_like(density),))
        density_slope = sum((dot(P[a], slope[a]) for a in range(1, k)), dot(P[0], slope[0]))
    back = transpose(A)
    x = [jnp.where(lost, rest, moved) for rest, moved in zip(at_rest(x), times(back, x), strict=True)]
    return Slopes((x, congruence(back, P)), density_slope, restart, y, variance)


def _by_strength(
    model: ProcessModel, strength: Any, dt: Array, lost: Array, before: Any, x: Vector, P: Rows
) -> tuple[Table, Any]:
    """A, and the derivatives with respect to the strength of a process whose transition depends on it.

    With the slopes x and P after the prediction: dL/dA = x x_before^T + 2 P A P_before, dL/dQ = P.
    """
    k = len(x)
    x_before, P_before = list(before[:k]), from_upper(k, list(before[k:]))
    (A, Q), back = jax.vjp(lambda strength: tuple(map(as_arrays, model(dt, strength))), strength)
    moved = [jnp.where(lost, 0, entry) for entry in x]
    PAP = product(product(P, A), P_before)
    A_bar = [[a * b + 2 * c for b, c in zip(x_before, row, strict=True)] for a, row in zip(moved, PAP, strict=True)]
    cotangents = jax.tree.map(lambda value, slope: jnp.broadcast_to(slope, value.shape), (A, Q), (A_bar, P))
    return model(dt, strength)[0], back(cotangents)[0]
