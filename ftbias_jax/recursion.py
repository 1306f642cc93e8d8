"""The Kalman recursion of many small independent filters at once, with a hand-written reverse pass.

It computes what ``gaussian.predict`` and ``gaussian.update`` compute for states of two or three entries, of which the
first m are measured with independent noise: a joint (position, velocity, acceleration) or one axis of the bias
(bias, drift). Entries of the small matrices are separate arrays over a batch (joints, axes, logs), so a step is a few
hundred fused multiplications instead of many small matrix products; measured entries are taken one at a time, which is
exact for independent noise.

The reverse pass is the adjoint of the filter. For the log-likelihood it is the Bryson-Frazier smoother (Bierman 1973):
with L the log-likelihood of the present and future, x_smooth = x_pred + P_pred dL/dx_pred. So gradients cost about as
much as the filter, and smoothing is the same pass.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from ftbias_jax.noise import ProcessModel, Rows
from ftbias_jax.types import Array

Vector = list[Array]


class Inputs(NamedTuple):
    """What the filters see. k = states, m = measured entries (the first m), B = batch of independent filters."""

    dt: Array
    """(T,) s since the previous sample. Data: its gradient is reported as zero."""
    density: Array
    """(B,) strength of the process noise."""
    y: Array
    """(T, m, B) measurements, NaN = not measured."""
    variance: Array
    """(T, m, B) their noise variances."""
    mean: Array
    """(k, B) state before the first sample."""
    covariance: Array
    """(k, k, B)."""
    restart_variance: Array
    """(k, B) a filter that knows its first two entries less well starts again from this, at rest; inf = never."""


class Track(NamedTuple):
    """The filters at every sample, after its correction."""

    mean: Array
    """(T, k, B)."""
    covariance: Array
    """(T, k, k, B)."""
    innovation: Array
    """(T, m, B) measurement minus prediction, 0 where missing."""
    innovation_variance: Array
    """(T, m, B) diagonal of S."""
    nis: Array
    """(T, B) normalised innovation squared over the measured entries."""
    log_likelihood: Array
    """(T, B) increments."""


class Smoothed(NamedTuple):
    """The filters at every sample, given the whole log."""

    mean: Array
    """(T, k, B)."""
    covariance: Array
    """(T, k, k, B)."""


class _Record(NamedTuple):
    """What the reverse pass needs of one step."""

    gain_column: list[Vector]
    """For each measured entry j: column P[:, j] before its correction."""
    weight: Vector
    """1 / s of each measured entry, 0 where missing."""
    innovation: Vector
    """Of each measured entry given those before it, 0 where missing."""
    lost: Array
    """Whether the filter started again."""


@partial(jax.custom_vjp, nondiff_argnums=(0,))
def filter_scan(model: ProcessModel, inputs: Inputs) -> Track:
    """Run the filters over a log; differentiable in all inputs but dt.

    Args:
        model: noise.drift_noise or one of noise.JOINT_MODELS.values(). inputs: see there.
    """
    return _forward(model, inputs)[0]


def smooth_scan(model: ProcessModel, inputs: Inputs) -> Smoothed:
    """States given all measurements, past and future, from one forward and one reverse pass."""
    track, predicted, record = _forward(model, inputs)
    cotangent = jax.tree.map(jnp.zeros_like, track)._replace(log_likelihood=jnp.ones_like(track.log_likelihood))
    _, (slope, curvature) = _backward(model, inputs, record, cotangent, through_restarts=False)
    # dL/dP = (slope slope^T - information) / 2
    information = slope[:, :, None] * slope[:, None] - 2 * curvature
    gained = jnp.einsum("tabn,tbcn,tcdn->tadn", predicted.covariance, information, predicted.covariance)
    mean = predicted.mean + jnp.einsum("tabn,tbn->tan", predicted.covariance, slope)
    return Smoothed(mean, predicted.covariance - gained)


def _forward(model: ProcessModel, inputs: Inputs) -> tuple[Track, Smoothed, _Record]:
    """The filter, its predicted states, and the records of the reverse pass; what a caller drops is not computed."""
    k, m = inputs.mean.shape[0], inputs.y.shape[1]

    def body(carry: tuple[Vector, Rows], sample: tuple[Array, Array, Array]) -> Any:
        (x, P), (dt, y, r) = carry, sample
        A, Q = model(dt, inputs.density)
        at_rest = _at_rest(x)
        x, P = _times(A, x), _add(_congruence(A, P), Q)
        lost = (P[0][0] > inputs.restart_variance[0]) & (P[1][1] > inputs.restart_variance[1])
        x = [jnp.where(lost, rest, moved) for rest, moved in zip(at_rest, x, strict=True)]
        P = [
            [jnp.where(lost, inputs.restart_variance[a] if a == b else 0, P[a][b]) for b in range(k)] for a in range(k)
        ]
        predicted = Smoothed(jnp.stack(x), _stack(P))
        raw = [jnp.where(jnp.isfinite(y[j]), y[j] - x[j], 0) for j in range(m)]
        spread = [P[j][j] + r[j] for j in range(m)]
        nis = log_likelihood = jnp.zeros_like(x[0])
        columns: list[Vector] = []
        weights: Vector = []
        innovations: Vector = []
        for j in range(m):
            measured = jnp.isfinite(y[j])
            weight = jnp.where(measured, 1 / (P[j][j] + r[j]), 0)
            innovation = jnp.where(measured, y[j] - x[j], 0)
            column = [P[a][j] for a in range(k)]
            gain = [entry * weight for entry in column]
            x = [x[a] + gain[a] * innovation for a in range(k)]
            P = _joseph(P, gain, j, jnp.where(measured, r[j], 0), weight)
            square = innovation**2 * weight
            surprise = square + jnp.log(2 * jnp.pi) - jnp.log(jnp.where(measured, weight, 1))
            nis, log_likelihood = nis + square, log_likelihood - jnp.where(measured, surprise, 0) / 2
            columns, weights, innovations = [*columns, column], [*weights, weight], [*innovations, innovation]
        track = Track(jnp.stack(x), _stack(P), jnp.stack(raw), jnp.stack(spread), nis, log_likelihood)
        return (x, P), (track, predicted, _Record(columns, weights, innovations, lost))

    start = (list(inputs.mean), [list(row) for row in inputs.covariance])
    kept: tuple[Track, Smoothed, _Record] = jax.lax.scan(body, start, (inputs.dt, inputs.y, inputs.variance))[1]
    return kept


def _joseph(P: Rows, gain: Vector, j: int, r: Array, weight: Array) -> Rows:
    """(I - K c) P (I - K c)^T + K r K^T for c = e_j; 1 - K_j is taken as r / s, without cancellation."""
    k = len(P)
    rest = jnp.where(weight > 0, r * weight, 1)
    left = [[P[a][b] - gain[a] * P[j][b] if a != j else rest * P[j][b] for b in range(k)] for a in range(k)]

    def entry(a: int, b: int) -> Array:
        kept = left[a][b] - left[a][j] * gain[b] if b != j else left[a][j] * rest
        return kept + gain[a] * r * gain[b]

    return _symmetric(k, entry)


def _filter_fwd(model: ProcessModel, inputs: Inputs) -> tuple[Track, tuple[Inputs, _Record]]:
    track, _, record = _forward(model, inputs)
    return track, (inputs, record)


def _filter_bwd(model: ProcessModel, residual: tuple[Inputs, _Record], cotangent: Track) -> tuple[Inputs]:
    return (_backward(model, *residual, cotangent)[0],)


filter_scan.defvjp(_filter_fwd, _filter_bwd)


def _backward(
    model: ProcessModel, inputs: Inputs, record: _Record, cotangent: Track, through_restarts: bool = True
) -> tuple[Inputs, tuple[Array, Array]]:
    """Adjoint of ``_forward``: cotangents of the inputs, and of the predicted mean (T, k, B) and covariance.

    A restart takes over the last position as a number: derivatives pass through it, but nothing is learned of the past.
    """
    k, m = inputs.mean.shape[0], inputs.y.shape[1]

    def body(carry: Any, sample: tuple[Array, _Record, Track]) -> Any:
        # x, P: the derivatives dL/dmean and dL/dcovariance, first after the sample's correction, then before it.
        (x, P, density_sum, restart_sum), (dt, record, bar) = carry, sample
        x = [x[a] + bar.mean[a] for a in range(k)]
        P = [[P[a][b] + (bar.covariance[a, b] + bar.covariance[b, a]) / 2 for b in range(k)] for a in range(k)]
        y_bar, r_bar = [bar.nis] * m, [bar.nis] * m
        for j in reversed(range(m)):
            p, w, v = record.gain_column[j], record.weight[j], record.innovation[j]
            Pp, px = _times(P, p), _dot(p, x)
            y_bar[j] = w * (px + (2 * bar.nis - bar.log_likelihood) * v)
            r_bar[j] = -(w**2) * (px * v - _dot(p, Pp)) - bar.nis * (v * w) ** 2
            r_bar[j] = r_bar[j] - bar.log_likelihood * (w - (v * w) ** 2) / 2
            p_bar = [w * (x[a] * v - 2 * Pp[a]) for a in range(k)]
            x = _add_at(x, j, -y_bar[j])
            P = _add_column(P, j, p_bar, r_bar[j])
        for j in range(m):  # the innovations that are reported, all taken from the prediction
            seen = jnp.where(record.weight[j] > 0, bar.innovation[j], 0)
            x = _add_at(x, j, -seen)
            P[j] = _add_at(P[j], j, bar.innovation_variance[j])
            y_bar[j], r_bar[j] = y_bar[j] + seen, r_bar[j] + bar.innovation_variance[j]
        predicted = (jnp.stack(x), _stack(P))
        lost = record.lost
        restart_sum = [restart_sum[a] + jnp.where(lost, P[a][a], 0) for a in range(k)]
        P = [[jnp.where(lost, 0, entry) for entry in row] for row in P]
        (A, _), (_, slope) = jax.jvp(partial(model, dt), (inputs.density,), (jnp.ones_like(inputs.density),))
        density_sum = density_sum + sum(_dot(P[a], slope[a]) for a in range(k))
        back = [list(column) for column in zip(*A, strict=True)]
        kept = _at_rest(x) if through_restarts else [jnp.zeros_like(entry) for entry in x]
        x = [jnp.where(lost, rest, moved) for rest, moved in zip(kept, _times(back, x), strict=True)]
        return (x, _congruence(back, P), density_sum, restart_sum), (jnp.stack(y_bar), jnp.stack(r_bar), predicted)

    zero = jnp.zeros_like(inputs.mean[0])
    start = ([zero] * k, [[zero] * k for _ in range(k)], zero, [zero] * k)
    sequence = (inputs.dt, record, cotangent)
    (x, P, density, restart), (y, r, predicted) = jax.lax.scan(body, start, sequence, reverse=True)
    bars = Inputs(jnp.zeros_like(inputs.dt), density, y, r, jnp.stack(x), _stack(P), jnp.stack(restart))
    return bars, predicted


def _at_rest(x: Vector) -> Vector:
    return [x[0], *(jnp.zeros_like(entry) for entry in x[1:])]


def _dot(a: Vector, b: Vector) -> Array:
    return sum(x * y for x, y in zip(a, b, strict=True))


def _times(matrix: Rows, vector: Vector) -> Vector:
    return [_dot(row, vector) for row in matrix]


def _product(left: Rows, right: Rows) -> Rows:
    columns = [list(column) for column in zip(*right, strict=True)]
    return [[_dot(row, column) for column in columns] for row in left]


def _congruence(A: Rows, P: Rows) -> Rows:
    """A P A^T for a symmetric P."""
    AP = _product(A, P)
    return _symmetric(len(P), lambda a, b: _dot(AP[a], A[b]))


def _add(left: Rows, right: Rows) -> Rows:
    return [[x + y for x, y in zip(*rows, strict=True)] for rows in zip(left, right, strict=True)]


def _add_at(vector: Vector, j: int, value: Array) -> Vector:
    return [entry + value if a == j else entry for a, entry in enumerate(vector)]


def _add_column(P: Rows, j: int, column: Vector, corner: Array) -> Rows:
    """P + (v e_j^T + e_j v^T) / 2 + s e_j e_j^T."""
    P = [_add_at(row, j, column[a] / 2) for a, row in enumerate(P)]
    P[j] = _add_at([entry + v / 2 for entry, v in zip(P[j], column, strict=True)], j, corner)
    return P


def _symmetric(k: int, entry: Callable[[int, int], Array]) -> Rows:
    """A symmetric matrix from the entries of its upper triangle: symmetric to the last bit, at half the work."""
    upper = {(a, b): entry(a, b) for a in range(k) for b in range(a, k)}
    return [[upper[min(a, b), max(a, b)] for b in range(k)] for a in range(k)]


def _stack(rows: Rows) -> Array:
    return jnp.stack([jnp.stack(row) for row in rows])
