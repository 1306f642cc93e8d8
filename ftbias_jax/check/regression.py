"""How well a tool near the stated one explains the wrench, with bias and drift free, on blocks that were held out."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ftbias_jax.setup.types import ToolSetup
from ftbias_jax.types import Array

KNOT = 40.0
"""s between the knots of the drift that is left free."""
STEADY = 10.0
"""s: in a shorter log the bias is constant; a drift would explain what half a turn of the tool does."""
BLOCKS = 20
"""Of every log: those of even number are held out from the others, and the other way round."""
TRIMS = (0.15, 0.45, 0.6)
"""Share of the bins that is left out as contact or spikes, the worst of every fit; where the first finds nothing the
next is tried, because a robot may be touched for most of a log."""
ROUNDS = 3
"""Fits, each without what the one before it missed most."""
STEPS = np.logspace(-12, 8, 81)
"""Lagrange multipliers to try, relative to the largest curvature."""
BETWEEN = np.linspace(0, 1, len(STEPS))
"""Powers of what lies between two of them."""


class Layout(NamedTuple):
    """What all fits to one set of bins share."""

    basis: Float[Array, "N K"]
    """Bias and drift of each log: piecewise linear in time."""
    block: Float[Array, " N"]
    """Number of the bin's block; the logs' blocks follow one another."""
    axes: Bool[Array, " 6"]
    """Which axes of the wrench are measured; the others are zero."""
    trim: float = TRIMS[0]
    """Share of the bins that fits leave out."""

    @property
    def touched(self) -> bool:
        """Whether most bins may be contact: no fit to all of them can then be a start."""
        return self.trim > 0.5

    def windows(self) -> list[Bool[Array, " N"]]:
        """Bins from which a fit may start: all of them; and early, middle and late ones where most may be contact."""
        every = [np.ones(len(self.basis), bool)]
        if not self.touched:
            return every
        place, share = (np.arange(len(self.basis)) + 0.5) / len(self.basis), 1 - self.trim
        middles = np.linspace(share / 2, 1 - share / 2, round(2 / share) - 2)
        return every + [np.abs(place - middle) <= share / 2 for middle in middles]


class Tool(NamedTuple):
    """Inertial parameters theta (10,) and how far off they may be, for a statement that is not exact."""

    theta: Float[Array, " 10"]
    reach: Float[Array, " 10"]
    """Half axes of the ellipsoid around theta that a fit may use; infinite = free."""


class Fit(NamedTuple):
    """Of one alternative, on bins that its parameters have not seen."""

    theta: Float[Array, " 10"]
    """Of a fit to all bins."""
    errors: Float[Array, "N 2"]
    """Squared norm of what is left of force and torque, N^2 and Nm^2."""
    kept: Bool[Array, " N"]
    """Bins that are not left out as contact or spikes."""

    @property
    def square(self) -> Float[Array, " 2"]:
        """Mean squared error of force and torque, N^2 and Nm^2."""
        return self.errors[self.kept].mean(0)


def make_layout(t: Array, log: Array, axes: Array) -> Layout:
    """Bias, drift and blocks of bins at t (N,) s, of logs with these numbers (N,); ``axes`` (6,) are those measured."""
    columns, blocks, count = [], np.zeros(len(t), int), 0
    for number in np.unique(log):
        rows = np.flatnonzero(log == number)
        order = np.arange(len(rows)) * BLOCKS // len(rows)
        blocks[rows] = count + order
        count += BLOCKS
        # Over a pause the bias may change at will; the knots must be as many as the bins need, not the hours between.
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
    """The tool of a setup; a merely inexact statement is within reach."""
    m, c = tool.mass, tool.center_of_mass
    x, y, z = c
    steiner = m * np.array([y * y + z * z, -x * y, -x * z, x * x + z * z, -y * z, x * x + y * y])
    theta = np.concatenate([[m], m * c, tool.inertia + steiner])
    length = np.linalg.norm(c)
    moment = m * (0.04 + 0.5 * length)
    inertia = m * (0.1 + length) ** 2 + np.abs(tool.inertia).max()
    return Tool(theta, np.concatenate([[0.25 * m], np.full(3, moment), np.full(6, inertia)]))


def free_tool(tool: Tool) -> Tool:
    """Any tool."""
    return Tool(tool.theta, np.full(10, np.inf))


def no_tool() -> Tool:
    """None at all: what is left is the reading without its bias."""
    return Tool(np.zeros(10), np.zeros(10))


def exactly(tool: Tool) -> Tool:
    """The tool to the last digit."""
    return Tool(tool.theta, np.zeros(10))


def fit(D: Array, wrench: Array, tool: Tool, layout: Layout) -> Fit:
    """Least squares of W = D theta - b with theta within the tool's reach, b free, and the worst bins left out.

    D is (N, 6, 10), or (N, 6, k) with columns of more than a tool, which theta and reach then have, too; the wrench W
    is (N, 6) N, Nm.
    """
    D = D * layout.axes[:, None]
    # Typical size of force and torque without their bias, N and Nm: the weights of the two.
    scale = np.sqrt(np.median(squares(without_bias(wrench, layout)), 0)) + 1e-9
    fits = [_concentrated(D, wrench, tool, layout, scale, window) for window in layout.windows()]
    return min(fits, key=lambda fit: float((fit.square / scale**2).sum()))


def _concentrated(D: Array, wrench: Array, tool: Tool, layout: Layout, scale: Array, kept: Array) -> Fit:
    """Least trimmed squares from a window: each fit is without what the one before it missed most."""
    errors = np.zeros((len(wrench), 2))
    halves = [layout.block % 2 == part for part in (0, 1)]
    for _ in range(ROUNDS):
        for held in halves:
            theta, bias = _solve(D, wrench, tool, layout, kept & ~held, scale)
            left = D[held] @ theta - layout.basis[held] @ bias - wrench[held]
            errors[held] = squares(left)
        badness = (errors / scale**2).sum(1)
        best = badness <= np.quantile(badness, 1 - layout.trim)
        if all((best & held).any() for held in halves):  # neither may be without bins to fit
            kept = best
    theta, _ = _solve(D, wrench, tool, layout, kept, scale)
    return Fit(theta, errors, kept)


def squares(values: Array) -> Float[Array, "N 2"]:
    """Squared norms of force and torque (N, 6)."""
    return (values.reshape(-1, 2, 3) ** 2).sum(2)


def without_bias(values: Array, layout: Layout) -> Array:
    """Columns (N, ...) less the bias and drift that fit them best."""
    flat = values.reshape(len(values), -1)
    coefficients = np.linalg.lstsq(layout.basis, flat, rcond=None)[0]
    return (flat - layout.basis @ coefficients).reshape(values.shape)


def _solve(
    D: Array, wrench: Array, tool: Tool, layout: Layout, rows: Array, scale: Array
) -> tuple[Float[Array, " 10"], Float[Array, "K 6"]]:
    """The tool, and coefficients of bias and drift, by some rows."""
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
    """argmin of theta' normal theta - 2 right' theta in the tool's ellipsoid."""
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
    for _ in range(2):  # the second time between two steps of the first
        i = first_inside(steps)
        steps = steps[max(i - 1, 0)] * (steps[i] / steps[max(i - 1, 0)]) ** BETWEEN
    return tool.theta + S * (V @ (g / (d + steps[first_inside(steps)])))
