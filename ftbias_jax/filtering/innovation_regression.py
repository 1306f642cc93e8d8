"""Parameters of the wrench model by least squares on whitened innovations, with bias and drift as nuisance parameters.

For fixed noise this is the exact maximum of the likelihood: the bias filter is linear, so it whitens the model error
and its derivatives alike (likelihood.whiten).
"""

from collections.abc import Callable
from typing import NamedTuple, Self

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ftbias_jax.filtering.likelihood import WrenchProblem, whiten
from ftbias_jax.types import Array

BLOCK_SECONDS = 4.0
"""s; model errors are correlated over a motion, not just a sample, so standard errors use blocks of this length."""


class Prior(NamedTuple):
    """Independent normal prior of the parameters; a wide one keeps parameters without excitation at their start."""

    mean: np.ndarray
    std: np.ndarray


class Linear(NamedTuple):
    """Whitened linearisation of a model at given parameters, for y = prediction - reading."""

    at: np.ndarray
    """(P,) parameters at which the model is linearised."""
    columns: np.ndarray
    """(P, T, 6) innovations of the derivatives with respect to the parameters, in standard deviations."""
    residual: np.ndarray
    """(T, 6) innovations of the model error, in standard deviations; 0 where nothing was measured."""
    information: np.ndarray
    """(P, P) information matrix for noise of the stated size."""
    bias: np.ndarray
    """(6,) N, Nm: the filtered bias after the last sample minus the one expected a priori."""
    bias_slopes: np.ndarray
    """(P, 6) derivatives of ``bias`` with respect to the parameters."""
    bias_variance: np.ndarray
    """(6,) N^2, Nm^2: variance of ``bias`` for noise of the stated size."""

    @property
    def cost(self) -> float:
        """Half the sum of squared innovations."""
        return float((self.residual**2).sum() / 2)

    def moved(self, to: np.ndarray) -> Self:
        """The linearisation moved to other parameters (P,), for a model that is linear in them."""
        move = to - self.at
        residual = self.residual + np.tensordot(move, self.columns, 1)
        return self._replace(at=to, residual=residual, bias=self.bias + move @ self.bias_slopes)


def linearise(problem: WrenchProblem, predict: Callable[[Array], Array], values: Float[Array, " P"]) -> Linear:
    """Linearise a model at given parameters and whiten it; to be called inside a compiled program.

    Args:
        problem: the bias filter of the log.
        predict: differentiable model: (P,) parameters -> (T, 6) N, Nm, sensor frame, reading without bias and noise.
        values: (P,) parameters at which to linearise.
    """
    # The prediction of one appended sample is the bias; a column that is 1 at this sample alone gives its variance.
    last = problem.variance[-1:]
    longer = problem._replace(
        dt=jnp.append(problem.dt, 0.0),
        wrench=jnp.concatenate([problem.wrench, jnp.zeros_like(last)]),
        variance=jnp.concatenate([problem.variance, last]),
        jump=None if problem.jump is None else jnp.concatenate([problem.jump, jnp.zeros_like(last)]),
    )
    predicted, slope_along = jax.linearize(predict, values)
    slopes, error = jax.vmap(slope_along)(jnp.eye(len(values), dtype=values.dtype)), (predicted - problem.wrench)[None]
    series = jnp.concatenate([slopes, error, jnp.zeros_like(error)])
    after = jnp.zeros_like(series[:, :1]).at[-1].set(1.0)
    white = whiten(longer, jnp.concatenate([series, after], 1))
    columns, residual, std = white[:-2, :-1], white[-2, :-1], 1 / white[-1, -1]
    bias = -white[:-1, -1] * std[None]
    flat = columns.reshape(len(values), -1)
    return Linear(values, columns, residual, flat @ flat.T, bias[-1], bias[:-1], std**2 - last[0])


def covariance(linear: Linear, dt: Float[Array, " T"], normal: np.ndarray) -> np.ndarray:
    """Inverse information (P, P), widened where the scores of whole blocks scatter more than white noise would.

    Args:
        linear: the linearisation at the optimum.
        dt: (T,) s.
        normal: (P, P) information, including that of a prior if there is one.
    """
    scores = np.einsum("ptc,tc->pt", linear.columns, linear.residual)
    block = (np.cumsum(np.asarray(dt)) / BLOCK_SECONDS).astype(int)
    return widened_inverse(np.stack([np.bincount(block, score) for score in scores], -1), normal)


def conditional(covariance: np.ndarray, own: Array, known: Array) -> np.ndarray:
    """Schur complement (k, k): squared standard deviations of the parameters ``own`` (k,) given those ``known``."""
    own, known = np.asarray(own, int), np.asarray(known, int)
    beside = covariance[np.ix_(own, known)]
    inner: np.ndarray = covariance[np.ix_(own, own)]
    return inner - beside @ np.linalg.solve(covariance[np.ix_(known, known)], beside.T)


def stderr_of_reading(columns: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(6,) N, Nm, rms over time: error of a reading with derivatives (k, T, 6) with respect to uncertain parameters."""
    variance = np.einsum("iuc,ij,juc->uc", columns, covariance, columns, optimize=True)
    stderr: np.ndarray = np.sqrt(np.maximum(variance, 0.0).mean(0))
    return stderr


def widened_inverse(scores: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Inverse of a normal matrix (P, P), widened by the scatter of the scores of whole blocks (blocks, P)."""
    inverse = np.linalg.inv(normal)
    sandwich = inverse @ (scores.T @ scores) @ inverse
    widen = np.sqrt(np.maximum(1, np.diag(sandwich) / np.diag(inverse)))
    return inverse * widen[:, None] * widen
