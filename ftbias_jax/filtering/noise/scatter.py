"""A variance fitted to the scatter within the blocks of a log, by Fisher scoring.

The scatter of a block is Gamma distributed about the variance mu = X b with coefficients b >= 0, so a step of scoring
is a least-squares fit with the weights dof / mu^2 (McCullagh and Nelder 1989, section 8.3.6). Spikes are clipped at
HEAVY mu.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ftbias_jax.runtime.compiled_loops import compile_whole
from ftbias_jax.types import Array

HEAVY = 6.0
"""Multiple of the variance above which a scatter is a spike rather than vibration; it is clipped there."""
LEAST_LEVEL = 0.01
"""Smallest share of the stated variance; with less, the reading is frozen or repeats itself."""
SWEEPS = 15
"""Sweeps over the coefficients in every scoring step; the next step continues from their result."""


class Scatter(NamedTuple):
    """Data of the fit of variances: N blocks, and S choices of regressors that may explain their scatter."""

    value: Float[Array, "N 6"]
    """N^2, Nm^2: scatter of the samples in each block."""
    dof: Float[Array, "F N 6"]
    """Degrees of freedom in each of F fits; 0 = the block is not used."""
    stated: tuple[Float[Array, "N 6"], ...]
    """Parts of the stated variance, of which the scatter may show any share."""
    motion: Float[Array, "S N n"]
    """(rad/s)^2: squared joint speeds of each choice."""
    usual: Float[Array, " 6"]
    """N^2, Nm^2, median of ``value``."""

    @property
    def least(self) -> Array:
        """Lower limit (N, 6) of the variance, which an axis that stands still would fall below."""
        return LEAST_LEVEL * 1e-3 * sum(self.stated)


class Coefficients(NamedTuple):
    """Non-negative coefficients of a variance, for S choices and F fits."""

    shares: Float[Array, "S F 6 K"]
    """Coefficients of the stated parts."""
    per_speed: Float[Array, "S F 6 n"]
    """Coefficients of the motion."""


def variance_of(data: Scatter, found: Coefficients) -> Float[Array, "S F N 6"]:
    """Variance N^2, Nm^2 of a sample in each block."""
    stated = jnp.stack(data.stated, -1)
    known = jnp.einsum("nak,sfak->sfna", stated, found.shares)
    moving = jnp.einsum("snj,sfaj->sfna", data.motion, found.per_speed)
    return jnp.maximum(known + moving, data.least[None, None])


def log_likelihood(data: Scatter, mu: Float[Array, "S F N 6"]) -> Float[Array, "S F"]:
    """Log-likelihood, nats, of the scatter for these variances, up to a constant."""
    return -(data.dof[None] * (jnp.log(mu) + jnp.minimum(data.value[None, None] / mu, HEAVY))).sum((-2, -1)) / 2


def maximise(data: Scatter, rounds: int) -> Coefficients:
    """Maximum-likelihood coefficients after ``rounds`` scoring steps; 0 for what does not occur, as motion at rest."""
    stated, joints = jnp.stack(data.stated), data.motion.shape[2]
    first, second = np.triu_indices(joints)
    place = np.zeros((joints, joints), int)
    place[first, second] = place[second, first] = np.arange(len(first))
    parts = stated[:, None, None, None]  # (K, 1, 1, 1, N, 6)
    squares = data.motion[..., first] * data.motion[..., second]

    def step(_: int, found: Coefficients) -> Coefficients:
        mu = variance_of(data, found)
        dof, value = data.dof[None], data.value[None, None]
        weight = jnp.where(dof > 0, dof / mu**2, 0)
        of_value = weight * jnp.minimum(value, HEAVY * mu)
        weighted = weight[None] * parts[:, 0]  # (K, S, F, N, 6)
        among_stated = (weighted[:, None] * parts[None, :, 0]).sum(4)  # (K, K, S, F, 6)
        across = jnp.einsum("snj,ksfna->jksfa", data.motion, weighted)
        among_joints = jnp.einsum("snp,sfna->psfa", squares, weight)[place]
        upper, lower = jnp.concatenate([among_stated, jnp.swapaxes(across, 0, 1)], 1), [across, among_joints]
        matrix = jnp.concatenate([upper, jnp.concatenate(lower, 1)])
        of_joints = jnp.einsum("snj,sfna->jsfa", data.motion, of_value)
        right = jnp.concatenate([(of_value[None] * parts[:, 0]).sum(3), of_joints])
        start = jnp.concatenate([found.shares, found.per_speed], -1)
        solved = _non_negative(matrix, right, jnp.moveaxis(start, -1, 0))
        return Coefficients(*jnp.split(jnp.moveaxis(solved, 0, -1), [len(stated)], axis=-1))

    return jax.lax.fori_loop(0, rounds, step, _start(data))


def _start(data: Scatter) -> Coefficients:
    """Initial coefficients: half of the usual scatter by what is stated, half by all joints alike."""
    number, joints = len(data.stated), data.motion.shape[2]
    used = data.dof.max(0) > 0
    of_all = jnp.where(used, sum(data.stated), 0).sum(0) / jnp.maximum(used.sum(0), 1)
    level = data.usual / jnp.where(of_all > 0, of_all, 1) / 2
    moves = data.motion.mean(1)[:, None]  # (S, 1, n)
    speed = jnp.where(moves > 0, data.usual[None, :, None] / jnp.where(moves > 0, moves, 1) / 2 / max(1, joints), 0)
    fits = (len(data.motion), len(data.dof), 6)
    shares = jnp.broadcast_to(level[None, None, :, None], (*fits, number))
    return Coefficients(shares, jnp.broadcast_to(speed[:, None], (*fits, joints)))


def _non_negative(matrix: Array, right: Array, start: Array) -> Array:
    """Non-negative least squares by coordinate descent, for many fits together.

    Takes the normal matrices (K, K, ...), the right-hand sides (K, ...) and the initial coefficients.
    """

    @compile_whole
    def solve(matrix: Array, right: Array, start: Array) -> Array:
        def one(step: Array, b: Array) -> Array:
            j = step % len(b)
            row, own = matrix[j], matrix[j, j]
            left = right[j] - (row * b).sum(0)
            return b.at[j].set(jnp.where(own > 0, jnp.maximum(b[j] + left / jnp.where(own > 0, own, 1), 0), 0))

        return jax.lax.fori_loop(0, SWEEPS * len(start), one, start)

    number = len(right)
    flat = solve(matrix.reshape(number, number, -1), right.reshape(number, -1), start.reshape(number, -1))
    return flat.reshape(right.shape)
