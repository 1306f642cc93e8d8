"""A variance fitted to the scatter within the blocks of a log, by Fisher's scoring.

The scatter of a block is Gamma distributed about the variance mu = X b with coefficients b >= 0, so a step of scoring is
a least-squares fit with the weights dof / mu^2 (McCullagh and Nelder 1989, section 8.3.6). Spikes are cut at HEAVY mu.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ftbias_jax.runtime.compiled_loops import compile_whole

if TYPE_CHECKING:
    from jaxtyping import Float

HEAVY = 6.0
"""A scatter this many times the usual is no vibration but a spike: it is cut to that."""
LEAST_LEVEL = 0.01
"""Of the stated variance: less is a reading that stands still, or repeats itself."""
SWEEPS = 30
"""Over the coefficients in every step; the next step goes on where they end."""


class Scatter(NamedTuple):
    """What variances are fitted to: N blocks, and S choices of what may explain them."""

    value: Float[Array, "N 6"]
    """N^2, Nm^2."""
    dof: Float[Array, "F N 6"]
    """Of each of F fits; 0 = not to be used."""
    stated: tuple[Float[Array, "N 6"], ...]
    """Parts of the stated variance, of which the scatter may show any share."""
    motion: Float[Array, "S N n"]
    """(rad/s)^2."""

    @property
    def least(self) -> Array:
        """(N, 6): the variance is never less, as it would be on an axis that stands still."""
        return LEAST_LEVEL * 1e-3 * sum(self.stated)


class Coefficients(NamedTuple):
    """Of a variance, none negative, for S choices and F fits."""

    shares: Float[Array, "S F 6 K"]
    """Of the stated parts."""
    per_speed: Float[Array, "S F 6 n"]
    """Of the motion."""


def variance_of(data: Scatter, found: Coefficients) -> Float[Array, "S F N 6"]:
    """N^2, Nm^2 of a sample in each block."""
    stated = jnp.stack(data.stated, -1)
    known = jnp.einsum("nak,sfak->sfna", stated, found.shares)
    return jnp.maximum(known + jnp.einsum("snj,sfaj->sfna", data.motion, found.per_speed), data.least)


def log_likelihood(data: Scatter, mu: Float[Array, "S F N 6"]) -> Float[Array, "S F"]:
    """Nats of the scatter for these variances, up to a constant."""
    return -(data.dof * (jnp.log(mu) + jnp.minimum(data.value / mu, HEAVY))).sum((-2, -1)) / 2


def maximise(data: Scatter, rounds: int) -> Coefficients:
    """Coefficients that are likeliest; 0 for what does not occur, as motion at rest.

    Args:
        data: scatter of blocks.
        rounds: steps of scoring.
    """
    number, joints = len(data.stated), data.motion.shape[2]
    stated = jnp.stack(data.stated)  # (K, N, 6)
    squares = (data.motion[..., :, None] * data.motion[..., None, :]).reshape(*data.motion.shape[:2], -1)

    def step(_: int, found: Coefficients) -> Coefficients:
        mu = variance_of(data, found)
        weight = data.dof / mu**2
        of_value = weight * jnp.minimum(data.value, HEAVY * mu)
        weighted = [weight * part for part in stated]
        among_stated = [[(row * part).sum(2) for part in stated] for row in weighted]  # each (S, F, 6)
        across = [jnp.einsum("snj,sfna->sfja", data.motion, row) for row in weighted]
        among_joints = jnp.einsum("snp,sfna->sfpa", squares, weight)
        right = [(of_value * part).sum(2) for part in stated]
        right += list(jnp.moveaxis(jnp.einsum("snj,sfna->sfja", data.motion, of_value), 2, 0))
        of_joints = list(jnp.moveaxis(among_joints, 2, 0))
        rows = [[*among_stated[k], *jnp.moveaxis(across[k], 2, 0)] for k in range(number)]
        for j in range(joints):
            rows.append([*(row[:, :, j] for row in across), *of_joints[joints * j : joints * (j + 1)]])
        start = [*jnp.moveaxis(found.shares, 3, 0), *jnp.moveaxis(found.per_speed, 3, 0)]
        solved = jnp.stack(_non_negative(rows, right, start), -1)
        return Coefficients(solved[..., :number], solved[..., number:])

    return jax.lax.fori_loop(0, rounds, step, _start(data))


def _start(data: Scatter) -> Coefficients:
    """Half of the usual scatter is due to what is stated, half to all joints alike."""
    number, joints = len(data.stated), data.motion.shape[2]
    used = data.dof.max(0) > 0
    usual = jnp.nan_to_num(jnp.nanmedian(jnp.where(used, data.value, jnp.nan), 0), nan=1.0)
    of_all = jnp.where(used, sum(data.stated), 0).sum(0) / jnp.maximum(used.sum(0), 1)
    level = usual / jnp.where(of_all > 0, of_all, 1) / 2
    moves = data.motion.mean(1)[:, None]  # (S, 1, n)
    speed = jnp.where(moves > 0, usual[:, None] / jnp.where(moves > 0, moves, 1) / 2 / max(1, joints), 0)
    fits = (len(data.motion), len(data.dof), 6)
    shares = jnp.broadcast_to(level[:, None], (*fits, number))
    return Coefficients(shares, jnp.broadcast_to(speed[:, None], (*fits, joints)))


def _non_negative(matrix: list[list[Array]], right: list[Array], start: list[Array]) -> list[Array]:
    """Least squares with coefficients that are not negative, one coefficient after the other, many fits at once.

    Args:
        matrix: normal matrix, entry by entry, each (...) over the fits.
        right: right-hand sides.
        start: coefficients.
    """
    shape = start[0].shape

    @compile_whole
    def solve(matrix: list[list[Array]], right: list[Array], start: list[Array]) -> list[Array]:
        def sweep(_: int, b: list[Array]) -> list[Array]:
            b = list(b)
            for j, row in enumerate(matrix):
                left = right[j] - sum(x * y for x, y in zip(row, b, strict=True))
                b[j] = jnp.where(row[j] > 0, jnp.maximum(b[j] + left / jnp.where(row[j] > 0, row[j], 1), 0), 0)
            return b

        solved: list[Array] = jax.lax.fori_loop(0, SWEEPS, sweep, start)
        return solved

    flat = jax.tree.map(lambda x: x.reshape(-1), (matrix, right, start))
    return [x.reshape(shape) for x in solve(*flat)]
