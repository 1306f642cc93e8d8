"""A variance fitted to the scatter within the blocks of a log, in one compiled loop.

The scatter of a block is Gamma distributed about the variance, so the likelihood is that of the Itakura-Saito
divergence (Fevotte, Bertin and Durrieu 2009), whose multiplicative step with an exponent of 1/2 does not decrease it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.filtering.adapt.blocks import room_for
from ftbias_jax.runtime.compiled_loops import compile_whole
from ftbias_jax.runtime.jax_config import in_float64
from ftbias_jax.runtime.lanes import Vector, dot
from ftbias_jax.types import Array

if TYPE_CHECKING:
    from jaxtyping import Float

HEAVY = 6.0
"""A scatter this many times the usual is no vibration but a spike: it is cut to that."""
LEAST_LEVEL = 0.01
"""Of the stated variance: less is a reading that stands still, or repeats itself."""
ABREAST = 16
"""Blocks that a step works on together: with their six axes they fill the vector registers."""


class Scatter(NamedTuple):
    """What a variance is fitted to: blocks of a log, N of them."""

    value: Array
    """(N, 6) N^2, Nm^2."""
    dof: Array
    """(N, 6); 0 = not to be used."""
    stated: tuple[Array, ...]
    """(N, 6) each: parts of the stated variance, of which the scatter may show any share."""

    def only(self, rows: Array) -> Scatter:
        """The rows marked in (N,) count, the others do not."""
        return self._replace(dof=np.where(rows[:, None], self.dof, 0))


class Coefficients(NamedTuple):
    """Of a variance, none negative."""

    shares: Array
    """(K, 6) of the stated parts."""
    per_speed: Array
    """(n, 6) of the motion."""


class _Lanes(NamedTuple):
    """What a step reads: R rows of ABREAST blocks, each with its six axes."""

    value: Float[Array, "R lanes"]
    dof: Float[Array, "R lanes"]
    least: Float[Array, "R lanes"]
    """The variance is never less."""
    parts: tuple[Array, ...]
    """What the coefficients multiply, (R, lanes) each: stated parts, then the motion of every joint."""


def variance_of(stated: tuple[Array, ...], motion: Array, coefficients: Coefficients) -> Array:
    """(N, 6) N^2, Nm^2 of a sample in each block, never zero, as an axis that stands still would have it.

    Args:
        stated: parts of the stated variance, (N, 6) each.
        motion: (N, n) (rad/s)^2.
        coefficients: of these.
    """
    known = sum(share * part for share, part in zip(coefficients.shares, stated, strict=True))
    found: Array = np.maximum(known + motion @ coefficients.per_speed, LEAST_LEVEL * 1e-3 * sum(stated))
    return found


def log_likelihood(data: Scatter, mu: Array) -> float:
    """Nats of the scatter for the variance mu (N, 6), up to a constant."""
    return float(-(data.dof * (np.log(mu) + np.minimum(data.value / mu, HEAVY))).sum() / 2)


@in_float64
def maximise(data: Scatter, motion: Array, rounds: int) -> Coefficients:
    """Non-negative coefficients that are likeliest, by multiplicative steps that never lose.

    Args:
        data: scatter of N blocks.
        motion: (N, n) (rad/s)^2, n = 0 if nothing moves.
        rounds: steps.
    """
    start, seen, count = _start(data, motion), (data.dof > 0).any(0), len(data.stated)
    lanes = _lanes(data, [*data.stated, *motion.T])
    found = np.stack(_climb(lanes, [_spread(x) for x in np.concatenate(start)], _spread(seen), rounds))
    shares, per_speed = np.split(found.reshape(-1, ABREAST, 6)[:, 0], [count])
    kept = seen & (per_speed * _scale(motion) > 1e-3 * np.mean(sum(data.stated), 0))
    return Coefficients(np.where(seen, shares, 1), np.where(kept, per_speed, 0))


def _start(data: Scatter, motion: Array) -> Coefficients:
    """Half of the usual scatter is due to what is stated, half to all joints alike."""
    columns = zip(data.value.T, data.dof.T, strict=True)
    usual = np.array([np.median(x[there > 0]) if (there > 0).any() else 1.0 for x, there in columns])
    scale = _scale(motion)
    shares = np.repeat((usual / np.mean(sum(data.stated), 0))[None] / 2, len(data.stated), axis=0)
    return Coefficients(shares, usual[None] / scale / 2 / max(1, len(scale)))


def _scale(motion: Array) -> Array:
    found: Array = np.maximum(motion.mean(0), 1e-12)[:, None]
    return found


def _lanes(data: Scatter, parts: Sequence[Array]) -> _Lanes:
    """As many blocks as the program has: those that are added count nothing."""
    count = len(data.value)

    def in_rows(x: Array, value: float) -> Array:
        rows = np.full((room_for(count), 6), value)
        rows[:count] = x if x.ndim == 2 else x[:, None]
        return rows.reshape(-1, 6 * ABREAST)

    least = LEAST_LEVEL * 1e-3 * np.asarray(sum(data.stated))
    return _Lanes(
        in_rows(data.value, 1.0), in_rows(data.dof, 0.0), in_rows(least, 1.0), tuple(in_rows(x, 0.0) for x in parts)
    )


def _spread(x: Array) -> Array:
    """Of every axis -> of every lane."""
    return np.tile(x, ABREAST)


@jax.jit
def _climb(data: _Lanes, start: Vector, seen: Array, rounds: int) -> Vector:
    """So many steps from the start; coefficients (lanes,), the same for all blocks abreast."""

    @compile_whole
    def loop(data: _Lanes, start: Vector, seen: Array, rounds: int) -> Vector:
        zero = [jnp.zeros_like(x) for x in start]

        def add_row(sums: Any, row: _Lanes) -> tuple[Any, None]:
            at, ups, downs = sums
            mu = jnp.maximum(dot(at, list(row.parts)), row.least)
            down = row.dof / mu
            up = down * jnp.minimum(row.value, HEAVY * mu) / mu
            ups, downs = (
                [total + part * x for total, part in zip(totals, row.parts, strict=True)]
                for totals, x in ((ups, up), (downs, down))
            )
            return (at, ups, downs), None

        def step(_: Any, at: Vector) -> Vector:
            ups, downs = jax.lax.scan(add_row, (at, zero, zero), data)[0][1:]
            return [
                jnp.where(seen, b * jnp.sqrt(_of_axes(up) / jnp.maximum(_of_axes(down), 1e-300)), b)
                for b, up, down in zip(at, ups, downs, strict=True)
            ]

        found: Vector = jax.lax.fori_loop(0, rounds, step, start)
        return found

    result: Vector = loop(data, start, seen, rounds)
    return result


def _of_axes(x: Array) -> Array:
    """Sums over the blocks abreast, for every lane."""
    total = x.reshape(ABREAST, 6).sum(0)
    return jnp.broadcast_to(total, (ABREAST, 6)).reshape(-1)
