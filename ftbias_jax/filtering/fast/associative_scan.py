"""The recursion of scan.py parallel in time, for accelerators: log2(T) rounds instead of T steps.

A stretch of samples is an element (A, b, C, eta, J): given the state x before it, its measurements have the information
J and eta about x, and the state after it is normal with mean A x + b and covariance C. Elements of neighbouring
stretches combine associatively (Sarkka and Garcia-Fernandez 2021, lemma 8), so all prefixes come from one
``lax.associative_scan``. A last step from each prefix to the sample after it, all at once, is that of the sequential
filter; so covariances are those of the Joseph form, positive definite in single precision too. Means of sharp encoders
are then good to about one of their standard deviations (the sequential filter: a twentieth).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ftbias_jax.filtering.fast.kalman_step import Step, filter_step
from ftbias_jax.filtering.fast.scan import Inputs, Track, driven, track_of
from ftbias_jax.filtering.gaussian import symmetrise
from ftbias_jax.filtering.process_models import ProcessModel, as_arrays
from ftbias_jax.runtime.lanes import Rows, Table, Vector

if TYPE_CHECKING:
    from jaxtyping import Bool, Float


class Element(NamedTuple):
    """What stretches of samples do; leading axes (T, B)."""

    A: Float[Array, "... k k"]
    """(..., k, k)."""
    b: Float[Array, "... k"]
    """(..., k)."""
    C: Float[Array, "... k k"]
    """(..., k, k)."""
    eta: Float[Array, "... k"]
    """(..., k)."""
    J: Float[Array, "... k k"]
    """(..., k, k)."""


def filter_parallel(model: ProcessModel, inputs: Inputs) -> Track:
    """Equal to ``scan.filter_scan``; differentiable by autodiff, but slopes do not pass through a restart.

    Args:
        model: process_models.drift_noise or one of process_models.JOINT_MODELS.values().
        inputs: of the filters.
    """
    length, m, lanes = inputs.y.shape
    y, variance = ([x[:, j] for j in range(m)] for x in (inputs.y, inputs.variance))
    dt = jnp.broadcast_to(inputs.dt[:, None], (length, lanes))
    restart = [jnp.broadcast_to(x[None], (length, lanes)) for x in inputs.restart_variance]
    strength = driven(inputs.density, inputs.drive)
    density = jax.tree.map(lambda x: jnp.broadcast_to(x, (length, lanes)), strength)
    measured = _measurements(inputs)

    def step(restarts: Restarts) -> Step:
        """Every sample from the state before it, for filters that start again where they are lost."""
        elements = _combine(_moves(*model(dt, density), restarts, inputs.restart_variance), measured)
        after = jax.lax.associative_scan(_combine, _after_prior(elements, inputs))
        return filter_step(model, density, restart, _entries(after.b[:-1], after.C[:-1]), dt, y, variance)

    def settle(carry: tuple[Restarts, Array]) -> tuple[Restarts, Array]:
        old, found = carry[0], step(carry[0])
        lost = found.record.lost
        new = Restarts(lost, jnp.where(lost, found.prediction[0], 0))
        return new, (new.lost != old.lost).any() | (new.position != old.position).any()

    # Whether and where a filter starts again depends on what it did before, so on earlier restarts: each round settles
    # at least the first one that is not yet right. No restart, one round.
    nowhere = Restarts(jnp.zeros((length, lanes), bool), jnp.zeros((length, lanes), inputs.y.dtype))
    restarts, _ = jax.lax.while_loop(lambda carry: carry[1], settle, (nowhere, jnp.array(True)))
    return track_of(inputs, step(jax.lax.stop_gradient(restarts)))


class Restarts(NamedTuple):
    """Where filters start again, (T, B)."""

    lost: Bool[Array, "T B"]
    position: Float[Array, "T B"]
    """The position they start from, 0 elsewhere."""


def _moves(A: Table, Q: Table, restarts: Restarts, restart: Array) -> Element:
    """Samples without their measurements; a filter that is lost keeps its position and starts again."""
    k, lost = len(A), restarts.lost
    rows = [[jnp.broadcast_to(entry, lost.shape) for entry in row] for row in as_arrays(A)]
    again = jnp.where(jnp.isfinite(restart), restart, 0).T[:, :, None] * jnp.eye(k, dtype=restart.dtype)[None]
    here = lost[..., None, None]
    transition, noise = jnp.where(here, 0, _matrix(rows)), jnp.where(here, again[None], _matrix(as_arrays(Q)))
    zero = jnp.zeros((*lost.shape, k), restart.dtype)
    return Element(transition, zero.at[..., 0].set(restarts.position), noise, zero, jnp.zeros_like(noise))


def _measurements(inputs: Inputs) -> Element:
    """The measurements of every sample: information about the first m entries, none where NaN."""
    k, m = len(inputs.mean), inputs.y.shape[1]
    y, variance = jnp.swapaxes(inputs.y, 1, 2), jnp.swapaxes(inputs.variance, 1, 2)
    seen = jnp.isfinite(y)
    weight = jnp.pad(jnp.where(seen, 1 / variance, 0), ((0, 0), (0, 0), (0, k - m)))
    information = weight * jnp.pad(jnp.where(seen, y, 0), ((0, 0), (0, 0), (0, k - m)))
    one = jnp.eye(k, dtype=weight.dtype)
    identity = jnp.broadcast_to(one, (*weight.shape, k))
    return Element(identity, 0 * weight, 0 * identity, information, weight[..., None] * one[None, None])


def _after_prior(elements: Element, inputs: Inputs) -> Element:
    """The elements with the prior in front, which forgets all before it."""
    mean, covariance = inputs.mean.T, jnp.moveaxis(inputs.covariance, -1, 0)
    nothing = jnp.zeros_like(covariance)
    prior = Element(nothing, mean, covariance, jnp.zeros_like(mean), nothing)
    whole: Element = jax.tree.map(lambda first, x: jnp.concatenate([first[None], x]), prior, elements)
    return whole


def _combine(first: Element, then: Element) -> Element:
    """Two stretches as one."""
    k = first.b.shape[-1]
    D = jnp.linalg.inv(jnp.eye(k, dtype=first.b.dtype)[None, None] + first.C @ then.J)  # its transpose: (I + J C)^-1
    forward, back = then.A @ D, jnp.swapaxes(D @ first.A, -1, -2)
    return Element(
        forward @ first.A,
        _times(forward, first.b + _times(first.C, then.eta)) + then.b,
        symmetrise(forward @ first.C @ jnp.swapaxes(then.A, -1, -2)) + then.C,
        _times(back, then.eta - _times(then.J, first.b)) + first.eta,
        symmetrise(back @ then.J @ first.A) + first.J,
    )


def _times(matrix: Array, vector: Array) -> Array:
    return (matrix @ vector[..., None])[..., 0]


def _matrix(rows: Rows) -> Array:
    """Entries (T, B) -> (T, B, k, k)."""
    return jnp.stack([jnp.stack(row, -1) for row in rows], -2)


def _entries(mean: Array, covariance: Array) -> tuple[Vector, Rows]:
    """(T, B, k), (T, B, k, k) -> entries (T, B)."""
    k = mean.shape[-1]
    return [mean[..., a] for a in range(k)], [[covariance[..., a, b] for b in range(k)] for a in range(k)]
