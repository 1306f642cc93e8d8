"""The Kalman recursion of many small independent filters at once, with a hand-written reverse pass.

It computes what ``gaussian.predict`` and ``gaussian.update`` compute for states of two or three entries, of which the
first m are measured with independent noise: a joint (position, velocity, acceleration) or one axis of the bias
(bias, drift). Entries of the small matrices are separate arrays over a batch (joints, axes, logs, blocks of time), so a
step is a few vectorised loops instead of many small matrix products; measured entries are taken one at a time, which is
exact for independent noise.

The reverse pass is the adjoint of the filter. For the log-likelihood it is the Bryson-Frazier smoother (Bierman 1973):
with L the log-likelihood of the present and future, x_smooth = x_pred + P_pred dL/dx_pred. So gradients cost about as
much as the filter, and smoothing is the same pass.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, cast

import jax
import jax.custom_batching
import jax.numpy as jnp
import numpy as np

from ftbias_jax.blocks import count_blocks, scan_blocks
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

MANY = 8
"""So many logs side by side leave nothing to gain by blocks of time."""


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
    predicted_mean: Vector
    predicted_covariance: Rows
    record: _Record


@partial(jax.custom_vjp, nondiff_argnums=(0, 2))
def filter_scan(model: ProcessModel, inputs: Inputs, forgets: bool = False) -> Track:
    """Run the filters over a log; differentiable in all inputs but dt.

    Args:
        model: noise.drift_noise or one of noise.JOINT_MODELS.values(). inputs: see there.
        forgets: whether the filters forget their start within some hundred samples, as joints do; a long log then runs
            in blocks side by side (blocks.py), with the same result.
    """
    return track_of(inputs, _forward(model, inputs, forgets))


def _forward(model: ProcessModel, inputs: Inputs, forgets: bool) -> Step:
    """The filter at every sample, leaves (T, B); what a caller drops is not computed."""
    blocks = count_blocks(len(inputs.dt)) if forgets else 1
    steps: Step = _blocks_unless_mapped(partial(_filter, model), blocks)(inputs)
    return steps


def _filter(model: ProcessModel, blocks: int, inputs: Inputs) -> Step:
    length, _, lanes = inputs.y.shape

    def body(constants: tuple[Array, Vector], state: tuple[Vector, Rows], sums: Any, sample: Any) -> Any:
        step = filter_step(model, *constants, state, *sample)
        return (step.mean, step.covariance), sums, step

    dt, variance = _lengthen((_lanes(inputs.dt, lanes, blocks), _entries(inputs.variance)), blocks)
    xs = (dt, _lengthen(_entries(inputs.y), blocks, jnp.nan), variance)
    start = (list(inputs.mean), [list(row) for row in inputs.covariance])
    constants = (inputs.density, list(inputs.restart_variance))
    kept = scan_blocks(body, constants, start, (), xs, blocks, _same_filter, _cold)[2]
    steps: Step = jax.tree.map(lambda x: x[:length], kept)
    return steps


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
    at_rest = _at_rest(x)
    x, P = times(A, x), plus(congruence(A, P), Q)
    lost = (P[0][0] > restart[0]) & (P[1][1] > restart[1])
    x = [jnp.where(lost, rest, moved) for rest, moved in zip(at_rest, x, strict=True)]
    P = [[jnp.where(lost, restart[a] if a == b else 0, P[a][b]) for b in range(k)] for a in range(k)]
    predicted = (x, P)
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
    return Step(x, P, *predicted, _Record(columns, weights, innovations, lost))


def track_of(inputs: Inputs, steps: Step) -> Track:
    """What is told of a run; likelihoods are sums over entries, so they need not be worked out in the recursion."""
    weight, innovation = steps.record.weight, steps.record.innovation
    m = len(weight)
    seen = [w > 0 for w in weight]
    squares = [v**2 * w for v, w in zip(innovation, weight, strict=True)]
    logs = [
        jnp.log(jnp.where(s, w, 1)) - s * jnp.log(2 * jnp.pi).astype(w.dtype) for s, w in zip(seen, weight, strict=True)
    ]
    x, P = steps.predicted_mean, steps.predicted_covariance
    raw = [jnp.where(s, inputs.y[:, j] - x[j], 0) for j, s in enumerate(seen)]
    spread = [P[j][j] + inputs.variance[:, j] for j in range(m)]
    nis = sum(squares[1:], squares[0])
    log_likelihood = (sum(logs[1:], logs[0]) - nis) / 2
    mean, covariance = jnp.stack(steps.mean, 1), _stack(steps.covariance)
    return Track(mean, covariance, jnp.stack(raw, 1), jnp.stack(spread, 1), nis, log_likelihood)


def _filter_fwd(model: ProcessModel, inputs: Inputs, forgets: bool) -> tuple[Track, tuple[Inputs, _Record]]:
    steps = _forward(model, inputs, forgets)
    return track_of(inputs, steps), (inputs, steps.record)


def _filter_bwd(
    model: ProcessModel, forgets: bool, residual: tuple[Inputs, _Record], cotangent: Track
) -> tuple[Inputs]:
    return (_backward(model, *residual, cotangent, forgets),)


filter_scan.defvjp(_filter_fwd, _filter_bwd)


class _Cotangent(NamedTuple):
    """Of a Track at one sample, entries kept apart."""

    mean: Vector
    covariance: Rows
    innovation: Vector
    innovation_variance: Vector
    nis: Array
    log_likelihood: Array


def _backward(
    model: ProcessModel,
    inputs: Inputs,
    record: _Record,
    cotangent: Track,
    forgets: bool,
) -> Inputs:
    """Adjoint of the filter: cotangents of the inputs."""
    blocks = count_blocks(len(inputs.dt)) if forgets else 1
    slopes: Inputs = _blocks_unless_mapped(partial(_adjoint, model), blocks)(inputs, record, cotangent)
    return slopes


def _adjoint(model: ProcessModel, blocks: int, inputs: Inputs, record: _Record, cotangent: Track) -> Inputs:
    length, _, lanes = inputs.y.shape
    k = len(inputs.mean)

    def body(density: Array, state: tuple[Vector, Rows], sums: tuple[Array, Vector], sample: Any) -> Any:
        dt, record, bar = sample
        # x, P: the derivatives dL/dmean and dL/dcovariance, after the sample's correction, then before it.
        x, P, y_bar, r_bar = _back_to_prediction(record, bar, *state)
        lost = record.lost
        restart_sum = [total + jnp.where(lost, P[a][a], 0) for a, total in enumerate(sums[1])]
        P = [[jnp.where(lost, 0, entry) for entry in row] for row in P]
        (A, _), (_, slope) = jax.jvp(partial(model, dt), (density,), (jnp.ones_like(density),))
        density_sum = sums[0] + sum(dot(P[a], slope[a]) for a in range(k))
        back = transpose(A)
        x = [jnp.where(lost, rest, moved) for rest, moved in zip(_at_rest(x), times(back, x), strict=True)]
        return (x, congruence(back, P)), (density_sum, restart_sum), (y_bar, r_bar)

    symmetric = (cotangent.covariance + jnp.swapaxes(cotangent.covariance, 1, 2)) / 2
    bar = _Cotangent(
        _entries(cotangent.mean),
        [_entries(symmetric[:, a]) for a in range(k)],
        _entries(cotangent.innovation),
        _entries(cotangent.innovation_variance),
        cotangent.nis,
        cotangent.log_likelihood,
    )
    zero = jnp.zeros_like(inputs.mean[0])
    start, sums = ([zero] * k, [[zero] * k for _ in range(k)]), (zero, [zero] * k)
    xs = _lengthen((_lanes(inputs.dt, lanes, blocks), record, bar), blocks)
    (x, P), (density, restart), kept = scan_blocks(
        body, inputs.density, start, sums, xs, blocks, _same_slopes, reverse=True
    )
    y, r = jax.tree.map(lambda x: x[:length], kept)
    slopes = (jnp.stack(y, 1), jnp.stack(r, 1), jnp.stack(x), jnp.stack([jnp.stack(row) for row in P]))
    return Inputs(jnp.zeros_like(inputs.dt), density, *slopes, jnp.stack(restart))


def _blocks_unless_mapped(function: Callable[..., Any], blocks: int) -> Callable[..., Any]:
    """A function of (blocks, ...) with the number chosen: under ``vmap`` over many logs there are lanes enough."""
    if blocks == 1:
        return partial(function, 1)
    in_blocks: Any = jax.custom_batching.custom_vmap(partial(function, blocks))

    def mapped(count: int, is_mapped: Any, *arguments: Any) -> tuple[Any, Any]:
        axes = jax.tree.map(lambda mapped: 0 if mapped else None, is_mapped)
        found = jax.vmap(partial(function, 1 if count >= MANY else blocks), tuple(axes))(*arguments)
        return found, jax.tree.map(lambda _: True, found)

    in_blocks.def_vmap(mapped)
    return cast("Callable[..., Any]", in_blocks)


def _back_to_prediction(record: _Record, bar: _Cotangent, x: Vector, P: Rows) -> tuple[Vector, Rows, Vector, Vector]:
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


def _cold(start: tuple[Vector, Rows], sample: tuple[Array, Vector, Vector]) -> tuple[Vector, Rows]:
    """The start of the log moved to where the first measured entry is."""
    (x, P), y = start, sample[1][0]
    return [jnp.where(jnp.isfinite(y), y, x[0]), *x[1:]], P


def _same_filter(state: tuple[Vector, Rows], other: tuple[Vector, Rows]) -> Array:
    """Equal but for rounding of the positions and what it does to the states: 4e-10 standard deviations in float64."""
    (x, P), (y, S) = state, other
    eps = float(np.finfo(x[0].dtype).eps)
    std = [jnp.sqrt(S[a][a]) for a in range(len(x))]
    slack = eps**0.6 + 16 * eps * jnp.abs(y[0]) / std[0]
    means = [jnp.abs(a - b) <= slack * s + 16 * eps * jnp.abs(b) for a, b, s in zip(x, y, std, strict=True)]
    pairs = [(a, b) for a in range(len(x)) for b in range(a, len(x))]
    spreads = [jnp.abs(P[a][b] - S[a][b]) <= eps**0.6 * std[a] * std[b] for a, b in pairs]
    return jnp.stack([*means, *spreads]).all()


def _same_slopes(state: Any, other: Any) -> Array:
    """Equal but for rounding, measured by the largest slope of the same filter in any block."""

    def same(x: Array, y: Array) -> Array:
        return (jnp.abs(x - y) <= float(np.finfo(x.dtype).eps) ** 0.6 * jnp.abs(y).max(0)[None]).all()

    return jnp.stack(jax.tree.leaves(jax.tree.map(same, state, other))).all()


def _lengthen(xs: Any, blocks: int, value: float = 0.0) -> Any:
    """Leaves (T, B) lengthened to a multiple of the blocks."""

    def lengthen(x: Array) -> Array:
        missing = -x.shape[0] % blocks
        return jnp.concatenate([x, jnp.full((missing, *x.shape[1:]), value, x.dtype)]) if missing else x

    return jax.tree.map(lengthen, xs)


def _entries(x: Array) -> Vector:
    """(T, m, B) -> m arrays (T, B)."""
    return [x[:, j] for j in range(x.shape[1])]


def _lanes(dt: Array, lanes: int, blocks: int) -> Array:
    """dt of every lane, (T, B); (T,) will do in a plain scan."""
    return dt if blocks == 1 else jnp.broadcast_to(dt[:, None], (dt.shape[0], lanes))


def _at_rest(x: Vector) -> Vector:
    return [x[0], *(jnp.zeros_like(entry) for entry in x[1:])]


def _stack(rows: Rows) -> Array:
    """Rows of (T, B) -> (T, k, k, B)."""
    return jnp.stack([jnp.stack(row, 1) for row in rows], 1)
