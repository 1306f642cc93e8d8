"""Physically consistent tools for a search: log-Cholesky coordinates, a prior, a quadratic cost.

The coordinates separate into mass (the first), inertia about the centre of mass per kg (the next six) and centre of
mass (the last three), so each of them can be held fixed.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from ftbias_jax.filtering.innovation_regression import Prior
from ftbias_jax.model.wrench.inertia import (
    about_center_of_mass,
    log_cholesky_from_parameters,
    parameters_from_log_cholesky,
)
from ftbias_jax.model.wrench.tool_wrench import tool_parameters
from ftbias_jax.runtime.kept_programs import keep_program

RADIUS = 0.05
"""m, radius of the sphere that replaces a point mass, because log-Cholesky coordinates need a body with volume."""
NAMES = ("mass", "com_x", "com_y", "com_z", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")
UNITS = ("kg", "m", "m", "m", *["kg m^2"] * 6)
PRIOR_STD = np.array([1.5, 1.0, 1.0, 1.0, 0.1, 0.1, 0.1, 0.3, 0.3, 0.3])
"""Prior standard deviations of the coordinates: log factors for mass and size, m for skew and centre of mass."""
COORDINATE = {"mass": 0, "com_x": 7, "com_y": 8, "com_z": 9}
"""Index of the log-Cholesky coordinate that depends, apart from its scale, on this parameter alone."""
OF_INERTIA = slice(1, 7)
"""Coordinates of the inertia about the centre of mass."""
FIXED = 1e-9
"""Prior standard deviation of a coordinate that is held fixed."""


class Quadratic(NamedTuple):
    """Half the sum of squared innovations over some samples, as a function of the parameters."""

    at: np.ndarray
    """(P,) parameters at which it is expanded."""
    pull: np.ndarray
    """(P,) gradient there."""
    information: np.ndarray
    """(P, P) Hessian."""
    constant: float
    """Value there."""

    def __call__(self, z: np.ndarray) -> float:
        """Value at parameters (P,)."""
        move = z - self.at
        return float(self.constant + move @ (self.pull + self.information @ move / 2))

    def scaled(self, factor: float) -> Quadratic:
        """The same cost times a factor."""
        return Quadratic(self.at, factor * self.pull, factor * self.information, factor * self.constant)


def total(parts: list[Quadratic]) -> Quadratic:
    """Sum of costs expanded at the same parameters."""
    pull = np.sum([part.pull for part in parts], 0)
    information = np.sum([part.information for part in parts], 0)
    return Quadratic(parts[0].at, pull, information, sum(part.constant for part in parts))


def most_likely(cost: Quadratic, x: np.ndarray, prior: Prior) -> np.ndarray:
    """Coordinates (P,) of the physically consistent tool that minimises cost plus prior, by Levenberg-Marquardt."""

    def penalised(x: np.ndarray) -> float:
        return cost(parameters_at(x)) + float((((x - prior.mean) / prior.std) ** 2).sum() / 2)

    x = np.where(prior.std <= FIXED, prior.mean, x)
    current, damping, weight = penalised(x), 1e-3, prior.std**-2.0
    for _ in range(500):
        z, slope = (np.asarray(value) for value in _physical_and_jacobian(jnp.asarray(x)))
        gradient = slope.T @ (cost.pull + cost.information @ (z - cost.at)) + weight * (x - prior.mean)
        normal = slope.T @ cost.information @ slope + np.diag(weight)
        step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient)
        trial = x - step / max(1.0, np.abs(step / prior.std).max())  # logarithms overflow after a long step
        new = penalised(trial)
        if new < current:
            gained, x, current, damping = current - new, trial, new, damping / 10
            if gained < 1e-6 * max(1.0, abs(current)):
                break
        else:
            damping *= 10
            if damping > 1e12:
                break
    return x


@keep_program()
def physical(x: Float[Array, " P"]) -> Float[Array, " P"]:
    """(P,) with theta (10,) in place of the first ten entries, its log-Cholesky coordinates."""
    return jnp.concatenate([parameters_from_log_cholesky(x[:10]), x[10:]])


def parameters_at(x: np.ndarray) -> np.ndarray:
    """(P,) ``physical`` of coordinates (P,), as a NumPy array."""
    return np.asarray(physical(jnp.asarray(x)))


def jacobian_of_physical(x: np.ndarray) -> np.ndarray:
    """(P, P) derivative of ``physical`` at coordinates (P,)."""
    return np.asarray(_physical_and_jacobian(jnp.asarray(x))[1])


@keep_program()
def _physical_and_jacobian(x: Array) -> tuple[Array, Array]:
    return physical(x), jax.jacfwd(physical)(x)


def coordinates(theta: Float[Array, " 10"]) -> np.ndarray:
    """(10,) log-Cholesky coordinates of a tool; a point or a rod is replaced by a sphere of radius RADIUS."""
    return np.asarray(_coordinates(theta))


@keep_program()
def _coordinates(theta: Array) -> Array:
    return log_cholesky_from_parameters(_with_volume(theta))


@keep_program()
def data_sheet(theta: Float[Array, " 10"]) -> Float[Array, " 10"]:
    """(10,) in the order of NAMES: mass, centre of mass, inertia about it."""
    mass, center, inertia = about_center_of_mass(theta)
    return jnp.concatenate([mass[None], center, inertia])


@keep_program()
def jacobian_of_data_sheet(x: Float[Array, " P"]) -> Float[Array, "10 P"]:
    """Derivative of ``data_sheet`` with respect to coordinates (P,), whose first ten are those of the tool."""
    return jax.jacfwd(lambda x: data_sheet(physical(x)[:10]))(x)


def theta_of(sheet: np.ndarray) -> np.ndarray:
    """(10,) inertial parameters from a data sheet (10,) as NAMES."""
    return np.asarray(tool_parameters(jnp.asarray(sheet[0]), jnp.asarray(sheet[1:4]), jnp.asarray(sheet[4:])))


def tool_units(mass: float, inertia: float = 0.0) -> np.ndarray:
    """(10,) largest theta of a tool of this mass, kg, and size RADIUS; or this inertia, kg m^2, if it is larger."""
    return np.array([mass, *[RADIUS * mass] * 3, *[max(mass * RADIUS**2, inertia)] * 6])


def _with_volume(theta: Array) -> Array:
    """The tool with the inertia of a sphere if the stated one is that of a point or a rod."""
    mass, center, inertia = about_center_of_mass(theta)
    sphere = 0.4 * mass * RADIUS**2
    principal = jnp.linalg.eigvalsh(jnp.stack([inertia[jnp.array(row)] for row in ((0, 1, 2), (1, 3, 4), (2, 4, 5))]))
    thick = principal[0] + principal[1] - principal[2] > 1e-3 * sphere
    round_inertia = sphere * jnp.array([1.0, 0.0, 0.0, 1.0, 0.0, 1.0])
    return tool_parameters(mass, center, jnp.where(thick, inertia, round_inertia))
