"""The axis-parallel rotation from which a sensor's mounting is searched, from the direction of its weight alone."""

import numpy as np
from jaxtyping import Float

from ftbias_jax.check.mounts import ROTATIONS
from ftbias_jax.types import Array

CLEARLY = 0.8
"""Share of the stated mounting's sum of squares that another start must stay below."""
CERTAIN = 3.0
"""Standard errors by which a mass must be positive to count, or negative to exclude the stated mounting."""
LEAST_TURN = 0.02
"""rad, rms rotation of gravity in the sensor frame below which the mounting is not questioned."""
MOST_ROWS = 4000
"""Largest number of samples used, evenly spaced."""


def likely_rotation(
    columns: Float[Array, "T 6 4"], wrench: Float[Array, "T 6"], t: Float[Array, " T"], std: Float[Array, " 6"]
) -> Float[Array, "3 3"]:
    """The axis-parallel rotation Q of the sensor, v_stated = Q v_true, from which the search should start.

    For each rotation, mass, first moment, bias and a steady drift are fitted by least squares to the rotated reading,
    all with one factorisation. Rotations count if their mass is significantly positive, the stated one unless it is
    significantly negative. Columns (T, 6, 4) are the derivatives of the wrench with respect to mass and first moment,
    stated sensor axes; rows of the wrench (T, 6) N, Nm with NaN are left out; the mean noise of forces and torques
    weights them.
    """
    rows = np.flatnonzero(np.isfinite(wrench).all(1))
    if not len(rows):
        return np.eye(3)
    rows = rows[np.linspace(0, len(rows) - 1, min(MOST_ROWS, len(rows))).astype(int)]
    weight = 1 / np.repeat([std[:3].mean(), std[3:].mean()], 3)
    time = (t[rows] - t[rows].mean()) / (np.ptp(t[rows]) or 1.0)
    turns = np.stack(ROTATIONS)
    turned = np.einsum("kab,tgb->tgak", turns, wrench[rows].reshape(-1, 2, 3)).reshape(len(rows), 6, -1)
    design, target = (
        _without_line(x * weight[:, None], time).reshape(6 * len(rows), -1) for x in (columns[rows], turned)
    )
    inverse = np.linalg.pinv(design)
    solution = inverse @ target
    cost = ((target - design @ solution) ** 2).sum(0)
    if (design[:, 0] ** 2).sum() < LEAST_TURN**2 * ((columns[rows, :, 0] * weight) ** 2).sum():
        return turns[0]
    error = np.sqrt(cost / len(target) * (inverse[0] ** 2).sum())
    sure = np.where(np.arange(len(turns)) == 0, -CERTAIN, CERTAIN)
    cost[solution[0] <= sure * error] = np.inf
    best = int(cost.argmin())
    return turns[best] if cost[best] < CLEARLY * cost[0] else turns[0]


def _without_line(x: Array, time: Array) -> Array:
    """Columns x (T, 6, k) minus their best-fitting constant and steady drift; time (T,) has mean zero."""
    slope = np.einsum("t,tak->ak", time, x) / (time @ time)
    return x - x.mean(0) - time[:, None, None] * slope
