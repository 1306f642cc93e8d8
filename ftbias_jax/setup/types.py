"""The setup, as stated by the robot's owner, in frozen dataclasses of read-only float64 arrays.

Equality is identity, because arrays do not compare to one truth value.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ftbias_jax.setup.fields import read_only
from ftbias_jax.setup.recorded import LogSetup, PoseSetup
from ftbias_jax.types import Array

REPORTS = ("wrench_on_tool", "wrench_on_sensor")
COMPENSATED = ("none", "weight", "tool")
JOINT_MODELS = ("integrated_jerk", "integrated_acceleration", "acceleration")
SCREWS = "screws"
"""``RobotSetup.model`` of a robot that is not built in."""
DATA_NOISE_UNITS = {
    "linear_acceleration": "m/s^2",
    "angular_acceleration": "rad/s^2",
    "angular_velocity": "rad/s",
    "gravity_direction": "rad",
}
"""The four physical numbers of [data_noise] and their units."""


@dataclass(frozen=True, eq=False)
class RobotSetup:
    """A serial arm and the gravity that acts on it."""

    screws: Array
    """(n, 6) screw axes at q = 0, base frame, (linear; angular): (-s x r; s) if revolute, (d; 0) if prismatic."""
    joint_names: tuple[str, ...]
    """n names, in the order of the screws."""
    flange_translation: Array
    """(3,) m, flange origin at q = 0, base frame."""
    flange_rotation: Array
    """(3, 3) flange frame at q = 0 in the base frame: R v_flange = v_base."""
    gravity: Array
    """(3,) m/s^2, base frame, pointing down."""
    model: str = SCREWS
    """Name of a built-in robot, or "screws"."""
    position_limits: Array | None = None
    """(n, 2) rad (m), the ends of each joint's travel, infinite if it turns without end; None = not stated."""
    velocity_limits: Array | None = None
    """(n,) rad/s (m/s), the largest speed of each joint; None = not stated."""
    name: str | None = None
    """Which robot of a fleet it is; None = not stated."""
    site: str = ""
    """Site of the sensor in the MJCF, as the setup states it; "" = not stated."""
    base_link: str = ""
    """Body of the MJCF whose frame is the base frame, as the setup states it; "" = the world."""
    urdf_links: tuple[str, str] | None = None
    """Base and flange links in the URDF; None = the arm is not from a URDF."""

    @property
    def revolute(self) -> Array:
        """(n,) whether a joint turns; the others are prismatic."""
        turns: Array = self.screws[:, 3:].any(1)
        return turns


@dataclass(frozen=True, eq=False)
class SensorSetup:
    """The force-torque sensor and how it is mounted."""

    translation: Array
    """(3,) m, sensor origin in the flange frame."""
    rotation: Array
    """(3, 3) sensor frame in the flange frame: R v_sensor = v_flange."""
    noise_std: Array
    """(6,) N and Nm, standard deviation of one sample."""
    reports: str = "wrench_on_tool"
    """One of REPORTS. The readers of logs flip the sign of "wrench_on_sensor"; later stages ignore it."""
    correlated_std: Array | None = None
    """(6,) N and Nm: noise that is correlated in time, a first-order Gauss-Markov process; None = not stated."""
    correlated_time: Array | None = None
    """(6,) s, its correlation time."""
    compensated: str = "none"
    """One of COMPENSATED: the part of the tool's wrench that the controller has already subtracted from the reading."""
    rezeroed: bool = False
    """Whether the sensor was set to zero in the log's first pose, with the tool on: its bias is then the tool's wrench
    there."""
    rezeroed_at: tuple[float, ...] = ()
    """s, stamps of the log at which the sensor was set to zero while it recorded; its bias may jump there."""
    rotation_rpy: Array | None = None
    """(3,) the angles of ``rotation`` as they were written, rad, to recognise degrees; None = not written."""
    name: str | None = None
    """Which sensor of a fleet it is; None = not stated."""


@dataclass(frozen=True, eq=False)
class ToolSetup:
    """Everything distal of the sensor, as one rigid body."""

    mass: float
    """kg; NaN = not known."""
    center_of_mass: Array
    """(3,) m, sensor frame; NaN = not known."""
    inertia: Array
    """(6,) kg m^2: Ixx Ixy Ixz Iyy Iyz Izz about the centre of mass, sensor axes."""
    mass_std: float | None = None
    """kg, standard error; None = not stated."""
    center_of_mass_std: Array | None = None
    """(3,) m, standard errors; None = not stated."""
    urdf_link: str = ""
    """Link of the URDF that is the tool; "" = not stated."""

    @property
    def unknown(self) -> tuple[str, ...]:
        """The keys of [tool] that the setup does not state, although a prediction of the wrench needs them."""
        stated = {"mass": np.isfinite(self.mass), "center_of_mass": np.isfinite(self.center_of_mass).all()}
        return tuple(key for key, is_stated in stated.items() if not is_stated)

    def has_errors(self, keys: Iterable[str]) -> bool:
        """Whether the setup states standard errors of all these keys of [tool]."""
        return all(getattr(self, f"{key}_std") is not None for key in keys)


def sign_of(reports: str) -> float:
    """Sign of the reading relative to the wrench on the tool; ``reports`` is one of REPORTS."""
    return 1.0 if reports == REPORTS[0] else -1.0


def inertia_matrix(inertia: Array) -> Array:
    """(3, 3) kg m^2 of (6,): Ixx Ixy Ixz Iyy Iyz Izz."""
    return np.asarray(inertia)[[[0, 1, 2], [1, 3, 4], [2, 4, 5]]]


def unknown_tool() -> ToolSetup:
    """A tool of which nothing is known."""
    return ToolSetup(np.nan, read_only(np.full(3, np.nan)), read_only(np.zeros(6)))


@dataclass(frozen=True, eq=False)
class BiasSetup:
    """Prior of the bias process; each (6,) array is force, then torque."""

    noise_density: Array
    """(6,) sigma_Q: N/s^1.5 and Nm/s^1.5."""
    initial_std: Array
    """(6,) N and Nm."""
    initial_drift_std: Array
    """(6,) N/s and Nm/s."""
    initial: Array
    """(6,) N and Nm; the report's sign: unbiased = measured + bias."""
    initial_drift: Array
    """(6,) N/s and Nm/s."""
    gate: float | None = None
    """Wrenches with an axis this many standard deviations off their prediction are rejected; None = no gating, or
    ``filter_samples.GATE`` where the noise is estimated from the log."""
    drift_time: Array | None = None
    """(6,) s, time constant with which the drift reverts to zero; None = never."""
    model_std: Array | None = None
    """(6,) N and Nm: standard error of the predicted reading due to effects; the bias absorbs it. None = none."""
    adapt: bool = True
    """Whether contact and the noise that the setup leaves open are estimated from each log."""


@dataclass(frozen=True, eq=False)
class JointSetup:
    """Noise of the joint filter (m instead of rad for a prismatic joint)."""

    model: str
    """One of JOINT_MODELS."""
    process_noise_density: Array | None
    """(n,) rad/s^2.5 for integrated_jerk, rad/s^1.5 for integrated_acceleration, rad/s^2 for acceleration: the motion's
    true density (the filter takes params_for_log.LAG_GUARD times as much); None = the likeliest one for each log."""
    position_noise_std: Array
    """(n,) rad."""
    velocity_noise_std: Array
    """(n,) rad/s."""
    initial_std: Array
    """(3,) rad, rad/s, rad/s^2."""


@dataclass(frozen=True, eq=False)
class DataNoiseSetup:
    """Sigma_D: uncertainty of the sensor's motion, as standard deviations along the sensor's axes.

    It is white noise, independent from sample to sample, which adds to the joint filter's own uncertainty.
    """

    linear_acceleration: Array
    """(3,) m/s^2, of the sensor's origin."""
    angular_acceleration: Array
    """(3,) rad/s^2."""
    angular_velocity: Array
    """(3,) rad/s: products omega_i omega_j get the standard deviation sigma_i sigma_j, squares sqrt(2) sigma_i^2."""
    gravity_direction: Array
    """(3,) rad: each entry of a - g gets |g| times it."""
    entries: Array | None = None
    """(36,) standard deviations of the live entries of D, column by column (tool_wrench.LIVE_ENTRIES), in m/s^2 for
    the mass's column and the torque rows of the first moment's, else rad/s^2; then the four above are zero."""


@dataclass(frozen=True, eq=False)
class LimitsSetup:
    """Limits of a planned motion; None = not stated."""

    position_lower: Array | None = None
    """(n,) rad (m), lower ends of the joints' travel."""
    position_upper: Array | None = None
    """(n,) rad (m)."""
    velocity: Array | None = None
    """(n,) rad/s (m/s)."""
    acceleration: Array | None = None
    """(n,) rad/s^2 (m/s^2)."""
    jerk: Array | None = None
    """(n,) rad/s^3 (m/s^3)."""
    box_lower: Array | None = None
    """(3,) m, base frame: lowest corner of a box that flange, sensor and tool stay in."""
    box_upper: Array | None = None
    """(3,) m, base frame."""
    floor: float | None = None
    """m, lowest height, upwards from the base frame's origin."""
    tip: Array | None = None
    """(3,) m, sensor frame: the tool's farthest end."""
    keep_axis: Array = (0.0, 0.0, 1.0)
    """(3,) sensor frame: the axis whose tilt ``keep_angle`` limits."""
    keep_angle: float | None = None
    """rad, largest tilt of this axis from its direction in the first pose."""
    wrench: Array | None = None
    """(6,) N, Nm: largest wrench of the tool on the sensor."""


@dataclass(frozen=True, eq=False)
class Setup:
    """Everything that a setup file states."""

    robot: RobotSetup
    sensor: SensorSetup
    tool: ToolSetup
    bias: BiasSetup
    joints: JointSetup
    log: LogSetup = field(default_factory=LogSetup)
    effects: Mapping[str, Any] = field(default_factory=dict)
    """[effects.NAME] as written, a table each, and the tables [[effects.term]]; the model's effects validate them."""
    data_noise: DataNoiseSetup | None = None
    """Sigma_D; None = zero."""
    pose: PoseSetup | None = None
    """Set if the sensor's pose is recorded; robot and joints then describe the entries of the pose."""
    limits: LimitsSetup = field(default_factory=LimitsSetup)
    """Limits of a planned motion."""
    path: str = ""
    """The file it was read from, for messages; "" = from memory."""
    description: str = ""
    """The URDF or MJCF file that it refers to; "" = none."""
    source: str = ""
    """The text it was read from, whose comments and order ``save`` keeps; "" = from memory."""
    comments: Mapping[str, str] = field(default_factory=dict)
    """Remarks on full keys such as ``tool.mass``, which ``save`` writes on their lines: how a value was found."""
    own_effects: tuple[Any, ...] = ()
    """``Effect`` objects besides the built-in ones, given by the caller; no file can name code that is then run."""

    def with_effects(self, effects: Sequence[Any]) -> Setup:
        """The setup with further ``Effect`` objects, which [effects.NAME] may then state; each counts once."""
        new = (effect for effect in effects if all(effect is not known for known in self.own_effects))
        return replace(self, own_effects=(*self.own_effects, *new))

    @property
    def files(self) -> tuple[str, str]:
        """Files it was read from, which no result may replace; "" = none."""
        return self.path, self.description

    # The package's __init__ binds the implementations of these two, because those import this module.

    def save(self, path: str | os.PathLike[str], by: str = "") -> None:
        """Write it as TOML that ``load_setup`` reads back: ``save.save_setup``."""
        raise NotImplementedError

    def export(self, path: str | os.PathLike[str], format: str, **options: Any) -> None:
        """Write the tool, and for ROS the bias, in the format of a controller: ``export.save_export``."""
        raise NotImplementedError
