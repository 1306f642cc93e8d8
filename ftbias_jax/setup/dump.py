"""A setup as TOML text, in the order of the table of keys, with the units as comments.

The text is that of a complete setup, or of a template to be completed: known values, and what is left to measure.
"""

import json
import re
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from ftbias_jax.setup.keys.table import SECTIONS, Kind, key_of
from ftbias_jax.setup.recorded import POSE
from ftbias_jax.setup.robots import BUILT_IN, built_in_robot
from ftbias_jax.setup.rotations import rotation_from_rpy, rpy_from_rotation
from ftbias_jax.setup.types import DATA_NOISE_UNITS, DataNoiseSetup, RobotSetup, SensorSetup, Setup
from ftbias_jax.types import Array

MEASURE = "measure me"
TO_MEASURE = ("sensor.translation", "sensor.rotation_rpy", "sensor.noise_std", "tool.mass", "tool.center_of_mass")
"""Keys that a prediction of the wrench needs, and that only the robot's owner can supply."""
ALWAYS = ("robot", "sensor", "tool", "bias", "joints")
"""Sections that are written even if nothing of them is known."""


class Line(NamedTuple):
    """One line of a setup, or the header of a section without lines."""

    section: str
    """Name of the section, with its brackets."""
    key: str
    value: Any
    unit: str = ""
    """Unit, where it differs from that in the table of keys."""

    @property
    def full_key(self) -> str:
        """Dotted key, such as ``tool.mass``."""
        return f"{self.section.strip('[]')}.{self.key}"

    def comment(self, remark: str = "") -> str:
        """Comment behind the value: the unit, and a remark."""
        known = key_of(self.full_key)
        return "; ".join(part for part in (self.unit or (known.unit if known else ""), remark) if part)


def dump_setup(setup: Setup) -> str:
    """TOML text that ``parse_setup`` reads back, with ``setup.comments`` on the lines of their keys.

    Numbers are restored to the last bit, except screws and rotations, which are written as axis, point and angles:
    those are restored to round-off.
    """
    return text_of(lines_of(setup), setup.comments)


def text_of(lines: Iterable[Line], comments: Mapping[str, str]) -> str:
    """TOML text of some lines, with comments on full keys."""
    text, section = "", ""
    for line in lines:
        if line.section != section or line.key == "axis" or (not line.key and line.section.startswith("[[")):
            text, section = f"{text}\n{line.section}\n" if text else f"{line.section}\n", line.section
        if line.key:
            text += f"{toml_line(line.key, line.value, line.comment(comments.get(line.full_key, '')))}\n"
    return text


def lines_of(setup: Setup) -> list[Line]:
    """All lines of a setup."""
    return [*_robot(setup.robot), *_sections(setup), *_effects(setup)]


def _robot(robot: RobotSetup) -> Iterable[Line]:
    if robot.name is not None:
        yield Line("[robot]", "name", robot.name)
    # The model's name defines the arm, unless a screw was corrected: such a copy must write its screws.
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
        apart = {"frame": pose.frame or None, "base": pose.base or None, "position_noise_std": None}  # in [joints]
        apart |= {} if pose.linear == "none" else {"acceleration_std": None}
        yield from _section("sensor_pose", pose, imu_rotation_rpy=rpy_from_rotation(pose.imu_rotation), **apart)
    yield from _section("tool", tool, **dict.fromkeys(tool.unknown))
    yield from _section("bias", setup.bias)
    density = {"integrated_jerk": "rad/s^2.5", "integrated_acceleration": "rad/s^1.5"}.get(joints.model, "rad/s^2")
    for line in _section("joints", joints):
        yield line._replace(unit=density) if line.key == "process_noise_density" else line
    if setup.data_noise is not None:
        yield from _data_noise(setup.data_noise)
    yield from _section("limits", setup.limits)
    tables = [name for name, key in SECTIONS["log"].keys.items() if not key.has_value]
    yield from _section("log", log, **dict.fromkeys(tables))
    for name in tables:
        yield from (Line(f"[log.{name}]", *item) for item in getattr(log, name).items())


def _section(name: str, fields: object, **apart: Any) -> Iterable[Line]:
    """Yield the keys that ``fields`` has as attributes, without quiet defaults; ``apart`` overrides values."""
    for key, spec in SECTIONS[name].keys.items():
        value = apart[key] if key in apart else getattr(fields, key, None)
        if value is not None and not (spec.quiet and np.array_equal(value, spec.default)):
            yield Line(f"[{name}]", key, value)


def _angles(sensor: SensorSetup) -> Array:
    """The sensor's roll, pitch and yaw: as they were written if they still hold, else from the rotation matrix."""
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


def toml_line(key: str, value: Any, comment: str = "") -> str:
    """``key = value  # comment``, without the end of the line."""
    return f"{toml_key(key)} = {toml_value(value)}{toml_comment(comment)}"


def toml_comment(words: str) -> str:
    """Comment behind a value; empty if there are no words."""
    printable = "".join(c if c.isprintable() else " " for c in words)  # TOML forbids control characters here
    return f"  # {printable}" if printable else ""


def toml_key(key: str) -> str:
    """A key, in quotes if it needs them."""
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _string(key)


def toml_value(value: Any) -> str:
    """A value that ``tomllib`` reads back to the last bit."""
    match value:
        case bool() | np.bool_():
            return "true" if value else "false"
        case str():
            return _string(value)
        case int() | np.integer():
            return str(int(value))
        case float() | np.floating():
            return repr(float(value))
        case list() | tuple() | np.ndarray():
            return f"[{', '.join(toml_value(item) for item in value)}]"
        case Mapping():
            return "{" + ", ".join(f"{toml_key(key)} = {toml_value(item)}" for key, item in value.items()) + "}"
    return str(value.isoformat())  # TOML's dates and times are Python's


def _string(text: str) -> str:
    # JSON and TOML have the same escapes, except for DEL, which JSON leaves unescaped.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


class Known(NamedTuple):
    """The value of one key, and its source."""

    value: Any
    """None = still to be chosen; the comment states the choices."""
    remark: str = ""


def write_template(known: Mapping[str, Known], about: str = "") -> str:
    """Text of a setup template: known values by full key, such as ``sensor.noise_std``, below introductory lines.

    The other keys of the sections become comments; those of TO_MEASURE are marked as such.
    """
    parts = ["".join(f"#{toml_comment(line)[3:]}\n" if line else "#\n" for line in about.splitlines())]
    for name in SECTIONS:
        stated = {key: known[f"{name}.{key}"] for key in SECTIONS[name].keys if f"{name}.{key}" in known}
        if name in ALWAYS or stated:
            parts.append(_template_section(name, stated, known))
    return "\n".join(part for part in parts if part)


def _template_section(name: str, known: Mapping[str, Known], everything: Mapping[str, Known]) -> str:
    section = SECTIONS[name]
    # With a recorded pose, [robot] has only gravity.
    elsewhere = name == "robot" and "sensor_pose.orientation" in everything
    lines = [f"[{name}]  # {section.about}"]
    for key, spec in section.keys.items():
        value, remark = known.get(key, ("", ""))
        shown = spec.example if spec.default is None else spec.default
        if value is None:
            lines.append(f"# {key} = ...  # {spec.meaning}; {toml_comment(remark)[4:]}")
        elif key in known:
            lines.append(toml_line(key, value, _joined(spec.unit, remark)))
        elif shown is not None and spec.kind is not Kind.ROWS and not (elsewhere and key != "gravity"):
            absent = f"default: {spec.absent}" if spec.absent else ""
            words = (MEASURE,) if f"{name}.{key}" in TO_MEASURE else (spec.meaning, absent)
            lines.append(f"# {toml_line(key, shown, _joined(spec.unit, *words))}")
    return "\n".join(lines) + "\n"


def _joined(*words: str) -> str:
    return "; ".join(filter(None, words))
