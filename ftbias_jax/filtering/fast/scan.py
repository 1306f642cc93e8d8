"""The Kalman recursion of many small independent filters over a log, with a hand-written reverse pass.

It computes what ``gaussian.predict`` and ``gaussian.update`` compute for the filters of kalman_step.py, in one loop
that is compiled as a whole (compiled_loops.py). The reverse pass is the adjoint of the filter. For the log-likelihood
it is the Bryson-Frazier smoother (Bierman 1973): with L the log-likelihood of the present and future,
x_smooth = x_pred + P_pred dL/dx_pred. So gradients cost about as much as the filter, and smoothing is the same pass.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ftbias_jax.filtering.fast.kalman_step import Step, Tape, filter_step, nats_of
from ftbias_jax.filtering.fast.kalman_step_back import Cotangent, step_back
from ftbias_jax.filtering.process_models import ProcessModel
from ftbias_jax.runtime.compiled_loops import compile_whole, one_at_a_time
from ftbias_jax.runtime.lanes import Rows, Vector, from_upper, upper

if TYPE_CHECKING:
    from jaxtyping import Float


class Inputs(NamedTuple):
    """What the filters see. k = states, m = measured entries (the first m), B = batch of independent filters."""

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
    """(k, k, B)."""
    restart_variance: Float[Array, "k B"]
    """(k, B) a filter that knows its first two entries less well starts again from this, at rest; inf = never."""
    drive: Any = None
    """Fields of a ``BiasStrength`` that differ from sample to sample, by name, (T, B) each; None = none does."""


class Track(NamedTuple):
    """The filters at every sample, after its correction."""

    mean: Float[Array, "T k B"]
    """(T, k, B)."""
    covariance: Float[Array, "T k k B"]
    """(T, k, k, B)."""
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
    """(T, k, B)."""
    covariance: Float[Array, "T k k B"]
    """(T, k, k, B)."""


@partial(jax.custom_vjp, nondiff_argnums=(0,))
def filter_scan(model: ProcessModel, inputs: Inputs) -> Track:
    """Run the filters over a log; differentiable in all inputs but dt.

    Args:
        model: process_models.drift_noise or one of process_models.JOINT_MODELS.values().
        inputs: see there.
    """
    return track_of(inputs, _steps(model, inputs))


def innovations(model: ProcessModel, inputs: Inputs) -> tuple[Float[Array, "T m B"], Float[Array, "T m B"]]:
    """Innovations and their variances (T, m, B) of ``filter_scan``, for derivatives in forward mode.

    Derivatives along many measurements share one recursion of the covariance, which does not depend on them.
    """
    loop = _loop(model, lambda step: (step.prediction, step.prediction_variance))
    prediction, variance = (jnp.stack(x, 1) for x in loop(inputs))
    return jnp.where(jnp.isfinite(inputs.y), inputs.y - prediction, 0), variance + inputs.variance


def _steps(model: ProcessModel, inputs: Inputs, for_reverse: bool = False) -> Step:
    """The filter at every sample, leaves (T, B); columns of the covariance are for the reverse pass alone."""

    def keep(step: Step) -> tuple[Step, Vector]:
        column = step.record.column if for_reverse else []
        return step._replace(covariance=[], record=step.record._replace(column=column)), upper(step.covariance)

    steps: Step
    steps, triangles = one_at_a_time(_loop(model, keep))(inputs)
    return steps._replace(covariance=from_upper(len(inputs.mean), triangles))


def _loop(model: ProcessModel, keep: Callable[[Step], Any]) -> Callable[[Inputs], Any]:
    """The loop over the samples, and what it keeps of every step."""

    @compile_whole
    def loop(inputs: Inputs) -> Any:
        driven_by = forces_of(inputs)

        def body(state: Packed, sample: Seen) -> tuple[Packed, Any]:
            step = advance(model, driven_by, state, sample)
            return packed(step), keep(step)

        return jax.lax.scan(body, start_of(inputs), samples_of(inputs))[1]

    return loop


Packed = tuple[Vector, Vector]
"""A state between two samples: the mean, and the upper triangle of the covariance."""
Seen = tuple[Array, Vector, Vector, Any]
"""One sample: dt, measurements, their variances, and what drives the process."""


Forces = tuple[Any, Vector]
"""What drives the process, and variances to start again from, entries apart."""


def forces_of(inputs: Inputs) -> Forces:
    """Taken apart before the loop, or every step would do so again."""
    return inputs.density, list(inputs.restart_variance)


def advance(model: ProcessModel, forces: Forces, state: Packed, sample: Seen) -> Step:
    """One sample of the recursion."""
    (strength, restart), (dt, y, variance, drive) = forces, sample
    before = (state[0], from_upper(len(state[0]), state[1]))
    return filter_step(model, driven(strength, drive), restart, before, dt, y, variance)


def packed(step: Step) -> Packed:
    """The state after a step."""
    return step.mean, upper(step.covariance)


def start_of(inputs: Inputs) -> Packed:
    """The state before the first sample."""
    return list(inputs.mean), upper([list(row) for row in inputs.covariance])


def samples_of(inputs: Inputs) -> Seen:
    """All samples, with a leading time axis."""
    return inputs.dt, _entries(inputs.y), _entries(inputs.variance), inputs.drive


def track_of(inputs: Inputs, steps: Step) -> Track:
    """What a run reports; likelihoods are sums over entries, so they need not be worked out in the recursion."""
    nis, log_likelihood = nats_of(steps.record)
    seen = [w > 0 for w in steps.record.weight]
    # What the gate left out has an innovation of 0, like what is missing.
    raw = [jnp.where(s, inputs.y[:, j] - steps.prediction[j], 0) for j, s in enumerate(seen)]
    spread = [steps.prediction_variance[j] + inputs.variance[:, j] for j in range(len(seen))]
    mean, covariance = jnp.stack(steps.mean, 1), _stack(steps.covariance)
    return Track(mean, covariance, jnp.stack(raw, 1), jnp.stack(spread, 1), nis, log_likelihood)


Residual = tuple[Array, Any, Any, Tape]
"""dt, density, drive and the record of every step: all that the reverse pass reads, for it is written and read once."""


def _forward(model: ProcessModel, inputs: Inputs) -> tuple[Track, Residual]:
    steps = _steps(model, inputs, for_reverse=True)
    track, record = track_of(inputs, steps), steps.record
    if isinstance(inputs.density, tuple):
        record = record._replace(before=_before(inputs, track))
    return track, (inputs.dt, inputs.density, inputs.drive, record)


def _before(inputs: Inputs, track: Track) -> Array:
    """The state before every sample (T, k + k (k + 1) / 2, B): mean, and the upper triangle of the covariance."""
    mean = jnp.concatenate([inputs.mean[None], track.mean[:-1]])
    covariance = jnp.concatenate([inputs.covariance[None], track.covariance[:-1]])
    k = mean.shape[1]
    triangle = upper([[covariance[:, a, b] for b in range(k)] for a in range(k)])
    return jnp.concatenate([mean, jnp.stack(triangle, 1)], 1)


def _backward(model: ProcessModel, residual: Residual, bar: Track) -> tuple[Inputs]:
    """Adjoint of the filter: cotangents of the inputs."""
    dt, density, drive, record = residual
    k, zero = bar.mean.shape[1], jnp.zeros_like(bar.mean[0, 0])
    symmetric = (bar.covariance + jnp.swapaxes(bar.covariance, 1, 2)) / 2
    bars = Cotangent(
        _entries(bar.mean),
        [_entries(symmetric[:, a]) for a in range(k)],
        _entries(bar.innovation),
        _entries(bar.innovation_variance),
        bar.nis,
        bar.log_likelihood,
    )

    def loop(density: Any, start: Any, samples: Any) -> Any:
        def body(carry: tuple[tuple[Vector, Rows], Any, Vector], sample: tuple[Array, Any, Tape, Cotangent]) -> Any:
            (state, density_slope, restart), (dt, drive, record, bar) = carry, sample
            slopes = step_back(model, driven(density, drive), dt, record, bar, state)
            restart = [total + slope for total, slope in zip(restart, slopes.restart, strict=True)]
            own, drive_slope = undriven(slopes.density, drive)
            density_slope = jax.tree.map(jnp.add, density_slope, own)
            return (slopes.state, density_slope, restart), (slopes.y, slopes.variance, drive_slope)

        return jax.lax.scan(body, start, samples, reverse=True)

    # XLA aborts on this loop as one marked call if it is mapped and the state before each sample is an argument.
    compiled = loop if isinstance(density, tuple) else one_at_a_time(compile_whole(loop))
    start = (([zero] * k, [[zero] * k for _ in range(k)]), jax.tree.map(jnp.zeros_like, density), [zero] * k)
    (state, density_bar, restart), (y, variance, drive_bar) = compiled(density, start, (dt, drive, record, bars))
    prior = (jnp.stack(state[0]), jnp.stack([jnp.stack(row) for row in state[1]]))
    slopes = (density_bar, jnp.stack(y, 1), jnp.stack(variance, 1), *prior, jnp.stack(restart))
    return (Inputs(jnp.zeros_like(dt), *slopes, drive_bar),)


filter_scan.defvjp(_forward, _backward)


def driven(density: Any, drive: dict[str, Array] | None) -> Any:
    """The strength of the process at one sample."""
    return density if drive is None else density._replace(**drive)


def undriven(slope: Any, drive: dict[str, Array] | None) -> tuple[Any, dict[str, Array] | None]:
    """Adjoint of ``driven``."""
    alone = slope if drive is None else slope._replace(**dict.fromkeys(drive))
    return alone, drive and {name: getattr(slope, name) for name in drive}


def _entries(x: Array) -> Vector:
    """(T, m, B) -> m arrays (T, B)."""
    return [x[:, j] for j in range(x.shape[1])]


def _stack(rows: Rows) -> Array:
    """Rows of (T, B) -> (T, k, k, B)."""
    return jnp.stack([jnp.stack(row, 1) for row in rows], 1)
