"""Noise that logs leave undetermined, and the sums of variances that they do determine, in terms of a setup's keys."""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.calibration.newton import UNDETERMINED
from ftbias_jax.calibration.noise.values import JOINT_NAMES, VIBRATION, key_of, power
from ftbias_jax.model.params import Params
from ftbias_jax.model.wrench.tool_wrench import DataNoise, data_variance, reduced_observation_matrix
from ftbias_jax.types import AXES, AXIS_UNITS

_GROUPS = {
    (3, 1): ("",),
    (3, 3): ("[x]", "[y]", "[z]"),
    (6, 1): ("",),
    (6, 2): ("[force]", "[torque]"),
    (6, 6): tuple(f"[{axis}]" for axis in AXES),
}


def labels(name: str, lanes: np.ndarray) -> list[str]:
    """Names of a parameter's free values, as in the setup; ``lanes`` (N,): free value of each entry, -1 = none."""
    count, key = len(np.unique(lanes[lanes >= 0])), key_of(name)
    if name == VIBRATION:
        return [f"{key}[joint {i // 6 + 1} {AXES[i % 6]}]" for i in np.flatnonzero(lanes >= 0)]
    if name in JOINT_NAMES or (len(lanes), count) not in _GROUPS:
        return [f"{key}[{i}]" for i in range(count)] if count > 1 else [key]
    return [key + group for group in _GROUPS[len(lanes), count]]


def combination_errors(information: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(...) standard errors of combinations (..., P) of the logarithms; undetermined ones count with an error of 1."""
    strength, directions = np.linalg.eigh(information)
    return np.sqrt(((weights @ directions) ** 2 / np.maximum(strength, UNDETERMINED**-2)).sum(-1))


def open_directions(information: np.ndarray, names: Sequence[str]) -> list[str]:
    """Parameters undetermined by more than a factor e: first those that others can compensate, then single ones."""
    strength, directions = np.linalg.eigh(information)
    space = directions[:, strength <= UNDETERMINED**-2]  # (P, d)
    pivots = _pivots(space)
    moves = space @ np.linalg.inv(space[pivots]) if pivots else space  # a pivot moves by 1, the other pivots stay
    together, alone = [], []
    for pivot, move in zip(pivots, moves.T, strict=True):
        partners = [name for name, shift in zip(names, move, strict=True) if abs(shift) > 0.01 and name != names[pivot]]
        if partners:
            together.append(f"{names[pivot]} only together with {', '.join(partners)}")
        else:
            alone.append(names[pivot])
    return together + ([f"{', '.join(alone)} (not distinguishable from zero)"] if alone else [])


def _pivots(space: np.ndarray) -> list[int]:
    """Indices of d of P coordinates that parametrise a d-dimensional subspace: the first ones that it moves enough."""
    rest, pivots = space.copy(), []
    for _ in range(space.shape[1]):
        moved = (rest**2).sum(1)
        pivot = int(np.argmax(moved > 0.01 * moved.max()))
        pivots.append(pivot)
        row = rest[pivot] / np.linalg.norm(rest[pivot])
        rest = rest - np.outer(rest @ row, row)
    return pivots


class DeterminedSums(NamedTuple):
    """Sums of variances, with the relative standard errors of their square roots; inf = not determined."""

    total: np.ndarray
    """(S, 6) N^2, Nm^2: diagonal of R for each of S tools."""
    total_stderr: np.ndarray
    force: np.ndarray
    """(3,) (m/s^2)^2: variance of a - g, from linear_acceleration and gravity_direction; (0,) with fitted entries."""
    force_stderr: np.ndarray


def sentences(tools: Sequence[Params], groups: dict[str, np.ndarray], sums: DeterminedSums) -> tuple[str, ...]:
    """One sentence for each sum that the data determine, with its terms and its value.

    ``groups`` has, for each fitted part of Sigma_D, the index of the free value of each lane, counted from 0.
    """
    said = []
    if len(sums.force):
        lanes = groups["linear_acceleration"]
        g2 = float(tools[0].gravity @ tools[0].gravity)
        for group, word in enumerate(_GROUPS[3, int(lanes.max()) + 1]):
            first = int(np.argmax(lanes == group))
            made_of = f"linear_acceleration{word}^2 + {g2:.3g} gravity_direction{word}^2"
            said += _sentence(f"a - g{word}", made_of, sums.force[first], sums.force_stderr[first], "m/s^2")
    for number, (params, totals, errors) in enumerate(zip(tools, sums.total, sums.total_stderr, strict=True), 1):
        terms = _terms(params, groups)
        for axis, name in enumerate(AXES):
            parts = [f"{share[axis]:.3g} {words}" for words, share in terms if share[axis] > 0]
            made_of = " + ".join([f"sensor.noise_std[{name}]^2", *parts])
            who = name if len(tools) == 1 else f"tool {number} {name}"
            said += _sentence(who, made_of, totals[axis], errors[axis], AXIS_UNITS[axis])
    return tuple(said)


def _sentence(who: str, made_of: str, variance: float, stderr: float, unit: str) -> list[str]:
    std = float(np.sqrt(variance))
    return [f"{who}: {made_of} = s^2, s = {std:.4g} ± {stderr * std:.2g} {unit}"] if np.isfinite(stderr) else []


def _terms(params: Params, groups: dict[str, np.ndarray]) -> list[tuple[str, np.ndarray]]:
    """Monomials of the fitted parts of Sigma_D, and the variance (6,) that one unit of each adds to R."""
    weight = np.asarray(reduced_observation_matrix(params.theta)) ** 2
    if "entries" in groups:
        return [(f"entries[{entry}]^2", weight[:, entry]) for entry in range(36)]
    shapes = {name: jnp.zeros(3) for name in DataNoise._fields}
    variance = jax.jit(data_variance)

    def unit(name: str, lanes: np.ndarray) -> np.ndarray:
        switched = DataNoise(**shapes | {name: jnp.asarray(lanes, float)})
        return np.asarray(weight @ np.asarray(variance(switched, params.gravity)))

    terms = []
    for name, lanes in groups.items():
        words = _GROUPS[3, int(lanes.max()) + 1]
        alone = [unit(name, lanes == group) for group in range(len(words))]
        terms += [(f"{name}{word}^{power(name):g}", share) for word, share in zip(words, alone, strict=True)]
        if name == "angular_velocity":  # products of two rates
            terms += [
                (
                    f"{name}{words[i]}^2 {name}{words[j]}^2",
                    unit(name, (lanes == i) | (lanes == j)) - alone[i] - alone[j],
                )
                for i in range(len(words))
                for j in range(i)
            ]
    return terms
