"""How each drive may act: the table of forms.

A form gives scalars (T, S), which act along three axes or on six channels; or vectors (T, V, 3) in base axes, which
act along themselves; or (T, 6) for channels that act on themselves.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from ftbias_jax.model.effects.terms import series, slow_series
from ftbias_jax.model.effects.terms.memory import swing_forgets
from ftbias_jax.model.effects.terms.series import Make, Numbers
from ftbias_jax.types import Array


class Parameter(NamedTuple):
    """A number of a form in which it is not linear."""

    name: str
    unit: str
    least: float
    most: float


class Form(NamedTuple):
    """One form of a drive."""

    drive: str
    name: str
    kind: str
    """"scalars", "vectors" or "channels"."""
    make: Make
    unit: str
    """Of the series; a coefficient has N, Nm or, of the sensor's own channels, their unit per this."""
    parameters: tuple[Parameter, ...] = ()
    labels: tuple[str, ...] = ("",)
    """What each series is, where there are several."""

    forgets: Callable[[Numbers], Array] | None = None
    """s by the parameters, as ``Effect.forgets``; None = no memory, or one so slow that its start is like a bias."""

    @property
    def series(self) -> int:
        """S or V, how many series there are."""
        return len(self.labels)


TAU = Parameter("time_constant", "s", 0.1, 1e5)
LAG = Parameter("lag", "s", 0.0, 1e4)
REFERENCE = Parameter("reference", "deg C", -100.0, 300.0)
TIME = Parameter("time", "s", 0.0, 1e7)
FREQUENCY = Parameter("frequency", "Hz", 1e-4, 1e4)
SPEED = Parameter("speed", "m/s", 1e-3, 2.0)
TURN = Parameter("speed", "rad/s", 1e-3, 5.0)
PLACE = tuple(Parameter(axis, "m", -10.0, 10.0) for axis in "xyz")
NORMAL = tuple(Parameter(axis, "1", -1.5, 1.5) for axis in "xyz")
LENGTH = Parameter("length", "m", 0.005, 5.0)
FIELD = (*PLACE, Parameter("power", "1", 0.2, 8.0), Parameter("core", "m", 0.0, 1.0))
PLANE = (*NORMAL, Parameter("offset", "m", -10, 10), LENGTH)

LATE = ("late", "difference")
SQUARED = ("linear", "squared")
WAVES = ("sin", "cos")
MAP = ("x", "y", "z", "xx_yy", "zz", "xy", "xz", "yz", "size_x", "size_y", "size_z")

FORMS = {
    (form.drive, form.name): form
    for form in (
        Form("constant", "steady", "scalars", slow_series.ones, "1"),
        Form("time", "exponential", "scalars", slow_series.exponential, "1", (TAU,), labels=("offset", "decaying")),
        Form("time", "linear", "scalars", slow_series.linear_in_time, "s"),
        Form("time", "step", "scalars", slow_series.step, "1", (TIME,)),
        Form("time", "wave", "scalars", slow_series.wave, "1", (FREQUENCY,), labels=WAVES),
        Form("time", "quadratic", "scalars", slow_series.powers_of_time, "s", labels=("t", "t2")),
        Form("temperature", "linear", "scalars", slow_series.temperature, "K", (LAG,)),
        Form("temperature", "quadratic", "scalars", slow_series.temperature_squared, "K", (LAG,), labels=SQUARED),
        Form("temperature", "gradient", "scalars", slow_series.warming_side, "K", (LAG,), labels=LATE),
        Form("temperature", "sensitivity", "channels", slow_series.sensitivity, "K", (LAG,)),
        Form("temperature", "calibrated", "channels", slow_series.calibrated, "K", (LAG, REFERENCE)),
        Form("temperature", "compensated", "channels", slow_series.compensated, "K^2", (LAG, REFERENCE)),
        Form("position", "spring", "vectors", series.spring, "m", labels=("stiffness", "x", "y", "z")),
        Form("position", "attraction", "vectors", series.attraction, "1", FIELD),
        Form("position", "barrier", "scalars", series.barrier, "m", PLANE),
        Form("position", "linear", "scalars", series.place, "m", labels=tuple("xyz")),
        Form(
            "position",
            "quadratic",
            "scalars",
            series.place_squared,
            "m",
            labels=("x", "y", "z", "xx", "yy", "zz", "xy", "xz", "yz"),
        ),
        Form("orientation", "linear", "scalars", series.gravity, "1", labels=tuple("xyz")),
        Form("orientation", "map", "scalars", series.gravity_map, "1", labels=MAP),
        Form("orientation", "field", "scalars", series.field_map, "1", NORMAL, labels=MAP),
        Form("velocity", "linear", "vectors", series.along("velocity", 1), "m/s"),
        Form("velocity", "quadratic", "vectors", series.along("velocity", 2), "(m/s)^2"),
        Form("velocity", "cubic", "vectors", series.along("velocity", 3), "(m/s)^3"),
        Form("velocity", "coulomb", "vectors", series.dry("velocity"), "1", (SPEED,)),
        Form("angular_velocity", "linear", "vectors", series.along("angular_velocity", 1), "rad/s"),
        Form(
            "angular_velocity",
            "quadratic",
            "vectors",
            series.along("angular_velocity", 2),
            "(rad/s)^2",
        ),
        Form(
            "angular_velocity",
            "coulomb",
            "vectors",
            series.dry("angular_velocity"),
            "1",
            (TURN,),
        ),
        Form("angular_velocity", "gyroscopic", "vectors", series.gyroscopic, "rad/s", labels=tuple("xyz")),
        Form("acceleration", "linear", "vectors", series.along("acceleration", 1), "m/s^2"),
        Form(
            "acceleration",
            "swing",
            "vectors",
            series.swinging,
            "m/s^2",
            (Parameter("frequency", "Hz", 0.05, 30.0), Parameter("damping_ratio", "1", 0.001, 0.95)),
            forgets=lambda p: swing_forgets(p["frequency"], p["damping_ratio"]),
        ),
        Form("acceleration", "trailing", "vectors", series.trailing, "m/s^2", (LAG,), forgets=lambda p: p["lag"]),
        Form("acceleration", "turning", "vectors", series.along("angular_acceleration", 1), "rad/s^2"),
        Form("joint_angle", "linear", "scalars", series.angle, "rad"),
        Form("joint_angle", "cubic", "scalars", series.angle_squared, "rad", labels=("q", "q2", "q3")),
        Form(
            "joint_angle",
            "harmonic",
            "scalars",
            series.harmonic,
            "1",
            (Parameter("multiple", "1", 0.3, 200.0),),
            labels=WAVES,
        ),
        Form("joint_velocity", "viscous", "scalars", series.viscous, "rad/s"),
        Form("joint_velocity", "friction", "scalars", series.friction, "1", (TURN,)),
        Form("joint_velocity", "quadratic", "scalars", series.squared_speed, "(rad/s)^2"),
        Form("joint_velocity", "heat", "scalars", series.heat, "rad^2/s", (TAU,)),
        Form("load", "square", "channels", slow_series.load_squared, "N, Nm"),
        Form("load", "signed_square", "channels", slow_series.load_signed, "N, Nm"),
        Form("load", "cube", "channels", slow_series.load_cubed, "N^2, Nm^2"),
        Form("load", "size", "channels", slow_series.load_size, "1"),
        Form("load_time", "linear", "channels", slow_series.load_in_time, "s"),
        Form("load_time", "exponential", "channels", slow_series.load_settling, "1", (TAU,)),
        Form("load_time", "wave", "channels", slow_series.load_wave, "1", (FREQUENCY,)),
        Form("load_time", "step", "channels", slow_series.load_step, "1", (TIME,)),
        Form("noise", "load", "channels", slow_series.noise_of_load, "N^2, Nm^2"),
        Form("noise", "force", "channels", slow_series.noise_of_force, "N^2"),
        Form("noise", "time", "channels", slow_series.noise_of_time, "s"),
        Form("noise", "acceleration", "channels", slow_series.noise_of_acceleration, "(m/s^2)^2"),
        Form("noise", "speed", "channels", slow_series.noise_of_speed, "(m/s)^2"),
        Form("noise", "joints", "channels", slow_series.noise_of_joints, "(rad/s)^2"),
        Form("frequency", "line", "scalars", slow_series.line, "1", (FREQUENCY,), labels=WAVES),
    )
}
"""(drive, form) -> how its series is made."""
