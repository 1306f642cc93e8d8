"""What a motion determines of a tool, judged by the log itself: by the scatter over blocks, and by held-out blocks.

Innovations of recorded logs are neither white nor of the stated size: they contain vibration, delays and contact. The
scores of whole blocks show by how much the stated noise overstates the log's information, and a fit without a block
shows whether its result also holds there.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from ftbias_jax.calibration.tool.physical import (
    COORDINATE,
    FIXED,
    NAMES,
    OF_INERTIA,
    Quadratic,
    coordinates,
    data_sheet,
    jacobian_of_physical,
    most_likely,
    parameters_at,
    theta_of,
    tool_units,
    total,
)
from ftbias_jax.filtering.innovation_regression import BLOCK_SECONDS, Linear, Prior

FEWEST_BLOCKS, MOST_BLOCKS = 8, 16
LEAST_KNOWN = 0.5
"""A parameter is determined if its standard error is below this share of what a tool of size RADIUS could have."""
STANDARD_ERRORS = 2.0
"""Standard errors by which a fit must predict held-out blocks better, or more of them, than the stated values."""


class Shown(NamedTuple):
    """A tool fitted as far as a log determines it."""

    x: np.ndarray
    """(P,) coordinates."""
    prior: Prior
    """Prior that holds fixed what is kept."""
    dispersion: float
    """Factor by which the stated noise overstates the log's information."""
    kept: tuple[str, ...]
    """Names of parameters that this motion does not determine at all."""
    poor: tuple[str, ...]
    """Names of parameters that this motion does not determine separately, with the others unknown."""
    inertia: bool
    """Whether the log determines the inertia: predicts held-out blocks better than with the stated one."""
    gain: tuple[float, float]
    """nats that the fitted inertia gains on held-out blocks, and its standard error."""


def block_of(t: np.ndarray) -> np.ndarray:
    """Index of the block of each sample, FEWEST_BLOCKS to MOST_BLOCKS of equal length; t (T,) s begins at 0."""
    count = int(np.clip(t[-1] / BLOCK_SECONDS, FEWEST_BLOCKS, MOST_BLOCKS))
    return np.minimum(t / t[-1] * count, count - 1).astype(int)


def in_blocks(linear: Linear, dt: np.ndarray) -> list[Quadratic]:
    """The cost of a linearised model, block by block of the log; dt (T,) s."""
    block, parts = block_of(np.cumsum(dt)), []
    for k in range(block[-1] + 1):
        columns, residual = linear.columns[:, block == k].reshape(len(linear.at), -1), linear.residual[block == k]
        pull, information = columns @ residual.ravel(), columns @ columns.T
        parts.append(Quadratic(linear.at, pull, information, float((residual**2).sum() / 2)))
    return parts


def judge(parts: list[Quadratic], x: np.ndarray, prior: Prior, inertia: np.ndarray) -> Shown:
    """Fit the tool, from coordinates x (P,), as far as its log, in blocks, determines it.

    If the log does not determine the inertia, the stated one is kept: (6,) kg m^2, about the centre of mass.
    """
    cost = total(parts)
    x = most_likely(cost, x, prior)
    dispersion = overdispersion(parts, x, prior)
    tempered = cost.scaled(1 / dispersion)
    x = most_likely(tempered, x, prior)
    units = tool_units(parameters_at(x)[0])
    kept, poor = (undetermined(tempered.information, units, alone=alone) for alone in (True, False))
    prior = fixed(prior, [COORDINATE[name] for name in kept if name in COORDINATE])
    free = most_likely(tempered, x, prior)
    stated, with_stated = _keeping(inertia, tempered, free, prior)
    gains = []
    for part, rest in _left_out(parts, dispersion):
        without = part(_with_inertia(inertia, _keeping(inertia, rest, stated, prior)[0]))
        gains.append((without - part(parameters_at(most_likely(rest, free, prior)))) / dispersion)
    gain = _with_error(gains)
    if _is_sure(gains):
        return Shown(free, prior, dispersion, kept, poor, True, gain)
    return Shown(stated, with_stated, dispersion, kept, poor, False, gain)


def predicts_unseen(parts: list[Quadratic], found: Shown, rows: slice) -> bool:
    """Whether fitted coordinates predict held-out blocks of a log better than their prior mean does."""
    held, gains = fixed(found.prior, range(*rows.indices(len(found.x)))), []
    for part, rest in _left_out(parts, found.dispersion):
        without, free = (part(parameters_at(most_likely(rest, found.x, prior))) for prior in (held, found.prior))
        gains.append((without - free) / found.dispersion)
    return _is_sure(gains)


def _left_out(parts: list[Quadratic], dispersion: float) -> Iterator[tuple[Quadratic, Quadratic]]:
    """Each block, and the cost of all others divided by the overdispersion."""
    for part in parts:
        yield part, total([other for other in parts if other is not part]).scaled(1 / dispersion)


def _with_error(gains: list[float]) -> tuple[float, float]:
    """nats gained over all blocks, and their standard error."""
    return float(np.sum(gains)), float(np.std(gains) * np.sqrt(len(gains)))


def _is_sure(gains: list[float]) -> bool:
    """Whether held-out blocks gain beyond chance, in sum or in number: one block of fast motion may have most of it."""
    gain, error = _with_error(gains)
    surplus = 2 * np.sum(np.greater(gains, 0)) - len(gains)
    return bool(gain > 0 and (gain > STANDARD_ERRORS * error or surplus > STANDARD_ERRORS * np.sqrt(len(gains))))


def overdispersion(parts: list[Quadratic], x: np.ndarray, prior: Prior) -> float:
    """Factor by which scores of whole blocks have more variance than white noise of the stated size would; 1 or more.

    Near the optimum x (P,); directions in which the log is less informative than the prior are left out.
    """
    slope = jacobian_of_physical(x) * prior.std
    normal = slope.T @ total(parts).information @ slope
    strength, directions = np.linalg.eigh(normal)
    move = parameters_at(x) - parts[0].at
    scores = np.stack([part.pull + part.information @ move for part in parts]) @ slope @ directions
    known = strength > 1.0
    if not known.any():
        return 1.0
    scatter = scores.var(0)[known] * len(parts) ** 2 / (len(parts) - 1)
    return float(max(1.0, np.mean(scatter / strength[known])))


def undetermined(information: np.ndarray, units: np.ndarray, alone: bool = False) -> tuple[str, ...]:
    """Names of the parameters whose standard error is larger than LEAST_KNOWN of their unit.

    Args:
        information: (P, P) information on theta (10,), and maybe more, for noise of the size it has.
        units: (10,) as returned by ``tool_units``; or (4,), if the inertia is known.
        alone: as if all other parameters were known, so that only those are named of which there is no information.
    """
    count = len(units)
    information = information[:count, :count] * units[:, None] * units
    if alone:
        variance = 1 / np.maximum(np.diag(information), 1e-12)
    else:
        strength, directions = np.linalg.eigh(information)
        variance = (directions**2 / np.maximum(strength, 1e-12 * strength[-1])).sum(1)
    return tuple(name for name, spread in zip(NAMES, variance, strict=False) if spread > LEAST_KNOWN**2)


def condition(information: np.ndarray, units: np.ndarray) -> float:
    """Condition number of a log's own information on theta, in units of this mass and of size RADIUS."""
    count = len(units)
    strength = np.linalg.eigvalsh(information[:count, :count] * units[:, None] * units)
    return float(np.sqrt(strength[-1] / max(strength[0], 1e-12 * strength[-1])))


def fixed(prior: Prior, rows: Iterable[int]) -> Prior:
    """The prior with these coordinates held fixed at its mean."""
    std = prior.std.copy()
    std[list(rows)] = FIXED
    return Prior(prior.mean.copy(), std)


def _keeping(inertia: np.ndarray, cost: Quadratic, x: np.ndarray, prior: Prior) -> tuple[np.ndarray, Prior]:
    """The most likely coordinates with this inertia, in kg m^2 and not per kg of mass, and the prior that fixes it."""
    held = fixed(prior, range(*OF_INERTIA.indices(len(x))))
    for _ in range(2):  # the mass hardly depends on the inertia
        held.mean[OF_INERTIA] = coordinates(jnp.asarray(_with_inertia(inertia, x)[:10]))[OF_INERTIA]
        x = most_likely(cost, x, held)
    return x, held


def _with_inertia(inertia: np.ndarray, x: np.ndarray) -> np.ndarray:
    """(P,) parameters at coordinates (P,), but with this inertia about the centre of mass, (6,) kg m^2."""
    z = parameters_at(x)
    sheet = np.concatenate([np.asarray(data_sheet(jnp.asarray(z[:10])))[:4], inertia])
    return np.concatenate([theta_of(sheet), z[10:]])
