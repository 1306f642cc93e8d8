"""A setup back to TOML text, as the table of keys orders it, with the units as comments."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from ftbias_jax.setup.keys.table import SECTIONS, key_of
from ftbias_jax.setup.keys.toml_text import toml_key, toml_line
from ftbias_jax.setup.recorded import POSE
from ftbias_jax.setup.robots import BUILT_IN, built_in_robot
from ftbias_jax.setup.rotations import rotation_from_rpy, rpy_from_rotation
from ftbias_jax.setup.types import DATA_NOISE_UNITS, DataNoiseSetup, RobotSetup, SensorSetup, Setup
from ftbias_jax.types import Array


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


def dump_setup(setup: Setup) -> str:
    """TOML text that ``parse_setup`` reads back, with ``setup.comments`` on the lines of their keys.

    Numbers come back to the last bit, except screws and rotations that go through axis, point and angles: those come
    back to round-off.
    """
    text, section = "", ""
    for line in lines_of(setup):
        if line.section != section or line.key == "axis" or (not line.key and line.section.startswith("[[")):
            text, section = f"{text}\n{line.section}\n" if text else f"{line.section}\n", line.section
        if line.key:
            text += f"{toml_line(line.key, line.value, line.comment(setup.comments.get(line.full_key, '')))}\n"
    return text


def lines_of(setup: Setup) -> list[Line]:
    """What a setup says, line by line."""
    return [*_robot(setup.robot), *_sections(setup), *_effects(setup)]


def _robot(robot: RobotSetup) -> Iterable[Line]:
    if robot.name is not None:
        yield Line("[robot]", "name", robot.name)
    # The model's name says it all, unless a screw was corrected: such a copy must write its screws.
    is_built_in = robot.model in BUILT_IN and same_screws(robot, built_in_robot(robot.model))
    if is_built_in:
        yield Line("[robot]", "model", robot.model)
        yield Line("[robot]", "joint_names", robot.joint_names)
    yield Line("[robot]", "gravity", robot.gravity)
    if is_built_in or robot.model == POSE:
        return
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


def same_screws(one: RobotSetup, two: RobotSetup) -> bool:
    """Whether two arms have the same screws and flange."""
    arrays = ("screws", "flange_translation", "flange_rotation")
    return all(np.array_equal(getattr(one, name), getattr(two, name)) for name in arrays)


def _sections(setup: Setup) -> Iterable[Line]:
    """The sections whose keys are fields of the same names, a few of them kept in another form."""
    sensor, tool, joints, pose, log = setup.sensor, setup.tool, setup.joints, setup.pose, setup.log
    yield from _section("sensor", sensor, rotation_rpy=_angles(sensor), rezeroed_at=sensor.rezeroed_at or None)
    if pose is not None:
        apart = {"frame": pose.frame or None, "base": pose.base or None, "position_noise_std": None}  # as of [joints]
        apart |= {} if pose.linear == "none" else {"acceleration_std": None}
        yield from _section("sensor_pose", pose, imu_rotation_rpy=rpy_from_rotation(pose.imu_rotation), **apart)
    yield from _section("tool", tool, **dict.fromkeys(tool.unknown))
    yield from _section("bias", setup.bias)
    density = {"integrated_jerk": "rad/s^2.5", "integrated_acceleration": "rad/s^1.5"}.get(joints.model, "rad/s^2")
    for line in _section("joints", joints):
        yield line._replace(unit=density) if line.key == "process_noise_density" else line
    if setup.data_noise is not None:
        yield from _data_noise(setup.data_noise)
    tables = [name for name, key in SECTIONS["log"].keys.items() if not key.has_value]
    yield from _section("log", log, **dict.fromkeys(tables))
    for name in tables:
        yield from (Line(f"[log.{name}]", *item) for item in getattr(log, name).items())


def _section(name: str, fields: object, **apart: Any) -> Iterable[Line]:
    """The keys of a section that ``fields`` has as attributes, but for quiet defaults; ``apart``: other values."""
    for key, spec in SECTIONS[name].keys.items():
        value = apart[key] if key in apart else getattr(fields, key, None)
        if value is not None and not (spec.quiet and np.array_equal(value, spec.default)):
            yield Line(f"[{name}]", key, value)


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


def _effects(setup: Setup) -> Iterable[Line]:
    for name, values in setup.effects.items():
        several = isinstance(values, (list, tuple))  # [[effects.term]]
        section = f"[[effects.{toml_key(name)}]]" if several else f"[effects.{toml_key(name)}]"
        for entry in values if several else [values]:
            yield Line(section, "", "")  # an effect without parameters is still an effect
            yield from (Line(section, key, value) for key, value in entry.items())
