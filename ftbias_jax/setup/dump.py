"""A setup back to TOML text, with the units as comments."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from ftbias_jax.setup.keys.table import key_of
from ftbias_jax.setup.keys.toml_text import toml_key, toml_line
from ftbias_jax.setup.recorded import POSE, LogSetup, PoseSetup
from ftbias_jax.setup.robots import BUILT_IN, built_in_robot
from ftbias_jax.setup.rotations import rotation_from_rpy, rpy_from_rotation
from ftbias_jax.setup.types import DATA_NOISE_UNITS, DataNoiseSetup, RobotSetup, SensorSetup, Setup
from ftbias_jax.types import Array

Comments = Mapping[str, str]


class Line(NamedTuple):
    """One line of a setup, or the head of a section that has none."""

    section: str
    """With its brackets."""
    key: str
    value: Any
    unit: str = ""
    """Where it differs from that of the table of keys."""

    @property
    def full_key(self) -> str:
        """Such as ``tool.mass``."""
        return f"{self.section.strip('[]')}.{self.key}"

    def comment(self, remark: str = "") -> str:
        """The unit, and what else there is to say."""
        known = key_of(self.full_key)
        return "; ".join(part for part in (self.unit or (known.unit if known else ""), remark) if part)


def dump_setup(setup: Setup, comments: Comments | None = None) -> str:
    """TOML text that ``parse_setup`` reads back.

    Numbers come back to the last bit, except screws and rotations that go through axis, point and angles: those come
    back to round-off.

    Args:
        setup: what to write.
        comments: for full keys such as ``tool.mass``, appended to that line, instead of ``setup.comments``.

    Raises:
        ValueError: a comment is for a key that is not written.
    """
    lines = lines_of(setup)
    left = dict(setup.comments if comments is None else comments)
    text, section = "", ""
    for line in lines:
        if line.section != section or line.key == "axis" or (not line.key and line.section.startswith("[[")):
            text, section = f"{text}\n{line.section}\n" if text else f"{line.section}\n", line.section
        if line.key:
            text += f"{toml_line(line.key, line.value, line.comment(left.pop(line.full_key, '')))}\n"
    if left and comments is not None:  # a setup may have lost a value after it was commented
        raise ValueError(f"comments for keys that are not written: {', '.join(left)}")
    return text


def lines_of(setup: Setup) -> list[Line]:
    """What a setup says, line by line."""
    return [*_robot(setup.robot), *_sections(setup), *_effects(setup)]


def _robot(robot: RobotSetup) -> Iterable[Line]:
    if robot.name is not None:
        yield Line("[robot]", "name", robot.name)
    gravity = Line("[robot]", "gravity", robot.gravity)
    if robot.model == POSE:
        yield gravity
        return
    if _is_built_in(robot):
        yield Line("[robot]", "model", robot.model)
        yield Line("[robot]", "joint_names", robot.joint_names)
        yield gravity
        return
    yield gravity
    yield Line("[robot.flange]", "translation", robot.flange_translation)
    yield Line("[robot.flange]", "rotation_rpy", rpy_from_rotation(robot.flange_rotation))
    for screw, name in zip(robot.screws, robot.joint_names, strict=True):
        revolute = bool(screw[3:].any())
        axis = screw[3:] if revolute else screw[:3]
        yield Line("[[robot.joints]]", "axis", axis)
        if revolute:
            yield Line("[[robot.joints]]", "point", np.cross(axis, screw[:3]), "m, nearest to the origin")
        yield Line("[[robot.joints]]", "type", "revolute" if revolute else "prismatic")
        yield Line("[[robot.joints]]", "name", name)


def _is_built_in(robot: RobotSetup) -> bool:
    """Whether the model's name says it all: a copy with a corrected screw must write its screws."""
    if robot.model not in BUILT_IN:
        return False
    model = built_in_robot(robot.model)
    return all(
        np.array_equal(getattr(robot, name), getattr(model, name))
        for name in ("screws", "flange_translation", "flange_rotation")
    )


def _sections(setup: Setup) -> Iterable[Line]:
    sensor, tool, bias, joints = setup.sensor, setup.tool, setup.bias, setup.joints
    density = {"integrated_jerk": "rad/s^2.5", "integrated_acceleration": "rad/s^1.5"}.get(joints.model, "rad/s^2")
    if sensor.name is not None:
        yield Line("[sensor]", "name", sensor.name)
    yield Line("[sensor]", "translation", sensor.translation)
    yield Line("[sensor]", "rotation_rpy", _angles(sensor))
    yield Line("[sensor]", "noise_std", sensor.noise_std)
    yield Line("[sensor]", "reports", sensor.reports)
    if sensor.compensated != "none":
        yield Line("[sensor]", "compensated", sensor.compensated)
    if sensor.rezeroed:
        yield Line("[sensor]", "rezeroed", sensor.rezeroed)
    if sensor.rezeroed_at:
        yield Line("[sensor]", "rezeroed_at", np.array(sensor.rezeroed_at))
    if sensor.correlated_std is not None:
        yield Line("[sensor]", "correlated_std", sensor.correlated_std)
        yield Line("[sensor]", "correlated_time", sensor.correlated_time)
    if setup.pose is not None:
        yield from _pose(setup.pose)
    if "mass" not in tool.unknown:
        yield Line("[tool]", "mass", tool.mass)
    if "center_of_mass" not in tool.unknown:
        yield Line("[tool]", "center_of_mass", tool.center_of_mass)
    yield Line("[tool]", "inertia", tool.inertia)
    if tool.mass_std is not None:
        yield Line("[tool]", "mass_std", tool.mass_std)
    if tool.center_of_mass_std is not None:
        yield Line("[tool]", "center_of_mass_std", tool.center_of_mass_std)
    yield Line("[bias]", "noise_density", bias.noise_density)
    yield Line("[bias]", "initial_std", bias.initial_std)
    yield Line("[bias]", "initial_drift_std", bias.initial_drift_std)
    yield Line("[bias]", "initial", bias.initial)
    yield Line("[bias]", "initial_drift", bias.initial_drift)
    if bias.gate is not None:
        yield Line("[bias]", "gate", bias.gate)
    if bias.drift_time is not None:
        yield Line("[bias]", "drift_time", bias.drift_time)
    if not bias.adapt:
        yield Line("[bias]", "adapt", bias.adapt)
    yield Line("[joints]", "model", joints.model)
    if joints.process_noise_density is not None:
        yield Line("[joints]", "process_noise_density", joints.process_noise_density, density)
    yield Line("[joints]", "position_noise_std", joints.position_noise_std)
    yield Line("[joints]", "velocity_noise_std", joints.velocity_noise_std)
    yield Line("[joints]", "initial_std", joints.initial_std)
    if setup.data_noise is not None:
        yield from _data_noise(setup.data_noise)
    yield from _log(setup.log)


def _log(log: LogSetup) -> Iterable[Line]:
    """How to read a log, where it is not the usual way."""
    usual = LogSetup()
    for key in ("time_unit", "rate", "angle_unit", "acceleration_unit", "force_unit", "torque_unit", "wrench_axes"):
        if getattr(log, key) != getattr(usual, key):
            yield Line("[log]", key, getattr(log, key))
    for name in ("columns", "topics", "clocks", "files", "time_units", "time_offsets"):
        for key, value in getattr(log, name).items():
            yield Line(f"[log.{name}]", key, value)


def _angles(sensor: SensorSetup) -> Array:
    """The sensor's rotation as it was written, if nothing has turned it since."""
    written = sensor.rotation_rpy
    if written is not None and np.array_equal(rotation_from_rpy(written), sensor.rotation):
        return written
    return rpy_from_rotation(sensor.rotation)


def _data_noise(noise: DataNoiseSetup) -> Iterable[Line]:
    """Sigma_D: four physical numbers, or entry by entry."""
    if noise.entries is not None:
        yield Line("[data_noise]", "entries", noise.entries, "standard deviations of the live entries of D, by column")
        return
    for key, unit in DATA_NOISE_UNITS.items():
        std = getattr(noise, key)
        yield Line("[data_noise]", key, std if len(set(std)) > 1 else std[0], f"{unit}, standard deviation")


def _pose(pose: PoseSetup) -> Iterable[Line]:
    """Its noise stands in [joints]."""
    yield Line("[sensor_pose]", "orientation", pose.orientation)
    yield Line("[sensor_pose]", "linear", pose.linear)
    if pose.linear == "none":
        yield Line("[sensor_pose]", "acceleration_std", pose.acceleration_std, "m/s^2")
    for key in ("frame", "base", "conjugate"):
        if getattr(pose, key):
            yield Line("[sensor_pose]", key, getattr(pose, key))
    if pose.position_axes != "base":
        yield Line("[sensor_pose]", "position_axes", pose.position_axes)
    if not pose.gyroscope:
        yield Line("[sensor_pose]", "gyroscope", pose.gyroscope)
    if (pose.imu_rotation != np.eye(3)).any():
        yield Line("[sensor_pose]", "imu_rotation_rpy", rpy_from_rotation(pose.imu_rotation))


def _effects(setup: Setup) -> Iterable[Line]:
    for name, values in setup.effects.items():
        if isinstance(values, (list, tuple)):  # [[effects.term]]
            section = f"[[effects.{toml_key(name)}]]"
            for number, entry in enumerate(values, 1):
                yield Line(section, "", number)
                yield from (Line(section, key, value) for key, value in entry.items())
            continue
        section = f"[effects.{toml_key(name)}]"
        yield Line(section, "", None)  # an effect without parameters is still an effect
        for key, value in values.items():
            yield Line(section, key, value)
