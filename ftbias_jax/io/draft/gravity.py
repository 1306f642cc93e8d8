"""What gravity alone shows of a tool: its mass and centre of mass, and the sign in which the sensor reports."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ftbias_jax.types import Array

MOST_SAMPLES = 5000
OUTLIER = 4.0
"""Scaled median deviations beyond which a sample is contact or fast motion, and left out."""
ROUNDS = 4
MOST_OPEN = 0.1
"""m: of a centre that the motion does not show, that much is not known."""
CREDIBLE = 0.5
"""Standard error of the mass, as a share of it, up to which the fit is worth writing down."""


class Weighed(NamedTuple):
    """A tool that was weighed by turning it."""

    mass: float
    """kg; negative if the sensor reports the opposite sign."""
    center_of_mass: Array
    """(3,) m, sensor frame."""
    mass_stderr: float
    """kg, as if one sample a second were independent."""
    center_stderr: Array
    """(3,) m, the same, of the torques alone; MOST_OPEN at most."""
    residual: float
    """N, rms of what weight and a constant bias leave of the forces."""

    @property
    def credible(self) -> bool:
        """Whether the motion determines the mass at all."""
        return bool(self.mass_stderr < CREDIBLE * abs(self.mass))


def weigh(t: Array, rotations: Array, gravity: Array, wrench: Array) -> Weighed | None:
    """Weigh the tool by least squares, as if every sample were at rest: those that do not fit are left out.

    Args:
        t: (T,) s.
        rotations: (T, 3, 3) sensor frame in the base frame.
        gravity: (3,) m/s^2, base frame.
        wrench: (T, 6) N, Nm, as the sensor reports it.

    Returns:
        None, if there are not enough samples, or the sensor is never turned.
    """
    complete = np.flatnonzero(np.isfinite(wrench).all(1) & np.isfinite(rotations).all((1, 2)))
    rows = complete[:: max(1, len(complete) // MOST_SAMPLES)]
    if len(rows) < 20:
        return None
    support = -np.einsum("tji,j->ti", rotations[rows], gravity)  # what carries one kilogram, sensor frame
    force, torque = wrench[rows, :3], wrench[rows, 3:]
    kept = np.ones(len(rows), bool)
    for _ in range(ROUNDS):
        swing = support[kept] - support[kept].mean(0)
        turned = (swing**2).sum()
        if turned < len(swing) * 1e-4 * (gravity**2).sum():
            return None
        mass = (swing * (force[kept] - force[kept].mean(0))).sum() / turned
        error = force - mass * support
        error = np.linalg.norm(error - np.median(error[kept], 0), axis=1)
        kept = error < OUTLIER * 1.4826 * np.median(error) + 1e-9
    residual = float(np.sqrt((error[kept] ** 2).mean()))
    seconds = max(1.0, np.ptp(t[rows]) * kept.mean())
    stderr = residual / np.sqrt(turned / len(swing) * seconds)
    moment, moment_stderr = _first_moment(support[kept], torque[kept], seconds)
    center = moment / mass
    center_stderr = np.minimum(np.hypot(moment_stderr, center * stderr) / abs(mass), MOST_OPEN)
    return Weighed(float(mass), center, float(stderr), center_stderr, residual)


def _first_moment(support: Array, torque: Array, count: float) -> tuple[Array, Array]:
    """(3,) m c of torque = (m c) x support + constant, by least squares with a weak pull to zero; and standard errors.

    Args:
        support: (T, 3) what carries one kilogram.
        torque: (T, 3) Nm.
        count: how many of the samples are independent.
    """
    zero = np.zeros(len(support))
    x, y, z = (support - support.mean(0)).T
    columns = np.stack([np.stack(row, 1) for row in ((zero, z, -y), (-z, zero, x), (y, -x, zero))], 1).reshape(-1, 3)
    pull = 1e-6 * np.trace(columns.T @ columns) * np.eye(3)
    target = (torque - torque.mean(0)).ravel()
    moment = np.linalg.solve(columns.T @ columns + pull, columns.T @ target)
    variance = ((target - columns @ moment) ** 2).mean() * len(support) / count
    return moment, np.sqrt(variance * np.diag(np.linalg.inv(columns.T @ columns + pull)))
