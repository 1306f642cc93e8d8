"""The adjoint of kalman_step.py, for the reverse pass of scan.py."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ftbias_jax.filtering.fast.kalman_step import Packed, Tape, at_rest
from ftbias_jax.filtering.process_models import ProcessModel, as_arrays
from ftbias_jax.runtime.compiled_loops import compile_whole
from ftbias_jax.runtime.lanes import (
    Table,
    Vector,
    add_at,
    congruence,
    dot,
    from_upper,
    product,
    symmetric,
    times,
    total,
    transpose,
    upper,
)


class Cotangent(NamedTuple):
    """Cotangents of what is reported for one sample, entries kept apart; None = zero, which costs nothing.

    Derivatives with respect to a covariance are those with respect to the entries of a symmetric matrix, and are kept
    as its upper triangle.
    """

    log_likelihood: Array
    nis: Array | None = None
    state: Packed | None = None
    innovation: Vector | None = None
    innovation_variance: Vector | None = None


class Slopes(NamedTuple):
    """Derivatives with respect to the inputs of one step, entries kept apart."""

    state: Packed
    density: Any
    restart: Vector
    y: Vector
    variance: Vector


def step_back(model: ProcessModel, density: Any, dt: Array, record: Tape, bar: Cotangent, state: Packed) -> Slopes:
    """Adjoint of ``filter_step``, from the record that it kept of the sample.

    ``bar`` holds the derivatives with respect to what is reported for the sample; ``state`` those with respect to the
    state after it, through later samples.
    """
    # x and the triangle hold dL/dmean and dL/dcovariance, after the sample's correction, then before it.
    if bar.state is not None:
        state = total(state[0], bar.state[0]), total(state[1], bar.state[1])
    (x, triangle), y, variance = _before_corrections(record, bar, *state)
    if record.grown is not None:
        triangle = _before_growth(len(x), triangle, record.grown)
    state, density_slope, restart = compile_whole(partial(_before_prediction, model))(
        density, dt, record.lost, record.before, x, triangle
    )
    return Slopes(state, density_slope, restart, y, variance)


def _before_corrections(record: Tape, bar: Cotangent, x: Vector, triangle: Vector) -> tuple[Packed, Vector, Vector]:
    """Adjoint of the corrections of one sample; derivatives with respect to its measurements and their variances."""
    m, k = len(record.weight), len(x)
    y, variance = [bar.log_likelihood] * m, [bar.log_likelihood] * m
    for j in reversed(range(m)):
        correction = (record.column[j], record.weight[j], record.innovation[j], bar.log_likelihood, bar.nis)
        x, triangle, y[j], variance[j] = compile_whole(partial(_before_correction, j))(*correction, x, triangle)
    # All reported innovations are relative to the prediction, before any correction of the sample.
    if bar.innovation is not None:
        for j, (weight, slope) in enumerate(zip(record.weight, bar.innovation, strict=True)):
            seen = jnp.where(weight > 0, slope, 0)
            x, y[j] = add_at(x, j, -seen), y[j] + seen
    if bar.innovation_variance is not None:
        P = from_upper(k, triangle)
        for j, slope in enumerate(bar.innovation_variance):
            P[j], variance[j] = add_at(P[j], j, slope), variance[j] + slope
        triangle = upper(P)
    return (x, triangle), y, variance


def _before_correction(
    j: int, p: Vector, w: Array, v: Array, log_bar: Array, nis_bar: Array | None, x: Vector, triangle: Vector
) -> tuple[Vector, Vector, Array, Array]:
    """Adjoint of one correction: p = P[:, j], w = 1 / s, v its innovation; x and triangle: the derivatives after it."""
    P = from_upper(len(x), triangle)
    Pp, px = times(P, p), dot(p, x)
    pulled = v * w
    of_square = log_bar if nis_bar is None else log_bar - 2 * nis_bar
    y_bar = w * px - of_square * pulled
    r_bar = w * (w * dot(p, Pp) - pulled * px) - (log_bar * w - of_square * pulled**2) / 2
    p_bar = [pulled * x_a - 2 * w * Pp_a for x_a, Pp_a in zip(x, Pp, strict=True)]

    def entry(a: int, b: int) -> Array:
        if a == b == j:
            return P[j][j] + p_bar[j] + r_bar
        return P[a][b] + p_bar[a + b - j] / 2 if j in (a, b) else P[a][b]

    return add_at(x, j, -y_bar), upper(symmetric(len(x), entry)), y_bar, r_bar


def _before_growth(k: int, triangle: Vector, grown: Array) -> Vector:
    """Adjoint of the gate's growth of the variance of the bias (``kalman_step.screen``)."""
    P = from_upper(k, triangle)
    share = P[0][0] * grown
    P[0][0] = P[0][0] + share
    if k == 3:  # the first state is the bias plus the correlated noise
        P[0][2], P[2][2] = P[0][2] - share, P[2][2] + share
    return upper(P)


def _before_prediction(
    model: ProcessModel, density: Any, dt: Array, lost: Array, before: Any, x: Vector, triangle: Vector
) -> tuple[Packed, Any, Vector]:
    """Adjoint of the prediction; derivatives with respect to the density and to the variances of a restart."""
    k = len(x)
    P = from_upper(k, triangle)
    restart = [jnp.where(lost, P[a][a], 0) for a in range(k)]
    P = symmetric(k, lambda a, b: jnp.where(lost, 0, P[a][b]))
    if isinstance(density, tuple):
        A, density_slope = _by_strength(model, density, dt, lost, before, x, P)
    else:
        A = model(dt, density)[0]
        _, slope = jax.jvp(lambda density: as_arrays(model(dt, density)[1]), (density,), (jnp.ones_like(density),))
        density_slope = sum((dot(P[a], slope[a]) for a in range(1, k)), dot(P[0], slope[0]))
    back = transpose(A)
    x = [jnp.where(lost, rest, moved) for rest, moved in zip(at_rest(x), times(back, x), strict=True)]
    return (x, upper(congruence(back, P))), density_slope, restart


def _by_strength(
    model: ProcessModel, strength: Any, dt: Array, lost: Array, before: Any, x: Vector, P: list[Vector]
) -> tuple[Table, Any]:
    """A, and the derivatives with respect to the strength of a process whose transition depends on it.

    With the derivatives x and P after the prediction: dL/dA = x x_before^T + 2 P A P_before, dL/dQ = P.
    """
    k = len(x)
    x_before, P_before = list(before[:k]), from_upper(k, list(before[k:]))
    (A, Q), back = jax.vjp(lambda strength: tuple(map(as_arrays, model(dt, strength))), strength)
    moved = [jnp.where(lost, 0, entry) for entry in x]
    PAP = product(product(P, A), P_before)
    A_bar = [[a * b + 2 * c for b, c in zip(x_before, row, strict=True)] for a, row in zip(moved, PAP, strict=True)]
    cotangents = jax.tree.map(lambda value, slope: jnp.broadcast_to(slope, value.shape), (A, Q), (A_bar, P))
    return model(dt, strength)[0], back(cotangents)[0]
