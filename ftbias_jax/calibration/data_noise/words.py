"""The variances that logs do determine, as sums of noise parameters in the words of a setup."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.model.params import Params
from ftbias_jax.model.wrench.data_noise import DataNoise, data_variance
from ftbias_jax.model.wrench.tool_wrench import reduced_observation_matrix
from ftbias_jax.types import AXES, AXIS_UNITS

_KEYS = {"density": "bias.noise_density", "wrench_std": "sensor.noise_std"}
_GROUPS = {
    (3, 1): ("",),
    (3, 3): ("[x]", "[y]", "[z]"),
    (6, 1): ("",),
    (6, 2): ("[force]", "[torque]"),
    (6, 6): tuple(f"[{axis}]" for axis in AXES),
    (36, 36): tuple(f"[{entry}]" for entry in range(36)),
}


def labels(name: str, lanes: np.ndarray) -> list[str]:
    """Names of the free values of one parameter, as in the setup.

    Args:
        name: such as ``linear_acceleration``.
        lanes: (N,) which free value, from 0, each of its numbers has.
    """
    return [_KEYS.get(name, f"data_noise.{name}") + group for group in _GROUPS[len(lanes), int(lanes.max()) + 1]]


class DeterminedSums(NamedTuple):
    """Sums of variances, with the standard errors of their square roots, relative; inf = not determined."""

    total: np.ndarray
    """(S, 6) N^2, Nm^2: diagonal of R for each tool."""
    total_stderr: np.ndarray
    force: np.ndarray
    """(3,) (m/s^2)^2 of a - g: linear acceleration and direction of gravity together; (0,) if entries were fitted."""
    force_stderr: np.ndarray


def sentences(tools: Sequence[Params], groups: dict[str, np.ndarray], sums: DeterminedSums) -> tuple[str, ...]:
    """One sentence for each sum that the data determine: what it is made of, and how large it is.

    Args:
        tools: of the fit.
        groups: which free value, from 0, each lane of each fitted part of Sigma_D has.
        sums: of the fit.
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
    """The sentence about one sum, if the data determine it."""
    std = float(np.sqrt(variance))
    return [f"{who}: {made_of} = s^2, s = {std:.4g} ± {stderr * std:.2g} {unit}"] if np.isfinite(stderr) else []


def _terms(params: Params, groups: dict[str, np.ndarray]) -> list[tuple[str, np.ndarray]]:
    """Monomials of the fitted parts of Sigma_D, and what one unit of each adds to R (6,)."""
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
        power = 4 if name == "angular_velocity" else 2
        words = _GROUPS[3, int(lanes.max()) + 1]
        alone = [unit(name, lanes == group) for group in range(len(words))]
        terms += [(f"{name}{word}^{power}", share) for word, share in zip(words, alone, strict=True)]
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
