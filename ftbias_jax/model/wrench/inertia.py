"""Physically consistent inertial parameters: the pseudo-inertia matrix and its log-Cholesky coordinates.

A rigid body of positive density has a positive definite pseudo-inertia J = [[S, h], [h^T, m]] with first moment h and
second moment S = tr(I)/2 - I about the same origin. J = U U^T with U upper triangular of positive diagonal maps ten
unbounded numbers one to one onto such bodies (Rucker and Wensing 2022).
"""

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from ftbias_jax.model.kinematics.screws import skew

_ROWS, _COLUMNS = np.array([0, 1, 0, 0, 1, 2]), np.array([1, 2, 2, 3, 3, 3])


def pseudo_inertia(theta: Float[Array, " 10"]) -> Float[Array, "4 4"]:
    """(10,) inertial parameters (tool_wrench.py) -> (4, 4) pseudo-inertia, kg m^2, kg m, kg."""
    mass, moment = theta[0], theta[1:4]
    xx, xy, xz, yy, yz, zz = theta[4:]
    inertia = jnp.stack([jnp.stack([xx, xy, xz]), jnp.stack([xy, yy, yz]), jnp.stack([xz, yz, zz])])
    second = jnp.eye(3, dtype=theta.dtype) * (xx + yy + zz) / 2 - inertia
    return jnp.block([[second, moment[:, None]], [moment[None], mass[None, None]]])


def parameters_from_pseudo_inertia(J: Float[Array, "4 4"]) -> Float[Array, " 10"]:
    """(4, 4) pseudo-inertia -> (10,) inertial parameters."""
    second = J[:3, :3]
    inertia = jnp.eye(3, dtype=J.dtype) * jnp.trace(second) - second
    upper = inertia[np.array([0, 0, 0, 1, 1, 2]), np.array([0, 1, 2, 1, 2, 2])]
    return jnp.concatenate([J[3:, 3], J[:3, 3], upper])


def spatial_inertia(theta: Float[Array, " 10"]) -> Float[Array, "6 6"]:
    """(10,) inertial parameters -> (6, 6): wrench that accelerates the body along and about each axis, force first."""
    mass, moment = theta[0], skew(theta[1:4])
    inertia = theta[4:][np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])]
    return jnp.block([[mass * jnp.eye(3, dtype=theta.dtype), -moment], [moment, inertia]])


def turned(theta: Float[Array, " 10"], rotation: Float[Array, "3 3"]) -> Float[Array, " 10"]:
    """(10,) inertial parameters of the same body rotated by R (3, 3) about the origin."""
    turn = jnp.eye(4, dtype=theta.dtype).at[:3, :3].set(rotation)
    return parameters_from_pseudo_inertia(turn @ pseudo_inertia(theta) @ turn.T)


def parameters_from_log_cholesky(coordinates: Float[Array, " 10"]) -> Float[Array, " 10"]:
    """(10,) unbounded coordinates (alpha, d1, d2, d3, s12, s23, s13, t1, t2, t3) -> (10,) inertial parameters."""
    alpha, diagonal, rest = coordinates[0], coordinates[1:4], coordinates[4:]
    U = jnp.diag(jnp.concatenate([jnp.exp(diagonal), jnp.ones_like(alpha)[None]]))
    U = jnp.exp(alpha) * U.at[_ROWS, _COLUMNS].set(rest)
    return parameters_from_pseudo_inertia(U @ U.T)


def log_cholesky_from_parameters(theta: Float[Array, " 10"]) -> Float[Array, " 10"]:
    """Inverse of ``parameters_from_log_cholesky``; theta must belong to a body with volume."""
    reverse = np.arange(4)[::-1]
    lower = jnp.linalg.cholesky(pseudo_inertia(theta)[reverse][:, reverse])  # Reversed, it becomes the upper factor.
    U = lower[reverse][:, reverse]
    alpha = jnp.log(U[3, 3])
    scaled = U / U[3, 3]
    return jnp.concatenate([alpha[None], jnp.log(jnp.diagonal(scaled)[:3]), scaled[_ROWS, _COLUMNS]])


def center_of_mass(theta: Float[Array, " 10"]) -> Float[Array, " 3"]:
    """Centre of mass (3,) m, sensor axes."""
    return theta[1:4] / theta[0]


def about_center_of_mass(theta: Float[Array, " 10"]) -> tuple[Float[Array, ""], Float[Array, " 3"], Float[Array, " 6"]]:
    """Data-sheet values: mass () kg, centre of mass (3,) m, and inertia (6,) kg m^2 about it, sensor axes.

    For a numpy array the values are numpy arrays, and nothing is compiled.
    """
    mass, center = theta[0], center_of_mass(theta)
    row, column = np.triu_indices(3)
    steiner = mass * ((center @ center) * (row == column) - center[row] * center[column])
    return mass, center, theta[4:] - steiner


def without_round_off(values: Array | np.ndarray) -> np.ndarray:
    """Data-sheet values in SI units, as reported without round-off: a point mass has no inertia of 1e-18 kg m^2."""
    return np.round(np.asarray(values), 15)
