"""Least-squares fit of a tool near the stated one, with free bias and drift, evaluated on held-out blocks."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ftbias_jax.setup.types import ToolSetup
from ftbias_jax.types import Array

KNOT = 40.0
"""s between the knots of the free, piecewise linear drift."""
STEADY = 10.0
"""s; in a shorter log the bias is constant, because a drift would absorb the effect of half a turn of the tool."""
BLOCKS = 20
"""Number of blocks per log; even and odd blocks are held out in turn."""
TRIMS = (0.15, 0.45, 0.6)
"""Shares of the bins, the worst of every fit, that are trimmed as contact or spikes; where one share reveals no mistake
the next is tried, because a robot may be in contact for most of a log."""
ROUNDS = 3
"""Number of fits, each without the bins that the previous one fitted worst."""
STEPS = np.logspace(-12, 8, 81)
"""Lagrange multipliers that are tried, relative to the largest curvature."""
BETWEEN = np.linspace(0, 1, len(STEPS))
"""Exponents that interpolate geometrically between two neighbouring multipliers."""


class Layout(NamedTuple):
    """Basis, blocks and axes that all fits to one set of bins share."""

    basis: Float[Array, "N K"]
    """Basis functions of bias and drift of each log, piecewise linear in time."""
    block: Float[Array, " N"]
    """Block number of each bin; the numbers of one log follow those of the previous one."""
    axes: Bool[Array, " 6"]
    """Which axes of the wrench are measured; the others are zero."""
    trim: float = TRIMS[0]
    """Share of the bins that fits trim."""

    @property
    def touched(self) -> bool:
        """Whether most bins may be contact, so that a fit to all of them is no starting point."""
        return self.trim > 0.5

    def windows(self) -> list[Bool[Array, " N"]]:
        """Masks of the bins from which a fit may start: all; early, middle and late ones where most may be contact."""
        every = [np.ones(len(self.basis), bool)]
        if not self.touched:
            return every
        place, share = (np.arange(len(self.basis)) + 0.5) / len(self.basis), 1 - self.trim
        middles = np.linspace(share / 2, 1 - share / 2, round(2 / share) - 2)
        return every + [np.abs(place - middle) <= share / 2 for middle in middles]


class Tool(NamedTuple):
    """Inertial parameters theta (10,) and how far a fit may depart from them, because a stated tool is inexact."""

    theta: Float[Array, " 10"]
    reach: Float[Array, " 10"]
    """Semi-axes of the ellipsoid around theta that confines a fit; infinite = free."""


class Fit(NamedTuple):
    """Fit of one alternative, with errors on bins that were held out from the estimation of its parameters."""

    theta: Float[Array, " 10"]
    """Inertial parameters of a fit to all kept bins."""
    errors: Float[Array, "N 2"]
    """Squared norms of the residuals of force and torque, N^2 and Nm^2."""
    kept: Bool[Array, " N"]
    """Bins that are not trimmed as contact or spikes."""

    @property
    def square(self) -> Float[Array, " 2"]:
        """Mean squared error of force and torque, N^2 and Nm^2."""
        return self.errors[self.kept].mean(0)


def make_layout(t: Array, log: Array, axes: Array) -> Layout:
    """Build the layout of bins at t (N,) s of logs with these numbers (N,); ``axes`` (6,) marks the measured ones."""
    columns, blocks, count = [], np.zeros(len(t), int), 0
    for number in np.unique(log):
        rows = np.flatnonzero(log == number)
        order = np.arange(len(rows)) * BLOCKS // len(rows)
        blocks[rows] = count + order
        count += BLOCKS
        # The bias may change arbitrarily over a pause; the bins, not the hours between them, set the number of knots.
        span = np.cumsum(np.minimum(np.diff(t[rows], prepend=t[rows[0]]), 2 * KNOT))
        knots = np.linspace(0, max(span[-1], 1e-9), 2 + int(span[-1] // KNOT))
        tents = np.stack([np.interp(span, knots, unit) for unit in np.eye(len(knots))], 1)
        if span[-1] < STEADY:
            tents = np.ones((len(rows), 1))
        column = np.zeros((len(t), len(knots)))
        column[rows] = tents
        columns.append(column)
    return Layout(np.concatenate(columns, 1), blocks, axes)


def stated_tool(tool: ToolSetup) -> Tool:
    """Tool of a setup, whose reach covers the usual errors of stated parameters."""
    m, c = tool.mass, tool.center_of_mass
    x, y, z = c
    steiner = m * np.array([y * y + z * z, -x * y, -x * z, x * x + z * z, -y * z, x * x + y * y])
    theta = np.concatenate([[m], m * c, tool.inertia + steiner])
    length = np.linalg.norm(c)
    moment = m * (0.04 + 0.5 * length)
    inertia = m * (0.1 + length) ** 2 + np.abs(tool.inertia).max()
    return Tool(theta, np.concatenate([[0.25 * m], np.full(3, moment), np.full(6, inertia)]))


def free_tool(tool: Tool) -> Tool:
    """Tool with unlimited reach, so that a fit is free."""
    return Tool(tool.theta, np.full(10, np.inf))


def no_tool() -> Tool:
    """Tool that exerts no wrench: the residual is then the reading without its bias and drift."""
    return Tool(np.zeros(10), np.zeros(10))


def exactly(tool: Tool) -> Tool:
    """Tool without reach, so that a fit uses its parameters exactly."""
    return Tool(tool.theta, np.zeros(10))


def fit(D: Array, wrench: Array, tool: Tool, layout: Layout) -> Fit:
    """Least trimmed squares of W = D theta - b with theta within the tool's reach and a free bias b.

    D is (N, 6, 10), or (N, 6, k) with further regressors, for which theta and reach then have entries, too; the wrench
    W is (N, 6) N, Nm.
    """
    D = D * layout.axes[:, None]
    # Typical magnitude of force and torque without bias, N and Nm, by which the two are weighted.
    scale = np.sqrt(np.median(squares(without_bias(wrench, layout)), 0)) + 1e-9
    fits = [_least_trimmed_squares(D, wrench, tool, layout, scale, window) for window in layout.windows()]
    return min(fits, key=lambda fit: float((fit.square / scale**2).sum()))


def _least_trimmed_squares(D: Array, wrench: Array, tool: Tool, layout: Layout, scale: Array, kept: Array) -> Fit:
    """Least trimmed squares from a window of bins: each fit drops the bins that the previous one fitted worst."""
    errors = np.zeros((len(wrench), 2))
    halves = [layout.block % 2 == part for part in (0, 1)]
    for _ in range(ROUNDS):
        for held in halves:
            theta, bias = _solve(D, wrench, tool, layout, kept & ~held, scale)
            left = D[held] @ theta - layout.basis[held] @ bias - wrench[held]
            errors[held] = squares(left)
        badness = (errors / scale**2).sum(1)
        best = badness <= np.quantile(badness, 1 - layout.trim)
        if all((best & held).any() for held in halves):  # both halves need bins to fit
            kept = best
    theta, _ = _solve(D, wrench, tool, layout, kept, scale)
    return Fit(theta, errors, kept)


def squares(values: Array) -> Float[Array, "N 2"]:
    """Squared norms (N, 2) of force and torque of wrenches (N, 6)."""
    return (values.reshape(-1, 2, 3) ** 2).sum(2)


def without_bias(values: Array, layout: Layout) -> Array:
    """Subtract from columns (N, ...) the bias and drift that fit them best."""
    flat = values.reshape(len(values), -1)
    coefficients = np.linalg.lstsq(layout.basis, flat, rcond=None)[0]
    return (flat - layout.basis @ coefficients).reshape(values.shape)


def _solve(
    D: Array, wrench: Array, tool: Tool, layout: Layout, rows: Array, scale: Array
) -> tuple[Float[Array, " 10"], Float[Array, "K 6"]]:
    """Fit the tool and the coefficients of bias and drift to some rows."""
    B = layout.basis[rows]
    gram = B.T @ B
    gram += 1e-9 * max(np.trace(gram), 1e-300) / len(gram) * np.eye(len(gram))
    if not tool.reach.any():
        return tool.theta, np.linalg.solve(gram, B.T @ (D[rows] @ tool.theta - wrench[rows]))
    count, width = len(B), D.shape[2]
    columns = np.concatenate([D[rows].reshape(count, 6 * width), wrench[rows]], 1)
    fitted = np.linalg.solve(gram, B.T @ columns)
    free = columns - B @ fitted
    X = free[:, :-6].reshape(count, 6, width) / np.repeat(scale, 3)[:, None]
    y = free[:, -6:] / np.repeat(scale, 3)
    X, y = X.reshape(-1, width), y.reshape(-1)
    theta = within_reach(X.T @ X, X.T @ y, tool)
    return theta, fitted[:, :-6].reshape(-1, 6, width) @ theta - fitted[:, -6:]


def within_reach(normal: Array, right: Array, tool: Tool) -> Float[Array, " 10"]:
    """Minimise theta' normal theta - 2 right' theta over the tool's ellipsoid."""
    if not tool.reach.any():
        return tool.theta
    if np.isinf(tool.reach).all():
        size = np.sqrt(np.diag(normal)) + 1e-12
        scaled = normal / np.outer(size, size) + 1e-9 * np.eye(len(normal))
        return np.linalg.solve(scaled, right / size) / size
    S = tool.reach
    d, V = np.linalg.eigh(normal * np.outer(S, S))
    g = V.T @ (S * (right - normal @ tool.theta))
    d = np.maximum(d, 0)

    def first_inside(steps: Array) -> int:
        inside = np.flatnonzero(((g / (d + steps[:, None])) ** 2).sum(1) <= 1)
        return int(inside[0]) if inside.size else len(steps) - 1

    steps = STEPS * max(d[-1], 1e-300)
    for _ in range(2):  # the second pass refines between two steps of the first
        i = first_inside(steps)
        steps = steps[max(i - 1, 0)] * (steps[i] / steps[max(i - 1, 0)]) ** BETWEEN
    return tool.theta + S * (V @ (g / (d + steps[first_inside(steps)])))
