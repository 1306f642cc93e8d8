"""How a setup describes its logs: names, units and axes, and the pose that is recorded instead of joints."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ftbias_jax.types import Array

POSE = "sensor_pose"
"""``RobotSetup.model`` where the pose of the sensor is recorded, instead of joints."""
ORIENTATIONS = ("quaternion_xyzw", "quaternion_wxyz", "matrix", "axis_angle", "rpy")
OF_ANGLES = ("axis_angle", "rpy")
"""Orientations of three angles, in the unit of angles."""
LINEAR = ("position", "specific_force", "none")
POSITION_AXES = ("base", "body")
TIME_UNITS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}
"""Unit of stamps -> its length in ns."""
ANGLE_UNITS = ("rad", "deg")
ACCELERATION_UNITS = ("m/s^2", "g")
LENGTH_UNITS = {"m": 1.0, "mm": 1e-3}
"""Unit of length -> m."""
FORCE_UNITS = {"N": 1.0, "mN": 1e-3, "kN": 1e3, "kgf": 9.80665, "lbf": 4.4482216152605}
"""Unit of force -> N."""
TORQUE_UNITS = {
    "Nm": 1.0,
    "Nmm": 1e-3,
    "Ncm": 1e-2,
    "lbf-in": 0.1129848290276167,
    "lbf-ft": 1.3558179483314004,
    "kgf-m": 9.80665,
    "kgf-cm": 0.0980665,
}
"""Unit of torque -> Nm."""
WRENCH_AXES = ("sensor", "base")
HEADER, RECEIPT = "header", "receipt"
CLOCKS = (HEADER, RECEIPT)
"""Clock of a topic's stamps: the publisher's (header), or the recorder's (receipt)."""


@dataclass(frozen=True, eq=False)
class PoseSetup:
    """The recorded pose of the sensor, which replaces joints; n = 4, or 7 with a linear motion."""

    orientation: str
    """One of ORIENTATIONS: of the body that the sensor is mounted on, in the base frame; rpy: fixed axes."""
    linear: str
    """One of LINEAR: source of the acceleration; the specific force is an accelerometer's, at the sensor."""
    position_noise_std: Array
    """(n,) standard deviations of the quaternion's entries and of the position, m."""
    velocity_noise_std: Array
    """(n,) standard deviations of their rates, where an IMU is recorded."""
    acceleration_std: float
    """m/s^2, typical size of the sensor's acceleration if linear is "none"; it then counts as noise of the wrench."""
    frame: str
    """TF frame that the sensor is mounted on; "" = a topic of PoseStamped."""
    base: str
    """TF frame that is the base; "" = the root."""
    conjugate: bool = False
    """Whether the orientation is recorded the other way round: of the base frame in the body."""
    position_axes: str = "base"
    """One of POSITION_AXES: axes in which the position is recorded."""
    gyroscope: bool = True
    """Whether a recorded angular velocity is used."""
    imu_rotation: Array = field(default_factory=lambda: np.eye(3))
    """(3, 3) axes of the IMU in the sensor's frame."""
    turns_about: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) m, body's axes: the point of the body that counts as at rest, if linear is "none"."""

    @property
    def orientation_columns(self) -> int:
        """Number of columns of the recorded orientation."""
        return {"matrix": 9, **dict.fromkeys(OF_ANGLES, 3)}.get(self.orientation, 4)

    def lever(self, translation: Array) -> Array:
        """(3,) m, body's axes: from the point whose acceleration is known or zero to the sensor, at ``translation``."""
        # The accelerometer measures the sensor's own motion.
        return np.zeros(3) if self.linear == "specific_force" else translation - self.turns_about

    @property
    def columns(self) -> tuple[int, int]:
        """Number of columns of the recorded pose, and of the recorded rates."""
        rates = self.gyroscope + (self.linear == "specific_force")
        return self.orientation_columns + 3 * (self.linear == "position"), 3 * rates


@dataclass(frozen=True, eq=False)
class LogSetup:
    """Names, units and clocks of a log that does not use the native ones."""

    columns: Mapping[str, str | tuple[str, ...]] = field(default_factory=dict)
    """Columns: "time", "temperature" (one name), "position", "velocity", "wrench" (n, n, 6), effects' inputs."""
    topics: Mapping[str, str] = field(default_factory=dict)
    """Topics of a ROS recording by their role in the log, where there is more than one candidate; "topic:field" for a
    field of another message."""
    clocks: Mapping[str, Any] = field(default_factory=dict)
    """Clock of each topic's stamps, by the same names, one of CLOCKS; absent = found from the recording. Also
    "wrench_rate", ppm by which the clock of the wrench runs fast."""
    files: Mapping[str, str] = field(default_factory=dict)
    """Names of the files that make up one log, by quantity, with * for their common part; {} = one file."""
    time_units: Mapping[str, str] = field(default_factory=dict)
    """Units of the stamps of single files, by the same names."""
    time_offsets: Mapping[str, float] = field(default_factory=dict)
    """s, added to the stamps of streams or files, by the same names."""
    time_unit: str | None = None
    """One of TIME_UNITS; None = s, or ns if the stamps are integers."""
    rate: float | None = None
    """Hz, sampling rate, in place of stamps."""
    angle_unit: str = "rad"
    """One of ANGLE_UNITS: of joints, of axis-angle and rpy, and of the rates of joints and gyroscope."""
    acceleration_unit: str = "m/s^2"
    """One of ACCELERATION_UNITS: of an accelerometer."""
    length_unit: str = "m"
    """One of LENGTH_UNITS: of a recorded position, and of prismatic joints and their velocities."""
    force_unit: str = "N"
    """One of FORCE_UNITS."""
    torque_unit: str = "Nm"
    """One of TORQUE_UNITS."""
    allow_outside: bool = False
    """Whether ``files`` may be anywhere; only the user can allow it, not a setup file."""
    wrench_axes: str = "sensor"
    """One of WRENCH_AXES: axes in which the wrench is recorded, about the sensor's origin."""

    @property
    def wrench_rate(self) -> float:
        """ppm by which the clock of the wrench's stamps runs fast against that of the joints'."""
        return float(self.clocks.get("wrench_rate", 0.0))

    @property
    def one_clock(self) -> bool:
        """Whether all stamps are those of one clock."""
        return not (self.time_offsets or self.wrench_rate)
