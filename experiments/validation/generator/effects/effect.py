"""What an effect is: a name, its true parameters, and where along the way from motion to file it acts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from validation.generator.arms import Floats
from validation.generator.motion import Trajectory
from validation.generator.nominal_model import Belief
from validation.generator.world import World

Booleans = np.ndarray


@dataclass(frozen=True)
class Scene:
    """A log before any effect: belief, motion and what the sensor would read."""

    belief: Belief
    motion: Trajectory
    duration: float
    """s."""
    rate: float
    """Hz, of the wrench."""
    stamps: Floats
    """(T,) s, of the wrench, from 0."""
    world: World
    """As stated."""
    grid: Floats
    """(S,) s, finer than the log and longer on both sides."""
    nominal: Floats
    """(S, 6) N, Nm: the nominal world's wrench on the grid."""
    bias: Floats
    """(T, 6) N, Nm at the stamps; the sensor reads wrench - bias."""
    temperature: Callable[[Floats], Floats]
    """Times (T,) s -> deg C."""

    @property
    def span(self) -> Floats:
        """(6,) N, Nm: largest minus smallest nominal wrench."""
        return np.ptp(self.nominal, axis=0)


@dataclass(frozen=True)
class Draw:
    """A source of effect sizes at one level of severity. ``scale`` lets the caller ask again for more or less."""

    rng: np.random.Generator
    level: int
    """0 mild, 1 moderate, 2 strong."""
    scale: float = 1.0

    def size(self, *ranges: tuple[float, float]) -> float:
        """A size from the range of this level, times the scale."""
        return float(self.rng.uniform(*ranges[self.level])) * self.scale

    def sign(self) -> float:
        """-1 or 1."""
        return float(self.rng.choice([-1.0, 1.0]))

    def signs(self, n: int = 6) -> Floats:
        """(n,) of them."""
        return self.rng.choice([-1.0, 1.0], n)

    def direction(self) -> Floats:
        """(3,) unit vector, uniform on the sphere."""
        v = self.rng.normal(size=3)
        return v / np.linalg.norm(v)

    def stream(self) -> Callable[[], np.random.Generator]:
        """A function that gives the same fresh random stream at every call: hooks may run more than once."""
        seed = int(self.rng.integers(2**63))
        return lambda: np.random.default_rng(seed)


def _same(values: Any) -> Any:
    return values


@dataclass(frozen=True)
class Effect:
    """One reason why a log differs from its setup. Hooks default to doing nothing."""

    name: str
    form: str
    parameters: dict[str, Any]
    world: Callable[[World], World] = _same
    sensor: Callable[[Floats], Floats] = _same
    """Wrench on the scene's grid (S, 6) -> the same as the sensor's mechanics and electronics see it."""
    order: int = 0
    """Place among the ``sensor`` hooks."""
    clock: Callable[[Floats], Floats] = _same
    """Stamps (T,) s -> times at which the samples were really taken."""
    slow: Callable[[Floats], Floats] = field(default=lambda stamps: np.zeros((len(stamps), 6)))
    """Stamps (T,) -> (T, 6) N, Nm to be added to the bias."""
    noise: Callable[[Floats], Floats] = _same
    """Noise (T, 6) N, Nm -> noise."""
    reading: Callable[[Floats], Floats] = _same
    """Reading (T, 6) -> reading; NaN = lost."""
    keep: Callable[[Floats], Booleans] = field(default=lambda stamps: np.ones(len(stamps), bool))
    """Stamps (T,) -> (T,) whether the row is in the file."""


Builder = Callable[[str, Draw, Scene], Effect]
"""Functional form, sizes, scene -> the effect."""


def uneven(draw: Draw, size: float, torque_ratio: float = 0.06) -> Floats:
    """(6,) N, Nm: signed amplitudes around ``size`` N, the torques ``torque_ratio`` m times that."""
    return size * draw.rng.uniform(0.7, 1.3, 6) * draw.signs() * np.repeat([1.0, torque_ratio], 3)
