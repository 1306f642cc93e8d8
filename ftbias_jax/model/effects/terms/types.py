"""Types of a term, of its form, and of the state of a log from which drives are computed."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np

from ftbias_jax.types import Array

FRAMES = ("base", "sensor", "joint", "none")
ACTS_AS = ("force", "torque", "wrench", "bias", "noise")


class State(NamedTuple):
    """One log as input of the drives; vectors in base axes, arrays of NumPy or of JAX."""

    t: Array
    """(T,) s since the first sample."""
    temperature: Array
    """(T,) deg C, without gaps."""
    q: Array
    """(T, n) rad."""
    dq: Array
    """(T, n) rad/s."""
    rotation: Array
    """(T, 3, 3) R_base_sensor."""
    position: Array
    """(T, 3) m, of the sensor's origin."""
    velocity: Array
    """(T, 3) m/s, of the sensor's origin."""
    acceleration: Array
    """(T, 3) m/s^2, of the sensor's origin, without gravity."""
    angular_velocity: Array
    """(T, 3) rad/s."""
    angular_acceleration: Array
    """(T, 3) rad/s^2."""
    gravity: Array
    """(3,) m/s^2, pointing down."""
    load: Array
    """(T, 6) N, Nm, sensor frame: the reading before the term acts."""
    axes: Array
    """(T, n, 3) unit axis of each joint; zero of a prismatic one."""
    counts: Array
    """(T,) number of samples that every reading is the mean of."""
    period: Array
    """() s between those samples."""


Numbers = dict[str, Array]
Make = Callable[[Any, State, Numbers], Array]
"""(numpy or jax.numpy, state at the term's point with the term's joint alone, parameters) -> the series."""


class Parameter(NamedTuple):
    """A parameter in which a form is nonlinear."""

    name: str
    unit: str
    least: float
    most: float
    several: bool = False
    """Whether it may be a list of ascending numbers."""


class Form(NamedTuple):
    """One form of a drive."""

    drive: str
    name: str
    kind: str
    """"scalars", "vectors" or "channels"."""
    unit: str
    """Unit of the series; a coefficient has N, Nm or, for the sensor's own channels, their unit per this unit."""
    make: Make
    parameters: tuple[Parameter, ...] = ()
    labels: tuple[str, ...] = ("",)
    """Name of each series, where there are several."""
    forgets: Callable[[Numbers], Array] | None = None
    """Parameters -> s, as ``Effect.forgets``; None = no memory, or one so slow that its start acts like a bias."""

    @property
    def series(self) -> int:
        """Number of series, S or V."""
        return len(self.labels)


@partial(
    jax.tree_util.register_dataclass,
    data_fields=("parameters", "point", "coefficients", "offset"),
    meta_fields=("drive", "form", "frame", "acts_as", "joint", "used"),
)
@dataclass(frozen=True)
class Term:
    """One drive that acts on the tool or on the sensor; a pytree whose numbers are leaves.

    The sum of ``coefficients`` times the columns of its form lowers the reading, as a force on the tool and a bias do.
    """

    drive: str
    form: str
    frame: str
    acts_as: str
    joint: int
    """Number of the joint, from 1; 0 = all joints, or a drive that refers to none."""
    used: tuple[int, ...]
    """Columns of the form that the coefficients belong to; () = all, in order."""
    parameters: dict[str, Array]
    """Parameters in which the form is nonlinear, such as a time constant, s; (N,) where there may be several."""
    point: Array
    """(3,) m, sensor frame: point at which a force acts, and whose motion drives it."""
    coefficients: Array
    """(K,), one per used column."""
    offset: Array = field(default_factory=lambda: np.zeros(6))
    """(6,) N, Nm: part of the change of the reading that is left to the bias."""
