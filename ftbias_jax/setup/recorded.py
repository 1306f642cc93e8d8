"""What a setup says of its logs: names, units and axes, and the pose that is recorded where there are no joints."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ftbias_jax.types import Array

POSE = "sensor_pose"
"""``RobotSetup.model`` where the pose of the sensor is recorded, instead of joints."""
ORIENTATIONS = ("quaternion_xyzw", "quaternion_wxyz", "matrix", "axis_angle")
LINEAR = ("position", "specific_force", "none")
POSITION_AXES = ("base", "body")
TIME_UNITS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}
"""Unit of stamps -> its length in ns."""
ANGLE_UNITS = ("rad", "deg")
ACCELERATION_UNITS = ("m/s^2", "g")
FORCE_UNITS = {"N": 1.0, "mN": 1e-3, "kN": 1e3, "kgf": 9.80665, "lbf": 4.4482216152605}
"""Unit of force -> N."""
TORQUE_UNITS = {"Nm": 1.0, "Nmm": 1e-3, "Ncm": 1e-2, "lbf-in": 0.1129848290276167, "lbf-ft": 1.3558179483314004}
"""Unit of torque -> Nm."""
WRENCH_AXES = ("sensor", "base")
HEADER, RECEIPT = "header", "receipt"
CLOCKS = (HEADER, RECEIPT)
"""Whose stamps the messages of a topic have: the publisher's, or the recorder's."""


@dataclass(frozen=True, eq=False)
class PoseSetup:
    """What is recorded of the sensor's pose, where there are no joints; n = 4, or 7 with a linear motion."""

    orientation: str
    """One of ORIENTATIONS: of the body that the sensor is mounted on, in the base frame."""
    linear: str
    """One of LINEAR: how the acceleration is known; the specific force is an accelerometer's, at the sensor."""
    position_noise_std: Array
    """(n,) of the quaternion's entries and the position, m."""
    velocity_noise_std: Array
    """(n,) of their rates, where an IMU is recorded."""
    acceleration_std: float
    """m/s^2 that the sensor's acceleration is typically from zero, if linear is "none"; then noise of the wrench."""
    frame: str
    """Frame of TF that the sensor is mounted on; "" = a topic of PoseStamped."""
    base: str
    """Frame of TF that is the base; "" = the root."""
    conjugate: bool = False
    """Whether the orientation is recorded the other way round: of the base frame in the body."""
    position_axes: str = "base"
    """One of POSITION_AXES: in which axes the position is recorded."""
    gyroscope: bool = True
    """Whether a recorded angular velocity is used."""
    imu_rotation: Array = field(default_factory=lambda: np.eye(3))
    """(3, 3) axes of the IMU in the sensor's frame."""
    turns_about: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) m, body's axes: the point of the body that counts as at rest, if linear is "none"."""

    @property
    def orientation_columns(self) -> int:
        """How many columns the orientation has."""
        return {"matrix": 9, "axis_angle": 3}.get(self.orientation, 4)

    def lever(self, translation: Array) -> Array:
        """(3,) m, body's axes: the sensor, at ``translation``, from the point whose acceleration is known or zero."""
        # An accelerometer's path is that of the sensor itself.
        return np.zeros(3) if self.linear == "specific_force" else translation - self.turns_about

    @property
    def columns(self) -> tuple[int, int]:
        """How many columns the recorded pose has, and the recorded rates if there are any."""
        rates = self.gyroscope + (self.linear == "specific_force")
        return self.orientation_columns + 3 * (self.linear == "position"), 3 * rates


@dataclass(frozen=True, eq=False)
class LogSetup:
    """How to find things in a log that does not use the native names."""

    columns: Mapping[str, str | tuple[str, ...]] = field(default_factory=dict)
    """Columns: "time", "temperature" (one name), "position", "velocity", "wrench" (n, n, 6), and what effects see."""
    topics: Mapping[str, str] = field(default_factory=dict)
    """Topics of a ROS recording by what they are to the log, where there is more than one to choose from; "topic:field"
    for a field of another message."""
    clocks: Mapping[str, Any] = field(default_factory=dict)
    """Whose stamps they have, by the same names, one of CLOCKS; absent = found from the recording. And "wrench_rate",
    ppm by which the clock of the wrench runs fast."""
    files: Mapping[str, str] = field(default_factory=dict)
    """Names of the files that make up one log, by quantity, with * for what their names share; {} = one file."""
    time_units: Mapping[str, str] = field(default_factory=dict)
    """Units of the stamps of single files, by the same names."""
    time_offsets: Mapping[str, float] = field(default_factory=dict)
    """s, added to the stamps of streams or files, by the same names."""
    time_unit: str | None = None
    """One of TIME_UNITS; None = s, or ns if the stamps are integers."""
    rate: float | None = None
    """Hz, instead of stamps."""
    angle_unit: str = "rad"
    """One of ANGLE_UNITS: of joints, and of the rates of joints and gyroscope."""
    acceleration_unit: str = "m/s^2"
    """One of ACCELERATION_UNITS: of an accelerometer."""
    force_unit: str = "N"
    """One of FORCE_UNITS."""
    torque_unit: str = "Nm"
    """One of TORQUE_UNITS."""
    allow_outside: bool = False
    """Whether ``files`` may be anywhere; the user's word, which no setup can give."""
    wrench_axes: str = "sensor"
    """One of WRENCH_AXES: in which axes the wrench is recorded, about the sensor's origin."""

    @property
    def wrench_rate(self) -> float:
        """ppm by which the clock of the wrench's stamps runs fast against that of the joints'."""
        return float(self.clocks.get("wrench_rate", 0.0))

    @property
    def one_clock(self) -> bool:
        """Whether all stamps are those of one clock."""
        return not (self.time_offsets or self.wrench_rate)
