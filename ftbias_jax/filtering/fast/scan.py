"""The Kalman recursion of many small independent filters over a log, with a hand-written reverse pass.

It computes what ``gaussian.predict`` and ``gaussian.update`` compute for the filters of kalman_step.py. The loop over
the samples is compiled as a whole (compiled_loops.py).

The reverse pass is the adjoint of the filter. For the log-likelihood it is the Bryson-Frazier smoother (Bierman 1973):
with L the log-likelihood of the present and future, x_smooth = x_pred + P_pred dL/dx_pred. So gradients cost about as
much as the filter, and smoothing is the same pass.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ftbias_jax.filtering.fast.kalman_step import Cotangent, Record, Step, filter_step, step_back
from ftbias_jax.filtering.process_models import ProcessModel
from ftbias_jax.runtime.compiled_loops import compile_whole, one_at_a_time
from ftbias_jax.runtime.lanes import Rows, Vector, from_upper, upper

if TYPE_CHECKING:
    from jaxtyping import Float


class Inputs(NamedTuple):
    """What the filters see. k = states, m = measured entries (the first m), B = batch of independent filters."""

    dt: Float[Array, " T"]
    """(T,) s since the previous sample. Data: its gradient is reported as zero."""
    density: Float[Array, " B"]
    """(B,) strength of the process noise."""
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
        restart = list(inputs.restart_variance)

        def body(state: tuple[Vector, Rows], sample: tuple[Array, Vector, Vector]) -> tuple[Any, Any]:
            step = filter_step(model, inputs.density, restart, state, *sample)
            return (step.mean, step.covariance), keep(step)

        start = (list(inputs.mean), [list(row) for row in inputs.covariance])
        return jax.lax.scan(body, start, (inputs.dt, _entries(inputs.y), _entries(inputs.variance)))[1]

    return loop


def track_of(inputs: Inputs, steps: Step) -> Track:
    """What is told of a run; likelihoods are sums over entries, so they need not be worked out in the recursion."""
    weight, innovation = steps.record.weight, steps.record.innovation
    m = len(weight)
    seen = [w > 0 for w in weight]
    squares = [v**2 * w for v, w in zip(innovation, weight, strict=True)]
    logs = [
        jnp.log(jnp.where(s, w, 1)) - s * jnp.log(2 * jnp.pi).astype(w.dtype) for s, w in zip(seen, weight, strict=True)
    ]
    raw = [jnp.where(s, inputs.y[:, j] - steps.prediction[j], 0) for j, s in enumerate(seen)]
    spread = [steps.prediction_variance[j] + inputs.variance[:, j] for j in range(m)]
    nis = sum(squares[1:], squares[0])
    log_likelihood = (sum(logs[1:], logs[0]) - nis) / 2
    mean, covariance = jnp.stack(steps.mean, 1), _stack(steps.covariance)
    return Track(mean, covariance, jnp.stack(raw, 1), jnp.stack(spread, 1), nis, log_likelihood)


Residual = tuple[Array, Array, Record]
"""dt, density and the record of every step: all that the reverse pass reads, for it is written and read once more."""


def _forward(model: ProcessModel, inputs: Inputs) -> tuple[Track, Residual]:
    steps = _steps(model, inputs, for_reverse=True)
    return track_of(inputs, steps), (inputs.dt, inputs.density, steps.record)


def _backward(model: ProcessModel, residual: Residual, bar: Track) -> tuple[Inputs]:
    """Adjoint of the filter: cotangents of the inputs."""
    dt, density, record = residual
    k, zero = bar.mean.shape[1], jnp.zeros_like(density)
    symmetric = (bar.covariance + jnp.swapaxes(bar.covariance, 1, 2)) / 2
    bars = Cotangent(
        _entries(bar.mean),
        [_entries(symmetric[:, a]) for a in range(k)],
        _entries(bar.innovation),
        _entries(bar.innovation_variance),
        bar.nis,
        bar.log_likelihood,
    )

    @one_at_a_time
    @compile_whole
    def loop(density: Array, start: Any, samples: Any) -> Any:
        def body(carry: tuple[tuple[Vector, Rows], Array, Vector], sample: tuple[Array, Record, Cotangent]) -> Any:
            state, density_slope, restart = carry
            slopes = step_back(model, density, *sample, state)
            restart = [total + slope for total, slope in zip(restart, slopes.restart, strict=True)]
            return (slopes.state, density_slope + slopes.density, restart), (slopes.y, slopes.variance)

        return jax.lax.scan(body, start, samples, reverse=True)

    start = (([zero] * k, [[zero] * k for _ in range(k)]), zero, [zero] * k)
    (state, density_bar, restart), (y, variance) = loop(density, start, (dt, record, bars))
    prior = (jnp.stack(state[0]), jnp.stack([jnp.stack(row) for row in state[1]]))
    slopes = (density_bar, jnp.stack(y, 1), jnp.stack(variance, 1), *prior, jnp.stack(restart))
    return (Inputs(jnp.zeros_like(dt), *slopes),)


filter_scan.defvjp(_forward, _backward)


def _entries(x: Array) -> Vector:
    """(T, m, B) -> m arrays (T, B)."""
    return [x[:, j] for j in range(x.shape[1])]


def _stack(rows: Rows) -> Array:
    """Rows of (T, B) -> (T, k, k, B)."""
    return jnp.stack([jnp.stack(row, 1) for row in rows], 1)
