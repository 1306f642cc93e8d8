"""What a term and its form are, and what of a log its drive may be."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax

from ftbias_jax.types import Array

FRAMES = ("base", "sensor", "joint", "none")
ACTS_AS = ("force", "torque", "wrench", "bias", "noise")


class State(NamedTuple):
    """One log as the drives see it; vectors in base axes. Arrays of NumPy or of JAX."""

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
    """(T,) how many samples every reading is the mean of."""
    period: Array
    """() s between those samples."""


Numbers = dict[str, Array]
Make = Callable[[Any, State, Numbers], Array]
"""(numpy or jax.numpy, state at the term's point with the term's joint alone, parameters) -> the series."""


class Parameter(NamedTuple):
    """A number of a form in which it is not linear."""

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
    """Of the series; a coefficient has N, Nm or, of the sensor's own channels, their unit per this."""
    make: Make
    parameters: tuple[Parameter, ...] = ()
    labels: tuple[str, ...] = ("",)
    """What each series is, where there are several."""
    forgets: Callable[[Numbers], Array] | None = None
    """s by the parameters, as ``Effect.forgets``; None = no memory, or one so slow that its start is like a bias."""

    @property
    def series(self) -> int:
        """S or V, how many series there are."""
        return len(self.labels)


@partial(
    jax.tree_util.register_dataclass,
    data_fields=("parameters", "point", "coefficients"),
    meta_fields=("drive", "form", "frame", "acts_as", "joint", "used"),
)
@dataclass(frozen=True)
class Term:
    """One drive that acts on the tool or on the sensor; a pytree whose numbers are leaves.

    What it makes of the tool, ``coefficients`` times the columns of its form, lowers the reading, as a force on the
    tool and a bias do.
    """

    drive: str
    form: str
    frame: str
    acts_as: str
    joint: int
    """From 1; 0 = all joints, or a drive that speaks of none."""
    used: tuple[int, ...]
    """Columns of the form that the coefficients belong to; () = all, in order."""
    parameters: dict[str, Array]
    """Numbers of the form in which it is not linear, such as a time constant, s; (N,) where there may be several."""
    point: Array
    """(3,) m, sensor frame: where a force acts, and where the motion is taken."""
    coefficients: Array
    """(K,)."""
