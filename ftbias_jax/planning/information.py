"""Fisher information of the readings of a motion, with unknown bias and drift as nuisance parameters.

The bias is a slowly varying Gaussian process, so its covariance over a log is spanned by a constant, a slope and a few
smooth shapes. Woodbury's identity eliminates it from the information exactly, except for shapes that are smaller than
the noise. Unlike the filter's recursion this takes a few matrix products, whose derivative is cheap.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ftbias_jax.types import Array

SHAPES = 24
"""Number of bias shapes besides a constant and a slope; their eigenvalues fall with the fourth power of the index."""


class Nuisance(NamedTuple):
    """Bias and drift over the samples: r shapes times independent Gaussian coefficients."""

    shapes: Float[Array, "U r"]
    """(U, r) values of the shapes at the samples."""
    std: Float[Array, "6 r"]
    """(6, r) N, Nm, standard deviations of the coefficients."""


def bias_shapes(
    t: Float[np.ndarray, " U"], density: Float[np.ndarray, " 6"], prior_std: Float[np.ndarray, " 12"]
) -> Nuisance:
    """Shapes of the bias process of ``process_models.drift_noise`` at times t (U,) s.

    The density (6,) is sigma_Q; prior_std (12,) is the square root of P_0, bias then drift.
    """
    t = np.asarray(t, float) - t[0]
    low, high = np.minimum.outer(t, t), np.maximum.outer(t, t)
    value, vector = np.linalg.eigh(low**2 * (3 * high - low) / 6)  # covariance of a Wiener process, integrated once
    kept = slice(-min(SHAPES, len(t)), None)
    shapes = np.concatenate([np.ones((len(t), 1)), t[:, None], vector[:, kept]], 1)
    of_process = np.outer(density, np.sqrt(np.maximum(value[kept], 0)))
    return Nuisance(shapes, np.concatenate([np.reshape(prior_std, (2, 6)).T, of_process], 1))


def information(
    columns: Float[Array, "P U 6"], variance: Float[Array, "U 6"], nuisance: Nuisance
) -> Float[Array, "P P"]:
    """Fisher information: products of the columns with one another under the noise, with bias and drift as nuisance.

    The columns (P, U, 6) are derivatives of the reading, N, Nm, with respect to each parameter; the variance (U, 6)
    N^2, Nm^2 is that of white noise, infinite where nothing was measured.
    """
    white = columns / jnp.sqrt(variance)[None]
    shapes = nuisance.shapes[None] * nuisance.std[:, None] / jnp.sqrt(variance).T[:, :, None]  # (6, U, r)
    normal = jnp.einsum("cur,cus->crs", shapes, shapes) + jnp.eye(shapes.shape[2])[None]
    mixed = jnp.einsum("puc,cur->cpr", white, shapes)
    whole = jnp.einsum("puc,quc->pq", white, white)
    return whole - jnp.einsum("cpr,crs,cqs->pq", mixed, jax.vmap(inverse)(normal), mixed)


def inverse(matrix: Float[Array, "P P"]) -> Float[Array, "P P"]:
    """Inverse of a symmetric positive definite matrix (``eliminated``)."""
    return eliminated(matrix)[0]


def eliminated(matrix: Float[Array, "P P"]) -> tuple[Float[Array, "P P"], Float[Array, ""]]:
    """Inverse and log determinant of a positive definite matrix by Gauss-Jordan elimination, which needs no pivoting.

    Unlike LAPACK routines it can be part of compiled programs that are cached between processes.
    """

    def eliminate(left: Array, k: Array) -> tuple[Array, Array]:
        pivot = left[k, k]
        row, column = left[k] / pivot, left[:, k]
        swept = left - jnp.outer(column, row)
        swept = swept.at[k].set(row).at[:, k].set(-column / pivot)
        return swept.at[k, k].set(1 / pivot), jnp.log(pivot)

    found, pivots = jax.lax.scan(eliminate, matrix, jnp.arange(len(matrix)))
    return found, pivots.sum()


def mean_log_error(information: Float[Array, "P P"], scale: Float[Array, " P"], prior: float) -> Float[Array, ""]:
    """Mean logarithm of the standard errors along the axes of the error ellipsoid (D-optimality).

    Unlike the standard errors of single parameters it tolerates a combination of parameters that no motion constrains:
    a wide prior constrains it.

    Args:
        information: (P, P), in inverse squared units of the parameters, 1/kg^2 for a mass.
        scale: (P,) typical departures, in which the errors are counted.
        prior: standard deviations of the prior, in typical departures.
    """
    scaled = information * scale[:, None] * scale[None]
    return -eliminated(scaled + jnp.eye(len(scale)) / prior**2)[1] / (2 * len(scale))


def unexplained(information: Float[Array, "P P"], loose: int = 0) -> Float[Array, ""]:
    """nats by which the first column is detected with the others free: half its squared norm that these leave.

    Args:
        information: (P, P), of columns in units of N and Nm or of their noise.
        loose: number of trailing columns that are not free, but have a prior of standard deviation 1.
    """
    known = jnp.arange(1, len(information)) >= len(information) - loose
    rest = information[1:, 1:] + jnp.diag(known.astype(information.dtype))
    size = jnp.sqrt(jnp.maximum(jnp.diagonal(rest), 1e-30))
    scaled = rest / size[:, None] / size[None] + 1e-9 * jnp.eye(len(rest))
    pull = information[0, 1:] / size
    return jnp.maximum(information[0, 0] - pull @ inverse(scaled) @ pull, 0) / 2
