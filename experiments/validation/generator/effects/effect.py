"""Effects of the generator: a name, true parameters, and hooks at the steps from the motion to the log file."""

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
    """A log before any effect: nominal model, motion and ideal reading."""

    belief: Belief
    motion: Trajectory
    duration: float
    """s."""
    rate: float
    """Hz, rate of the wrench."""
    stamps: Floats
    """(T,) s, stamps of the wrench from 0."""
    world: World
    """World of the nominal model."""
    grid: Floats
    """(S,) s, finer than the log and extended on both sides."""
    nominal: Floats
    """(S, 6) N, Nm, wrench of the nominal world on the grid."""
    bias: Floats
    """(T, 6) N, Nm, bias at the stamps; the sensor reads wrench - bias."""
    temperature: Callable[[Floats], Floats]
    """Times (T,) s -> deg C."""

    @property
    def span(self) -> Floats:
        """(6,) N, Nm: largest minus smallest nominal wrench per channel."""
        return np.ptp(self.nominal, axis=0)


@dataclass(frozen=True)
class Draw:
    """Source of effect sizes at one level of severity; ``scale`` multiplies them if a draw has to be repeated."""

    rng: np.random.Generator
    level: int
    """0 = mild, 1 = moderate, 2 = strong."""
    scale: float = 1.0

    def size(self, *ranges: tuple[float, float]) -> float:
        """Draw a size from the range of this level, times the scale."""
        return float(self.rng.uniform(*ranges[self.level])) * self.scale

    def sign(self) -> float:
        """Draw -1 or 1."""
        return float(self.rng.choice([-1.0, 1.0]))

    def signs(self, n: int = 6) -> Floats:
        """Draw (n,) signs, -1 or 1."""
        return self.rng.choice([-1.0, 1.0], n)

    def direction(self) -> Floats:
        """Draw a unit vector (3,), uniform on the sphere."""
        v = self.rng.normal(size=3)
        return v / np.linalg.norm(v)

    def stream(self) -> Callable[[], np.random.Generator]:
        """Return a function that restarts one random stream at every call, because hooks may run more than once."""
        seed = int(self.rng.integers(2**63))
        return lambda: np.random.default_rng(seed)


def _same(values: Any) -> Any:
    return values


@dataclass(frozen=True)
class Effect:
    """One reason why a log differs from its setup; the default of every hook does nothing."""

    name: str
    form: str
    parameters: dict[str, Any]
    world: Callable[[World], World] = _same
    sensor: Callable[[Floats], Floats] = _same
    """Wrench (S, 6) on the scene's grid -> the wrench as the sensor's mechanics and electronics measure it."""
    order: int = 0
    """Position in the order of the ``sensor`` hooks."""
    clock: Callable[[Floats], Floats] = _same
    """Stamps (T,) s -> times (T,) s at which the samples were actually taken."""
    slow: Callable[[Floats], Floats] = field(default=lambda stamps: np.zeros((len(stamps), 6)))
    """Stamps (T,) s -> change (T, 6) N, Nm of the bias."""
    noise: Callable[[Floats], Floats] = _same
    """Noise (T, 6) N, Nm -> noise with the effect."""
    reading: Callable[[Floats], Floats] = _same
    """Reading (T, 6) N, Nm -> reading with the effect; NaN = lost."""
    keep: Callable[[Floats], Booleans] = field(default=lambda stamps: np.ones(len(stamps), bool))
    """Stamps (T,) s -> (T,) whether the row is written to the file."""


Builder = Callable[[str, Draw, Scene], Effect]
"""Functional form, source of sizes, scene -> the effect."""


def uneven(draw: Draw, size: float, torque_ratio: float = 0.06) -> Floats:
    """Draw signed amplitudes (6,): forces around ``size`` N, torques around ``torque_ratio`` m times that."""
    return size * draw.rng.uniform(0.7, 1.3, 6) * draw.signs() * np.repeat([1.0, torque_ratio], 3)
