"""One sample of many small Kalman filters together; its adjoint is in kalman_step_back.py.

States have two or three entries, of which the first m are measured with independent noise: a joint (position, velocity,
acceleration) or one axis of the bias (bias, drift). Entries of the small matrices are separate arrays over a batch
(joints, axes, logs), so a step is a few vectorised operations instead of many small matrix products; measured entries
are processed one at a time, which is exact for independent noise.
"""

import math
from functools import partial
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import Array

from ftbias_jax.filtering.process_models import FORGET, Gated, ProcessModel
from ftbias_jax.runtime.compiled_loops import compile_whole
from ftbias_jax.runtime.lanes import Rows, Vector, congruence, from_upper, joseph, plus, symmetric, times, upper

Packed = tuple[Vector, Vector]
"""A state between two samples: the mean, and the upper triangle of the covariance row by row."""


class Tape(NamedTuple):
    """What the reverse pass needs of one step."""

    column: Rows
    """For each measured entry j: column P[:, j] before its correction."""
    weight: Vector
    """Inverse innovation variance 1 / s of each measured entry, 0 where missing."""
    innovation: Vector
    """Innovation of each measured entry given the entries before it, 0 where missing."""
    lost: Array
    """Whether the filter restarted."""
    before: Any = ()
    """State before the step and the upper triangle of its covariance, for a transition that has parameters; filled in
    by the scan, because the forward pass already has it."""
    grown: Array | None = None
    """Relative growth of the bias variance by the gate; None = there is no gate."""


class Step(NamedTuple):
    """One sample of a filter, entries kept apart."""

    mean: Vector
    covariance: Rows
    prediction: Vector
    """Prediction of the measured entries."""
    prediction_variance: Vector
    record: Tape


def filter_step(
    model: ProcessModel,
    density: Any,
    restart: Vector,
    state: tuple[Vector, Rows],
    dt: Array,
    y: Vector,
    variance: Vector,
) -> Step:
    """Predict, restart where too little is known, and correct by one measured entry after the other.

    For a ``Gated`` model the lanes are the axes of one sensor, any of which may close the gate for all.
    """
    k, m = len(state[0]), len(y)
    moved = compile_whole(partial(_move, model))(density, state[0], upper(state[1]), dt)
    x, triangle, lost = compile_whole(_start_again)(restart, state[0], *moved)
    P, grown = from_upper(k, triangle), None
    if isinstance(model, Gated):
        P, passed, grown = compile_whole(partial(screen, model.gate))(x, P, dt, y[0], variance[0])
        y = [passed, *y[1:]]
    prediction, spread = x[:m], [P[j][j] for j in range(m)]
    columns: Rows = []
    weights: Vector = []
    innovations: Vector = []
    for j, (measurement, r) in enumerate(zip(y, variance, strict=True)):
        columns = [*columns, [row[j] for row in P]]
        x, triangle, weight, innovation = compile_whole(partial(_correct, j))(x, upper(P), measurement, r)
        P = from_upper(k, triangle)
        weights, innovations = [*weights, weight], [*innovations, innovation]
    return Step(x, P, prediction, spread, Tape(columns, weights, innovations, lost, grown=grown))


def screen(gate: float, x: Vector, P: Rows, dt: Array, y: Array, r: Array) -> tuple[Rows, Array, Array]:
    """Gate of ``bias_filter.step`` over lanes: covariance, measurement, and the relative growth of P_bb.

    A measurement that is off its prediction is left out, and the bias is forgotten meanwhile.
    """
    off = jnp.abs(y - x[0]) > gate * jnp.sqrt(P[0][0] + r)  # false where nothing was measured
    closed = jnp.broadcast_to(off.any(-1, keepdims=True), off.shape)
    grown = jnp.where(closed, jnp.expm1(2 * dt / FORGET), 0)
    # The first state is the bias plus the correlated noise, if there is any; the third is the noise.
    of_bias = P[0][0] if len(P) == 2 else P[0][0] - 2 * P[0][2] + P[2][2]
    P = [[P[0][0] + grown * of_bias, *P[0][1:]], *P[1:]]
    return P, jnp.where(closed, jnp.nan, y), grown


def nis_of(record: Tape) -> Array:
    """Normalised innovation squared over the measured entries."""
    squares = [v**2 * w for v, w in zip(record.innovation, record.weight, strict=True)]
    return sum(squares[1:], squares[0])


def density_of(record: Tape) -> Array:
    """Product of 1 / (2 pi s) over the measured entries: the squared density of the innovation at zero."""
    factors = [jnp.where(w > 0, w / (2 * math.pi), 1) for w in record.weight]
    return math.prod(factors[1:], start=factors[0])


def predict(
    model: ProcessModel, density: Array, restart: Vector, state: tuple[Vector, Rows], dt: Array
) -> tuple[Vector, Rows, Array]:
    """State before the sample's correction, dt s after the given one, and whether the filter restarted."""
    x, triangle, lost = _start_again(restart, state[0], *_move(model, density, state[0], upper(state[1]), dt))
    return x, from_upper(len(x), triangle), lost


def _move(model: ProcessModel, density: Any, x: Vector, triangle: Vector, dt: Array) -> tuple[Vector, Vector]:
    """x -> A x, P -> A P A^T + Q, with P as its upper triangle."""
    A, Q = model(dt, density)
    return times(A, x), upper(plus(congruence(A, from_upper(len(x), triangle)), Q))


def _start_again(restart: Vector, before: Vector, x: Vector, triangle: Vector) -> tuple[Vector, Vector, Array]:
    """The prediction, or the previous position at rest where that is less certain than a restart; and where it is."""
    k = len(x)
    P = from_upper(k, triangle)
    lost = (P[0][0] > restart[0]) & (P[1][1] > restart[1])
    x = [jnp.where(lost, still, moved) for still, moved in zip(at_rest(before), x, strict=True)]
    return x, upper(symmetric(k, lambda a, b: jnp.where(lost, restart[a] if a == b else 0, P[a][b]))), lost


def _correct(j: int, x: Vector, triangle: Vector, measurement: Array, r: Array) -> tuple[Vector, Vector, Array, Array]:
    """State after the correction by entry j; 1 / s and the innovation, 0 where missing."""
    P = from_upper(len(x), triangle)
    measured = jnp.isfinite(measurement)
    weight = jnp.where(measured, 1 / (P[j][j] + r), 0)
    innovation = jnp.where(measured, measurement - x[j], 0)
    gain = [row[j] * weight for row in P]
    x = [entry + k * innovation for entry, k in zip(x, gain, strict=True)]
    return x, upper(joseph(P, gain, j, r, weight)), weight, innovation


def at_rest(x: Vector) -> Vector:
    """The same position, with no velocity and no acceleration."""
    return [x[0], *(jnp.zeros_like(entry) for entry in x[1:])]
