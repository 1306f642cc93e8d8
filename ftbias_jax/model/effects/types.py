"""Definition of an effect: a name, its parameters, a pure function, and what to report to the robot's owner.

The nominal model is: joint states -> sensor kinematics -> wrench of the known tool. An effect is a parametric cause
of a different reading of a real sensor. Signs are those of the report: reading = D theta - b + noise.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp

from ftbias_jax.model.effects.fitting import SUDDEN, Coordinate, Fitting
from ftbias_jax.model.effects.statements import Statement
from ftbias_jax.model.kinematics.arm_batch import ArmMotion
from ftbias_jax.model.kinematics.recorded_pose import SensorPath, motions_of, path_of
from ftbias_jax.model.wrench.tool_wrench import Model as Model
from ftbias_jax.types import Array

EffectValues = dict[str, Array]
"""Parameters of one effect: name -> array of floats."""
Values = dict[str, EffectValues]
"""Parameters of several effects: effect -> parameters. A pytree: differentiate or map ``predict`` over it."""


_NO_COLUMNS: dict[str, Array] = {}


class Signals(NamedTuple):
    """The motion of one log and the model that turns it into a wrench."""

    t: Array
    """(T,) s since the first sample, never decreasing."""
    q: Array
    """(T, n) rad."""
    dq: Array
    """(T, n) rad/s."""
    ddq: Array
    """(T, n) rad/s^2."""
    temperature: Array
    """(T,) deg C, without gaps (``compose.fill_temperature``); any constant where it was not recorded."""
    model: Model
    motion: ArmMotion | None = None
    """Motion of the arm if it is already computed; effects get it by ``motion_of``."""
    columns: dict[str, Array] = _NO_COLUMNS
    """(T,) further quantities of the log by the names that [log.columns] of the setup gives them, without gaps. An
    effect that uses one states its name in ``Effect.needs``."""

    @property
    def path(self) -> SensorPath:
        """Path of the sensor: pose, velocities and accelerations (T, 3), base frame."""
        return path_of(motion_of(self))

    def in_sensor(self, vectors: Array) -> Array:
        """Vectors (T, 3) in base axes -> the same vectors in the sensor's axes."""
        return jnp.einsum("tji,tj->ti", self.path.rotation, vectors)

    def in_base(self, vectors: Array) -> Array:
        """Vectors (T, 3) in the sensor's axes -> the same vectors in base axes."""
        return jnp.einsum("tij,tj->ti", self.path.rotation, vectors)

    def push(self, force: Array, point: Array | float = 0.0) -> Array:
        """Change (T, 6) of the reading if the environment pushes the tool, because the sensor has less to hold.

        Args:
            force: (T, 3) N, force on the tool, base axes.
            point: (3,) m, point where it acts, sensor frame; 0 = at the sensor's origin.
        """
        force = self.in_sensor(force)
        torque = jnp.cross(jnp.broadcast_to(jnp.asarray(point, force.dtype), force.shape), force)
        return -jnp.concatenate([force, torque], 1)


def motion_of(signals: Signals) -> ArmMotion:
    """Motion of the arm, or of the body whose pose was recorded: the stored one if there is one, else computed now."""
    if signals.motion is not None:
        return signals.motion
    return motions_of(signals.model.arm, signals.q.T, signals.dq.T, signals.ddq.T)


class Record(NamedTuple):
    """A simulated recording, on its way from the sensing element to the file."""

    t: Array
    """(T,) s, the stamps."""
    wrench: Array
    """(T, 6) N, Nm, with bias and noise; NaN = no sample."""
    noise: Array
    """(T, 6) N, Nm, the white noise in ``wrench``."""
    dq: Array | None = None
    """(T, s) rad/s: speeds of ``speeds_of``, for noise that grows with them; None = at rest."""


Neutral = float | Array | Callable[[Model], Array]


class Parameter(NamedTuple):
    """One parameter of an effect."""

    name: str
    unit: str
    """Unit of each number; "N, Nm" for three forces and three torques."""
    meaning: str
    shape: tuple[int, ...] = ()
    """-1 for an axis of any length, the same in all parameters of the effect (the events of ``contact``)."""
    lower: float | Array = float("-inf")
    upper: float | Array = float("inf")
    """Smallest and largest allowed value, inclusive."""
    neutral: Neutral = 0.0
    """Value at which the effect does nothing; a function of the model if it is a quantity that the setup states."""
    scale: float | Array = 1.0
    """Typical departure from neutral, the standard deviation of a prior; 0 = not to be fitted."""
    search: bool = False
    """Not identifiable at zero magnitude (a time, a time constant, a threshold): use multiple starts."""
    optional: bool = False
    """May be left out of a setup, and is then neutral."""
    starts: tuple[Any, ...] = ()
    """Initial values of a search; () = spread over the bounds, or around neutral."""
    coordinate: Coordinate | None = None
    """Coordinate in which it is fitted; None = derived from the other fields (``diagnosis.regression.coordinates``)."""
    stated: str = ""
    """Key of [tool] that states the same quantity, with its standard error in KEY_std; "" = none does."""

    @property
    def is_vector(self) -> bool:
        """Whether it has a direction in space."""
        return self.shape == (3,)


def within(
    shape: tuple[int, ...], lower: float | Array, upper: float | Array, neutral: Neutral, scale: Any, **more: Any
) -> dict[str, Any]:
    """Keywords of a ``Parameter``: shape, bounds, neutral value and typical departure, as (3,) from -10 m to 10 m."""
    return {"shape": shape, "lower": lower, "upper": upper, "neutral": neutral, "scale": scale, **more}


class Twin(NamedTuple):
    """Another effect that the data cannot always distinguish from this one."""

    effect: str
    """Name of the other effect, or "none" for an unobservable effect."""
    exact: bool
    """Whether no motion distinguishes them in the case that ``separate_by`` names."""
    separate_by: str
    """The measurement that would distinguish them, or the case in which none does."""


Transform = Callable[[EffectValues, Signals], Signals]
"""Changes the model or the motion the model sees."""
Reading = Callable[[EffectValues, Signals, Array], Array]
"""Changes the noise-free reading (T, 6)."""
Recording = Callable[[EffectValues, Array, Record], Record]
"""Changes recorded samples; the array is a JAX key."""
Screen = Callable[[EffectValues, Array], Array]
"""(T, 6) recorded wrench -> the same with NaN where a sample is not informative."""
Widen = Callable[[EffectValues, Array, Array], Array]
"""(T, 6) noise variance, (T, 6) rate of the reading -> (T, 6) noise variance with the effect."""


class Effect(NamedTuple):
    """One entry of the catalogue, with either ``recording``, or one or both of ``transform`` and ``reading``."""

    name: str
    stage: str
    """tool, kinematics, sensor, bias, environment or timing."""
    parameters: tuple[Parameter, ...]
    explanation: str
    """One line: what differs from the setup."""
    remedy: str
    """One line: what the owner can do about it."""
    transform: Transform | None = None
    reading: Reading | None = None
    recording: Recording | None = None
    screen: Screen | None = None
    """For a recording effect that destroys samples: marks those that a filter should not use."""
    widen: Widen | None = None
    """For a recording effect that acts like noise: the noise variance with the effect."""
    twins: tuple[Twin, ...] = ()
    forgets: Callable[[EffectValues], Array] | None = None
    """Time constant, s, with which it forgets its initial state: a log does not show what went on before."""
    check: Callable[[EffectValues], str] | None = None
    """Fault of values that are within their bounds, in words; "" = none."""
    filter_noise: str = ""
    """Field of ``params.BiasNoise`` that holds the first parameter of a recording effect that the filter models as
    noise: one row of values per joint, or one for all of them. Further parameters are in fields FIELD_PARAMETER."""
    needs: tuple[str, ...] = ()
    """Columns a log must have for the effect to be observable, beyond t, q and wrench."""
    needs_motion: str = ""
    """What must be recorded of the motion: "joints" of an arm, or "acceleration" of the sensor; "" = any will do."""
    fit: Fitting = Fitting()
    """How a diagnosis finds and judges it."""
    statement: Statement | None = None
    """Sentence that reports the effect when it was found; None = the explanation and its first parameter."""

    @property
    def goes_by_clock(self) -> bool:
        """Whether it is an event or a time course of the bias in one log, independent of motion and columns."""
        return isinstance(self.fit.search, SUDDEN) or (self.stage == "bias" and not self.needs)

    @property
    def hook(self) -> str:
        """Where it acts: "model", "wrench" or "record"."""
        return "model" if self.transform else "wrench" if self.reading else "record"

    @property
    def tool_keys(self) -> tuple[str, ...]:
        """Keys of [tool] that state its parameters, in their order; () = not all of them are stated there."""
        keys = tuple(parameter.stated for parameter in self.parameters)
        return keys if all(keys) else ()

    def parameter(self, name: str) -> Parameter:
        """The parameter of that name."""
        return next(parameter for parameter in self.parameters if parameter.name == name)
