"""The Kalman recursion of many small independent filters over a log, with a hand-written reverse pass.

It computes what ``gaussian.predict`` and ``gaussian.update`` compute for the filters of kalman_step.py, in one loop
that is compiled as a whole (compiled_loops.py). The reverse pass is the adjoint of the filter. For the log-likelihood
it is the Bryson-Frazier smoother (Bierman 1973): with L the log-likelihood of present and future, x_smooth = x_pred +
P_pred dL/dx_pred. So gradients cost about as much as the filter, and smoothing is the same pass.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Float

from ftbias_jax.filtering.fast.kalman_step import Packed, Step, Tape, density_of, filter_step, nis_of
from ftbias_jax.filtering.fast.kalman_step_back import Cotangent, step_back
from ftbias_jax.filtering.process_models import ProcessModel
from ftbias_jax.runtime.compiled_loops import compile_whole, one_at_a_time
from ftbias_jax.runtime.lanes import Vector, from_upper, upper


class Inputs(NamedTuple):
    """Inputs of the filters. k = states, m = measured entries (the first m), B = batch of independent filters."""

    dt: Float[Array, " T"]
    """(T,) s since the previous sample. Data: its gradient is reported as zero."""
    density: Any
    """(B,) strength of the process noise, or a ``BiasStrength``."""
    y: Float[Array, "T m B"]
    """(T, m, B) measurements, NaN = not measured."""
    variance: Float[Array, "T m B"]
    """(T, m, B) their noise variances."""
    mean: Float[Array, "k B"]
    """(k, B) state before the first sample."""
    covariance: Float[Array, "k k B"]
    restart_variance: Float[Array, "k B"]
    """(k, B) a filter whose first two entries are less certain restarts with these variances, at rest; inf = never."""
    drive: Any = None
    """Fields of a ``BiasStrength`` that differ from sample to sample, by name, (T, B) each; None = none."""


class Track(NamedTuple):
    """The filters at every sample, after its correction."""

    mean: Float[Array, "T k B"]
    covariance: Float[Array, "T k k B"]
    innovation: Float[Array, "T m B"]
    """(T, m, B) measurement minus prediction, 0 where missing."""
    innovation_variance: Float[Array, "T m B"]
    """(T, m, B) diagonal of S."""
    nis: Float[Array, "T B"]
    """(T, B) normalised innovation squared over the measured entries."""
    log_likelihood: Float[Array, "T B"]
    """(T, B) increments."""


class Smoothed(NamedTuple):
    """The filters at every sample, given the whole log."""

    mean: Float[Array, "T k B"]
    covariance: Float[Array, "T k k B"]


class States(NamedTuple):
    """States of every sample, entries kept apart."""

    mean: Vector
    """k arrays (T, B)."""
    triangle: Vector
    """k (k + 1) / 2 arrays (T, B): the upper triangle of the covariance, row by row."""

    def stacked(self) -> Smoothed:
        """The states as arrays."""
        return Smoothed(jnp.stack(self.mean, 1), _matrix(self.triangle, len(self.mean), 1))


class Sums(NamedTuple):
    """Log-likelihood and final state of a run."""

    nats: Float[Array, " B"]
    """(B,) weighted sum of the likelihood's increments."""
    mean: Float[Array, "k B"]
    """(k, B) after the last sample."""
    covariance: Float[Array, "k k B"]
    """(k, k, B) after the last sample."""
    states: States | None
    """Filtered states of every sample, if requested."""


class Kept(NamedTuple):
    """What is stored for every sample: writing it costs more than computing it."""

    states: bool
    innovations: bool


class _Run(NamedTuple):
    """The recursion over a log, entries (T, B) kept apart; states are Packed, innovations Vectors, None = not kept."""

    last: Packed
    log_likelihood: Array
    nis: Array
    states: Any
    innovation: Any
    innovation_variance: Any


def filter_scan(model: ProcessModel, inputs: Inputs) -> Track:
    """Run the filters over a log, with a model of ``process_models``; differentiable in all inputs but dt."""
    run = _filtered(model, Kept(states=True, innovations=True), inputs)
    states = States(*run.states).stacked()
    innovations = jnp.stack(run.innovation, 1), jnp.stack(run.innovation_variance, 1)
    return Track(*states, *innovations, run.nis, run.log_likelihood)


def filter_sums(model: ProcessModel, keep: bool, inputs: Inputs, weight: Float[Array, " T"]) -> Sums:
    """Run the filters for weighted sums of the samples' log-likelihood only; with ``keep``, the states too."""
    run = _filtered(model, Kept(states=keep, innovations=False), inputs)
    mean, triangle = run.last
    # An accelerator would otherwise round the factors of a matrix product to fewer digits.
    nats = jnp.matmul(weight, run.log_likelihood, precision="highest")
    states = None if run.states is None else States(*run.states)
    return Sums(nats, jnp.stack(mean), _matrix(triangle, len(mean), 0), states)


def innovations(model: ProcessModel, inputs: Inputs) -> tuple[Float[Array, "T m B"], Float[Array, "T m B"]]:
    """Innovations and their variances (T, m, B) of ``filter_scan``, for derivatives in forward mode.

    Derivatives along many measurements share one recursion of the covariance, which does not depend on them.
    """
    loop = _loop(model, lambda step: (step.prediction, step.prediction_variance))
    prediction, variance = (jnp.stack(x, 1) for x in loop(inputs)[1])
    return jnp.where(jnp.isfinite(inputs.y), inputs.y - prediction, 0), variance + inputs.variance


def _loop(model: ProcessModel, keep: Callable[[Step], Any]) -> Callable[[Inputs], Any]:
    """Loop over the samples: returns the last state and what is kept of every step."""

    @compile_whole
    def loop(inputs: Inputs) -> Any:
        # Split before the loop, because otherwise every step would split them again.
        restart, start = list(inputs.restart_variance), _start(inputs)

        def body(state: Packed, sample: tuple[Array, Vector, Vector, Any]) -> tuple[Packed, Any]:
            dt, y, variance, drive = sample
            before = state[0], from_upper(len(state[0]), state[1])
            step = filter_step(model, driven(inputs.density, drive), restart, before, dt, y, variance)
            return (step.mean, upper(step.covariance)), keep(step)

        samples = inputs.dt, entries(inputs.y), entries(inputs.variance), inputs.drive
        return jax.lax.scan(body, start, samples)

    return loop


@partial(jax.custom_vjp, nondiff_argnums=(0, 1))
def _filtered(model: ProcessModel, kept: Kept, inputs: Inputs) -> _Run:
    return _run(model, kept, False, inputs)[0]


def _run(model: ProcessModel, kept: Kept, for_reverse: bool, inputs: Inputs) -> tuple[_Run, Tape | None]:
    """The recursion, with the record of every step if the reverse pass follows."""

    def keep(step: Step) -> Any:
        record = step.record
        states = (step.mean, upper(step.covariance)) if kept.states else None
        predicted = (step.prediction, step.prediction_variance, record.weight) if kept.innovations else None
        return density_of(record), nis_of(record), states, predicted, record if for_reverse else None

    last, (density, nis, states, predicted, record) = one_at_a_time(_loop(model, keep))(inputs)
    innovation = variance = None
    if predicted is not None:
        # A sample rejected by the gate has an innovation of 0, like a missing one.
        innovation = [
            jnp.where(w > 0, inputs.y[:, j] - y, 0) for j, (y, _, w) in enumerate(zip(*predicted, strict=True))
        ]
        variance = [spread + inputs.variance[:, j] for j, spread in enumerate(predicted[1])]
    # Inside the loop a logarithm would cost as much as the rest of a step; here it is computed for many samples.
    return _Run(last, (jnp.log(density) - nis) / 2, nis, states, innovation, variance), record


Residual = tuple[Array, Any, Any, Tape]
"""dt, density, drive and the record of every step: only what the reverse pass reads, each written and read once."""


def _forward(model: ProcessModel, kept: Kept, inputs: Inputs) -> tuple[_Run, Residual]:
    inputs = jax.tree.map(lambda x: x.value, inputs)
    has_strength = isinstance(inputs.density, tuple)
    run, record = _run(model, Kept(kept.states or has_strength, kept.innovations), True, inputs)
    assert record is not None
    if has_strength:
        before = jax.tree.map(lambda first, x: jnp.concatenate([first[None], x[:-1]]), _start(inputs), run.states)
        record = record._replace(before=jnp.stack([*before[0], *before[1]], 1))
    return run if kept.states else run._replace(states=None), (inputs.dt, inputs.density, inputs.drive, record)


def _backward(model: ProcessModel, kept: Kept, residual: Residual, bar: _Run) -> tuple[Inputs]:
    """Adjoint of the filter: cotangents of the inputs."""
    dt, density, drive, record = residual
    like = record.weight[0]
    k = len(bar.last[0])
    last = _slopes_of_entries(k, bar.last, like[0])
    bars = Cotangent(
        _made(bar.log_likelihood, like),
        _unless_zero(bar.nis, like),
        _unless_zero(bar.states, like) and _slopes_of_entries(k, bar.states, like),
        _unless_zero(bar.innovation, like),
        _unless_zero(bar.innovation_variance, like),
    )

    def loop(density: Any, last: Any, samples: Any) -> Any:
        start = last, jax.tree.map(jnp.zeros_like, density), [jnp.zeros_like(x) for x in last[0]]

        def body(carry: tuple[Packed, Any, Vector], sample: tuple[Array, Any, Tape, Cotangent]) -> Any:
            (state, density_slope, restart), (dt, drive, record, bar) = carry, sample
            slopes = step_back(model, driven(density, drive), dt, record, bar, state)
            restart = [total + slope for total, slope in zip(restart, slopes.restart, strict=True)]
            own, drive_slope = undriven(slopes.density, drive)
            density_slope = jax.tree.map(jnp.add, density_slope, own)
            return (slopes.state, density_slope, restart), (slopes.y, slopes.variance, drive_slope)

        return jax.lax.scan(body, start, samples, reverse=True)

    # XLA aborts on this loop as one marked call under vmap if the state before each sample is an argument.
    compiled = loop if isinstance(density, tuple) else one_at_a_time(compile_whole(loop))
    (state, density_bar, restart), (y, variance, drive_bar) = compiled(density, last, (dt, drive, record, bars))
    prior = jnp.stack(state[0]), _matrix(state[1], k, 0)
    slopes = (density_bar, jnp.stack(y, 1), jnp.stack(variance, 1), *prior, jnp.stack(restart))
    return (Inputs(jnp.zeros_like(dt), *slopes, drive_bar),)


_filtered.defvjp(_forward, _backward, symbolic_zeros=True)


def _made(bar: Any, like: Array) -> Array:
    return jnp.zeros_like(like) if isinstance(bar, SymbolicZero) else bar


def _unless_zero(bars: Any, like: Array) -> Any:
    """Cotangents as arrays, or None if all are zero."""
    leaves = jax.tree.leaves(bars)
    return None if all(isinstance(x, SymbolicZero) for x in leaves) else jax.tree.map(partial(_made, like=like), bars)


def _slopes_of_entries(k: int, bars: Any, like: Array) -> Packed:
    """From derivatives of an upper triangle to those of the symmetric matrix, which has off-diagonal entries twice."""
    mean, triangle = jax.tree.map(partial(_made, like=like), bars)
    places = [(a, b) for a in range(k) for b in range(a, k)]
    return mean, [x if a == b else x / 2 for (a, b), x in zip(places, triangle, strict=True)]


def _start(inputs: Inputs) -> Packed:
    """State before the first sample."""
    return list(inputs.mean), upper([list(row) for row in inputs.covariance])


def driven(density: Any, drive: dict[str, Array] | None) -> Any:
    """The strength of the process at one sample."""
    return density if drive is None else density._replace(**drive)


def undriven(slope: Any, drive: dict[str, Array] | None) -> tuple[Any, dict[str, Array] | None]:
    """Adjoint of ``driven``."""
    alone = slope if drive is None else slope._replace(**dict.fromkeys(drive))
    return alone, drive and {name: getattr(slope, name) for name in drive}


def entries(x: Array) -> Vector:
    """(T, m, B) -> m arrays (T, B)."""
    return [x[:, j] for j in range(x.shape[1])]


def _matrix(triangle: Vector, k: int, axis: int) -> Array:
    """Entries of the upper triangle -> a matrix whose rows and columns are axes after the first ``axis``."""
    return jnp.stack([jnp.stack(row, axis) for row in from_upper(k, triangle)], axis)
