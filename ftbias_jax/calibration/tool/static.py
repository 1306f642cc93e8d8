"""Mass and first moment from static poses: least squares on the weight, with the bias constant or drifting.

At rest the sensor reads W = D theta - b with D theta = (m s, h x s), where s = -g in the axes of the sensor, m the mass
and h the first moment; the inertia does not enter. Between poses the bias may move as a random walk. Its strength and
the size of the noise have the largest restricted likelihood given the residuals, for every axis, or for forces and
torques where the poses are few. In a reading at rest the noise of samples is averaged out; what is left is hysteresis,
crosstalk, errors of the pose, and gains that differ between axes: the masses from the three force axes then differ by
more than their errors, and all errors are enlarged by the effect on their mean (DerSimonian and Laird 1986).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ftbias_jax.setup.rotations import rotation_from_vector, skew, vector_from_rotation
from ftbias_jax.types import Array

STRENGTHS = np.array([0.0, *np.logspace(-3, 1, 17)])
"""Variances of a step of the bias to try, in units of the noise variance."""
NATS = 3.0
"""nats by which a drift must be likelier than a constant bias."""
MAX_ITERATIONS = 30
ENOUGH = 30
"""Number of poses from which on noise and drift are estimated for every axis separately."""
FEW = 1.43
"""Two degrees of freedom of the scatter of three axes: three standard deviations this much wider hold 95 %."""
BY_CHANCE = 9.2
"""Chi-square of the masses from three axes about their mean, which chance exceeds once in a hundred."""
UNKNOWNS = 16
"""Mass, first moment (3), rotation of the sensor (3), rotation of gravity (3), bias at the first pose (6)."""


class Problem(NamedTuple):
    """Readings at rest."""

    rotations: Float[Array, "N 3 3"]
    """(N, 3, 3) sensor axes in the base frame as stated: R v_sensor = v_base."""
    wrench: Float[Array, "N 6"]
    """(N, 6) N, Nm, with the sign of the report."""
    t: Float[Array, " N"]
    """(N,) s, or the numbers of the poses: the drift of the bias grows with the root of their differences."""
    prior_std: Float[Array, " 16"]
    """(16,) standard deviation of every unknown about its starting value."""


class Estimate(NamedTuple):
    """Unknowns estimated from the poses."""

    mass: float
    first_moment: Float[Array, " 3"]
    rotation: Float[Array, "3 3"]
    """(3, 3) estimated sensor axes in the stated sensor axes."""
    gravity: Float[Array, " 3"]
    covariance: Float[Array, "16 16"]
    information: Float[Array, "16 16"]
    """(16, 16) information of the poses alone, without prior."""
    bias: Float[Array, " 6"]
    """(6,) N, Nm at the last pose."""
    bias_std: Float[Array, " 6"]
    left_out: Float[Array, "N 6"]
    """(N, 6) N, Nm: reading of each pose minus its prediction from all others, bias and drift included."""
    noise: Float[Array, " 6"]
    """(6,) N, Nm: standard deviation of the noise."""
    drift: Float[Array, " 6"]
    """(6,) N, Nm: standard deviation of the bias's steps from one pose to the next; 0 = constant bias."""
    enlarged: float
    """Factor, 1 or more, that enlarges all standard deviations because the force axes disagree on the mass."""
    converged: bool


class _Point(NamedTuple):
    """Values of the unknowns; rotations are kept as matrices, so that no angle is too large."""

    mass: float
    first_moment: Array
    rotation: Array
    turn: Array
    """(3, 3) rotation from the stated to the estimated direction of gravity."""
    bias: Array


def estimate(
    problem: Problem, mass: float, first_moment: Array, gravity: Array, rotation: Array, drifts: bool = True
) -> Estimate:
    """Fit the unknowns and the noise alternately until both converge.

    The start is also the mean of the prior: mass in kg, first moment (3,) kg m, gravity (3,) m/s^2 in the base frame as
    stated, and the sensor's axes (3, 3) in the stated ones. Without drifts the bias is constant: plain least squares.
    """
    start = _Point(mass, np.asarray(first_moment), rotation, np.eye(3), np.zeros(6))
    point, noise, drift = start, np.ones(6), np.zeros(6)
    walk = _walk(problem.t)
    for iteration in range(MAX_ITERATIONS):
        design, residual = _linear(problem, point, gravity)
        if iteration % 3 == 0:
            noise, drift = _noise(problem, design, residual, walk, drifts)
        solver = _Solver(problem, design, walk, noise, drift)
        step = solver.covariance @ (
            solver.project(residual) - (_difference(point, start) / np.square(problem.prior_std))
        )
        point = _moved(point, step)
        if converged := bool((np.abs(step) < 1e-6 * np.sqrt(np.diag(solver.covariance))).all()) and iteration > 3:
            break
    design, residual = _linear(problem, point, gravity)
    solver = _Solver(problem, design, walk, noise, drift)
    bias, bias_std = solver.last_bias(point.bias, residual)
    enlarged = solver.disagreement(residual)
    return Estimate(
        mass=point.mass,
        first_moment=point.first_moment,
        rotation=point.rotation,
        gravity=point.turn @ gravity,
        covariance=enlarged**2 * solver.covariance,
        information=solver.information / enlarged**2,
        bias=bias,
        bias_std=enlarged * bias_std,
        left_out=solver.left_out(residual),
        noise=noise,
        drift=noise * np.sqrt(drift),
        enlarged=enlarged,
        converged=converged,
    )


class _Solver:
    """Generalised least squares with the covariance noise^2 (I + strength walk) of each axis."""

    def __init__(self, problem: Problem, design: Array, walk: Array, noise: Array, strength: Array) -> None:
        self.design, self.walk, self.strength, self.variance = design, walk, strength, np.square(noise)
        of_strength = {s: np.linalg.inv(np.eye(len(walk)) + s * walk) for s in set(strength.tolist())}
        self.inverse = np.stack([of_strength[s] for s in strength.tolist()]) / self.variance[:, None, None]  # (6, N, N)
        weighted = np.einsum("aij,jap->iap", self.inverse, design)
        self.weighted = weighted
        self.information = np.einsum("iap,iaq->pq", weighted, design)
        self.covariance = np.linalg.inv(self.information + np.diag(problem.prior_std**-2.0))

    def project(self, residual: Array) -> Array:
        """Gradient (16,) of the log-likelihood with respect to the unknowns."""
        return np.einsum("iap,ia->p", self.weighted, residual)

    def disagreement(self, residual: Array) -> float:
        """Factor that enlarges the standard deviation of the mass because the masses from the force axes, each with a
        free bias, differ from their mean by more than chance; 1 = by chance."""
        weights, pulls = np.zeros(3), np.zeros(3)
        for axis in range(3):
            columns = [0, 10 + axis]
            weighted = self.weighted[:, axis, columns]
            (own, cross), (_, bias) = weighted.T @ self.design[:, axis, columns]
            by_mass, by_bias = weighted.T @ residual[:, axis]
            weights[axis], pulls[axis] = own - cross**2 / bias, by_mass - cross / bias * by_bias
        informative = weights > 1e-9 * weights.max()
        w, chi_square = weights[informative], (pulls[informative] ** 2 / weights[informative]).sum()
        if chi_square < BY_CHANCE or len(w) < 2:
            return 1.0
        between = (chi_square - (len(w) - 1)) / (w.sum() - (w**2).sum() / w.sum())
        return float(np.sqrt(1 + FEW**2 * between * (w**2).sum() / w.sum()))

    def left_out(self, residual: Array) -> Array:
        """(N, 6) errors of predicting every pose from all the others, without further fits: (P_ii)^-1 (P y)_i."""
        pulled = np.einsum("aij,ja->ia", self.inverse, residual)
        own = np.einsum("aii->ia", self.inverse)[:, :, None] * np.eye(6)
        own = own - np.einsum("iap,pq,ibq->iab", self.weighted, self.covariance, self.weighted)
        return np.linalg.solve(own, pulled[:, :, None])[:, :, 0]

    def last_bias(self, first: Array, residual: Array) -> tuple[Array, Array]:
        """(6,) bias at the last pose, given the bias at the first one, and its standard deviation."""
        reach = (self.strength * self.variance)[:, None] * self.walk[-1]  # (6, N): covariance with the readings
        gain = np.einsum("aj,aji->ai", reach, self.inverse)
        bias = first - np.einsum("ai,ia->a", gain, residual)
        slope = np.eye(UNKNOWNS)[10:] + np.einsum("ai,iap->ap", gain, self.design)
        own = self.strength * self.variance * self.walk[-1, -1] - (gain * reach).sum(1)
        return bias, np.sqrt(own + np.einsum("ap,pq,aq->a", slope, self.covariance, slope))


def weight_columns(s: Float[Array, "N 3"]) -> Float[Array, "N 6 4"]:
    """(N, 6, 4) wrench per mass and first moment, sensor axes, at specific forces s (N, 3) m/s^2, sensor axes."""
    columns = np.zeros((len(s), 6, 4))
    columns[:, :3, 0] = s
    columns[:, 3:, 1:] = -skew(s)
    return columns


def _linear(problem: Problem, point: _Point, gravity: Array) -> tuple[Array, Array]:
    """Derivatives (N, 6, 16) of the prediction with respect to the unknowns, and reading minus prediction (N, 6)."""
    axes = problem.rotations @ point.rotation
    down = point.turn @ gravity
    s = -np.einsum("nji,j->ni", axes, down)
    by_tool = weight_columns(s)
    by_force = np.concatenate([point.mass * np.eye(3), skew(point.first_moment)])
    by_turn = by_force @ skew(s)
    by_gravity = by_force @ np.einsum("nji,jk->nik", axes, skew(down))
    by_bias = np.broadcast_to(-np.eye(6), (len(s), 6, 6))
    design = np.concatenate([by_tool, by_turn, by_gravity, by_bias], 2)
    predicted = by_tool @ np.array([point.mass, *point.first_moment]) - point.bias
    return design, problem.wrench - predicted


def _noise(problem: Problem, design: Array, residual: Array, walk: Array, drifts: bool) -> tuple[Array, Array]:
    """Standard deviation of the noise and strength of the drift (6,) of every axis, by restricted likelihood."""
    tried, together = (STRENGTHS, 1 if len(walk) >= ENOUGH else 3) if drifts else (STRENGTHS[:1], 3)
    groups = [slice(first, first + together) for first in range(0, 6, together)]
    free = [(np.abs(design[:, axes]).max((0, 1)) > 0) & (problem.prior_std > 1e-6) for axes in groups]
    columns = np.concatenate([design, residual[:, :, None]], 2)
    scored = []
    for strength in tried:
        lower = np.linalg.cholesky(np.eye(len(walk)) + strength * walk)
        white = np.linalg.solve(lower, columns.reshape(len(walk), -1)).reshape(columns.shape)
        spread = 2 * np.log(np.diag(lower)).sum()
        scored.append(
            [_restricted(white[:, k][..., np.append(f, True)], spread) for k, f in zip(groups, free, strict=True)]
        )
    nats, sizes = np.moveaxis(np.array(scored), 2, 0)  # each (strengths, groups)
    best = nats.argmax(0)
    group = np.arange(len(groups))
    best = np.where(nats[best, group] > nats[0] + NATS, best, 0)
    return np.repeat(sizes[best, group], together), np.repeat(tried[best], together)


def _restricted(white: Array, spread_of_axis: float) -> tuple[float, float]:
    """Restricted log-likelihood of whitened columns (N, a, p + 1), and the standard deviation of their noise.

    The last column is the residual, the others belong to the unknowns; ``spread_of_axis`` is the log-determinant of the
    covariance by which one of the a axes was whitened.
    """
    flat, target = white[..., :-1].reshape(white[..., -1].size, -1), white[..., -1].ravel()
    scale = np.linalg.norm(flat, axis=0)
    solution, _, rank, singular = np.linalg.lstsq(flat / scale, target, rcond=1e-9)
    left = max(1, target.size - rank)
    square = max(float(((target - flat / scale @ solution) ** 2).sum()) / left, 1e-300)
    spread = 2 * np.log(singular[:rank]).sum() + 2 * np.log(scale).sum()
    return -(left * np.log(square) + white.shape[1] * spread_of_axis + spread) / 2, float(np.sqrt(square))


def _walk(t: Array) -> Array:
    """(N, N) covariance of a random walk that starts at the first pose, in steps of the median length."""
    steps = (t - t[0]) / np.median(np.diff(t))
    return np.minimum(steps[:, None], steps)


def _difference(point: _Point, start: _Point) -> Array:
    """(16,) unknowns of a point minus those of the start; 0 for the bias, which has no prior."""
    turn = vector_from_rotation(start.rotation.T @ point.rotation)
    moment = point.first_moment - start.first_moment
    return np.array([point.mass - start.mass, *moment, *turn, *vector_from_rotation(point.turn), *np.zeros(6)])


def _moved(point: _Point, step: Array) -> _Point:
    return _Point(
        mass=point.mass + step[0],
        first_moment=point.first_moment + step[1:4],
        rotation=point.rotation @ rotation_from_vector(step[4:7]),
        turn=rotation_from_vector(step[7:10]) @ point.turn,
        bias=point.bias + step[10:],
    )
