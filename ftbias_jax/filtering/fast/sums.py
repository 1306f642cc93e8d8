"""The recursion of scan.py where only sums are asked for: of a step one number remains, the density of its innovation.

What the loop does not store it need not write to memory and read again, which costs three times the arithmetic. The
reverse pass (sums_back.py) has the record of every step, which the forward pass writes only then.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ftbias_jax.filtering.fast.kalman_step import Tape, density_of, nats_of, nis_of
from ftbias_jax.filtering.fast.scan import (
    Forces,
    Inputs,
    Packed,
    Seen,
    Smoothed,
    Track,
    advance,
    filter_scan,
    forces_of,
    packed,
    samples_of,
    start_of,
)
from ftbias_jax.filtering.fast.sums_back import Bars, slopes_of_sums
from ftbias_jax.filtering.process_models import Gated, ProcessModel
from ftbias_jax.runtime.compiled_loops import compile_whole, one_at_a_time
from ftbias_jax.runtime.lanes import Vector, from_upper, upper
from ftbias_jax.runtime.logarithm import log
from ftbias_jax.runtime.side_by_side import for_lanes, many_as_lanes

if TYPE_CHECKING:
    from jaxtyping import Float


class States(NamedTuple):
    """Filtered states of every sample, entries kept apart."""

    mean: Vector
    """k arrays (T, B)."""
    triangle: Vector
    """k (k + 1) / 2 arrays (T, B): the upper triangle of the covariance, row by row."""

    def stacked(self) -> Smoothed:
        """The same as arrays."""
        return Smoothed(jnp.stack(self.mean, 1), _matrix(self.triangle, len(self.mean), 1))


class Sums(NamedTuple):
    """What a run comes to."""

    nats: Float[Array, " B"]
    """(B,) weighted sum of the likelihood's increments."""
    mean: Float[Array, "k B"]
    """(k, B) after the last sample."""
    covariance: Float[Array, "k k B"]
    """(k, k, B) after the last sample."""
    states: States | None
    """Filtered states of every sample, where they are asked for."""


@partial(jax.custom_vjp, nondiff_argnums=(0, 1))
def filter_sums(model: ProcessModel, keep: bool, inputs: Inputs, weight: Float[Array, " T"]) -> Sums:
    """Equal to sums over ``scan.filter_scan``.

    Args:
        model: as for ``scan.filter_scan``.
        keep: whether the states of all samples are asked for.
        inputs: as for ``scan.filter_scan``.
        weight: (T,) of every sample's likelihood.
    """
    return _run(model, keep, False, inputs, weight)[0]


def _run(model: ProcessModel, keep: bool, for_reverse: bool, inputs: Inputs, weight: Array) -> tuple[Sums, Any]:
    """The sums, and the record of every step where the reverse pass is to follow."""

    def sums(forces: Forces, start: Packed, samples: Seen, weight: Array) -> Any:
        last, squares, densities, kept, record, each = _loop(model, keep, for_reverse, forces, start, samples, weight)
        # In the loop a logarithm would cost as much as all the rest of a step; here it is worked out for many samples.
        if each is None:
            logs = jnp.matmul(weight[:, 0], log(densities), precision="highest")
        else:
            logs = jnp.matmul(jnp.ones_like(weight[:, 0]), each * log(densities), precision="highest")
        return last, (logs - squares) / 2, kept, record

    # A gate makes the lanes of one log depend on each other.
    over_logs = one_at_a_time(sums) if isinstance(model, Gated) else many_as_lanes(sums)
    (mean, triangle), nats, kept, record = over_logs(
        forces_of(inputs), start_of(inputs), samples_of(inputs._replace(dt=inputs.dt[:, None])), weight[:, None]
    )
    states = None if kept is None else States(*kept)
    return Sums(nats, jnp.stack(mean), _matrix(triangle, len(mean), 0), states), record


Looped = tuple[Packed, Array, Array, Packed | None, Tape | None, Array | None]


def _loop(
    model: ProcessModel, keep: bool, for_reverse: bool, forces: Forces, start: Packed, samples: Seen, weight: Array
) -> Looped:
    """The state after the last sample, the sum of the NIS, densities, the states of all samples, the record, and
    the weights of lanes, where logs have their own."""

    @compile_whole
    def loop(forces: Forces, start: Packed, samples: Seen, weight: Array) -> Any:
        zero = jnp.zeros_like(start[0][0])

        def body(carry: tuple[Packed, Array], sample: tuple[Seen, Array]) -> Any:
            (state, squares), ((dt, *seen), weight) = carry, sample
            step = advance(model, forces, state, (for_lanes(dt, len(zero)), *seen))
            after, record = packed(step), step.record
            weight = for_lanes(weight, len(zero))
            # Weights of logs are told as those of lanes: repeated after the loop, they keep logarithms out of vectors.
            each = weight if len(weight) > 1 else None
            kept = density_of(record), after if keep else None, record if for_reverse else None, each
            return (after, squares + weight * nis_of(record)), kept

        (last, squares), kept = jax.lax.scan(body, (start, zero), (samples, weight))
        return last, squares, *kept

    found: Looped = loop(forces, start, samples, weight)
    return found


def _matrix(triangle: list[Array], k: int, axis: int) -> Array:
    """Entries of the upper triangle -> a matrix, whose rows and columns are axes after the first ``axis``."""
    return jnp.stack([jnp.stack(row, axis) for row in from_upper(k, triangle)], axis)


def _sums_of(keep: bool, track: Track, weight: Array) -> Sums:
    """The same from the track of every sample."""
    k = track.mean.shape[1]
    triangle = upper([[track.covariance[:, a, b] for b in range(k)] for a in range(k)])
    states = States([track.mean[:, a] for a in range(k)], triangle) if keep else None
    return Sums((weight[:, None] * track.log_likelihood).sum(0), track.mean[-1], track.covariance[-1], states)


def _forward(model: ProcessModel, keep: bool, inputs: Inputs, weight: Array) -> tuple[Sums, Any]:
    if isinstance(inputs.density, tuple) or isinstance(model, Gated):
        found: tuple[Sums, Any] = jax.vjp(lambda x, w: _sums_of(keep, filter_scan(model, x), w), inputs, weight)
        return found
    sums, record = _run(model, keep, True, inputs, weight)
    return sums, (inputs.dt, inputs.density, weight, record)


def _backward(model: ProcessModel, keep: bool, residual: Any, bar: Sums) -> Any:
    if callable(residual):
        return residual(bar)
    dt, density, weight, record = residual
    mean, covariance = bar.mean, (bar.covariance + jnp.swapaxes(bar.covariance, 0, 1)) / 2
    last = list(mean), upper([list(row) for row in covariance])
    states = None if bar.states is None else (bar.states.mean, _halved(len(mean), bar.states.triangle))
    found = slopes_of_sums(model, dt, density, weight, record, Bars(bar.nats, last, states))
    k, nats = len(mean), nats_of(record)[1]
    prior = jnp.stack(found.prior[0]), _matrix(found.prior[1], k, 0)
    of_samples = jnp.stack(found.y, 1), jnp.stack(found.variance, 1)
    slopes = Inputs(jnp.zeros_like(dt), found.density, *of_samples, *prior, jnp.stack(found.restart))
    return slopes, nats @ bar.nats


def _halved(k: int, triangle: Vector) -> Vector:
    """Slopes in the entries of a triangle -> those in the entries of the matrix, which has each twice beside its
    diagonal."""
    places = [(a, b) for a in range(k) for b in range(a, k)]
    return [x if a == b else x / 2 for (a, b), x in zip(places, triangle, strict=True)]


filter_sums.defvjp(_forward, _backward)
