"""A setup back to TOML text, with the units as comments."""

from __future__ import annotations

import json
import os
import re
import secrets
from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from ftbias_jax.errors import OutputError
from ftbias_jax.setup.robots import BUILT_IN, built_in_robot
from ftbias_jax.setup.rotations import rpy_from_rotation
from ftbias_jax.setup.types import DATA_NOISE_UNITS, POSE, DataNoiseSetup, PoseSetup, RobotSetup, Setup

Comments = Mapping[str, str]


class _Line(NamedTuple):
    section: str
    """With its brackets."""
    key: str
    value: Any
    unit: str = ""


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
    lines = [*_robot(setup.robot), *_sections(setup), *_effects(setup)]
    left = dict(setup.comments if comments is None else comments)
    text, section = "", ""
    for line in lines:
        if line.section != section or line.key == "axis" or (not line.key and line.section.startswith("[[")):
            text, section = f"{text}\n{line.section}\n" if text else f"{line.section}\n", line.section
        if line.key:
            comment = "; ".join(part for part in (line.unit, left.pop(_full_key(line), "")) if part)
            text += f"{_key(line.key)} = {_value(line.value)}{_comment(comment)}\n"
    if left and comments is not None:  # a setup may have lost a value after it was commented
        raise ValueError(f"comments for keys that are not written: {', '.join(left)}")
    return text


def save_setup(path: str | os.PathLike[str], setup: Setup) -> None:
    """Write a setup with its comments, whole or not at all: through a temporary file beside it.

    Args:
        path: the file to make or replace; a link is followed.
        setup: what to write.

    Raises:
        OutputError: the file cannot be written there.
    """
    target = os.path.realpath(path)
    temporary = os.path.join(os.path.dirname(target), f".ftbias-{secrets.token_hex(8)}.tmp")
    try:
        with open(temporary, "x", encoding="utf-8", newline="") as file:
            file.write(dump_setup(setup))
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, target)
    except OSError as error:
        remedy = "check that the folder exists, may be written to and has room"
        message = f"cannot be written: {error.strerror or error}"
        raise OutputError(message, file=os.fspath(path), remedy=remedy) from error
    finally:
        with suppress(OSError):  # after the rename there is nothing left to remove
            os.unlink(temporary)


def _robot(robot: RobotSetup) -> Iterable[_Line]:
    gravity = _Line("[robot]", "gravity", robot.gravity, "m/s^2, base frame")
    if robot.model == POSE:
        yield gravity
        return
    if _is_built_in(robot):
        yield _Line("[robot]", "model", robot.model)
        yield _Line("[robot]", "joint_names", robot.joint_names)
        yield gravity
        return
    yield gravity
    yield _Line("[robot.flange]", "translation", robot.flange_translation, "m, pose at q = 0, base frame")
    yield _Line("[robot.flange]", "rotation_rpy", rpy_from_rotation(robot.flange_rotation), "rad, fixed axes")
    for screw, name in zip(robot.screws, robot.joint_names, strict=True):
        revolute = bool(screw[3:].any())
        axis = screw[3:] if revolute else screw[:3]
        yield _Line("[[robot.joints]]", "axis", axis, "base frame, q = 0")
        if revolute:
            yield _Line("[[robot.joints]]", "point", np.cross(axis, screw[:3]), "m, nearest to the origin")
        yield _Line("[[robot.joints]]", "type", "revolute" if revolute else "prismatic")
        yield _Line("[[robot.joints]]", "name", name)


def _is_built_in(robot: RobotSetup) -> bool:
    """Whether the model's name says it all: a copy with a corrected screw must write its screws."""
    if robot.model not in BUILT_IN:
        return False
    model = built_in_robot(robot.model)
    return all(
        np.array_equal(getattr(robot, name), getattr(model, name))
        for name in ("screws", "flange_translation", "flange_rotation")
    )


def _sections(setup: Setup) -> Iterable[_Line]:
    sensor, tool, bias, joints = setup.sensor, setup.tool, setup.bias, setup.joints
    inertia = "kg m^2: Ixx Ixy Ixz Iyy Iyz Izz about the centre of mass, sensor axes"
    density = {"integrated_jerk": "rad/s^2.5", "integrated_acceleration": "rad/s^1.5"}.get(joints.model, "rad/s^2")
    yield _Line("[sensor]", "translation", sensor.translation, "m, sensor origin in the flange frame")
    yield _Line("[sensor]", "rotation_rpy", rpy_from_rotation(sensor.rotation), "rad, fixed axes, in the flange frame")
    yield _Line("[sensor]", "noise_std", sensor.noise_std, "N, Nm")
    yield _Line("[sensor]", "reports", sensor.reports)
    if sensor.correlated_std is not None:
        yield _Line("[sensor]", "correlated_std", sensor.correlated_std, "N, Nm")
        yield _Line("[sensor]", "correlated_time", sensor.correlated_time, "s")
    if setup.pose is not None:
        yield from _pose(setup.pose)
    yield _Line("[tool]", "mass", tool.mass, "kg")
    yield _Line("[tool]", "center_of_mass", tool.center_of_mass, "m, sensor frame")
    yield _Line("[tool]", "inertia", tool.inertia, inertia)
    yield _Line("[bias]", "noise_density", bias.noise_density, "N/s^1.5, Nm/s^1.5")
    yield _Line("[bias]", "initial_std", bias.initial_std, "N, Nm")
    yield _Line("[bias]", "initial_drift_std", bias.initial_drift_std, "N/s, Nm/s")
    yield _Line("[bias]", "initial", bias.initial, "N, Nm; unbiased = measured + bias")
    yield _Line("[bias]", "initial_drift", bias.initial_drift, "N/s, Nm/s")
    if bias.gate is not None:
        yield _Line("[bias]", "gate", bias.gate, "standard deviations")
    if bias.drift_time is not None:
        yield _Line("[bias]", "drift_time", bias.drift_time, "s")
    if not bias.adapt:
        yield _Line("[bias]", "adapt", bias.adapt)
    yield _Line("[joints]", "model", joints.model)
    if joints.process_noise_density is not None:
        yield _Line("[joints]", "process_noise_density", joints.process_noise_density, density)
    yield _Line("[joints]", "position_noise_std", joints.position_noise_std, "rad")
    yield _Line("[joints]", "velocity_noise_std", joints.velocity_noise_std, "rad/s")
    yield _Line("[joints]", "initial_std", joints.initial_std, "rad, rad/s, rad/s^2")
    if setup.data_noise is not None:
        yield from _data_noise(setup.data_noise)
    for key, value in setup.log.columns.items():
        yield _Line("[log.columns]", key, value)
    for key, value in setup.log.topics.items():
        yield _Line("[log.topics]", key, value)


def _data_noise(noise: DataNoiseSetup) -> Iterable[_Line]:
    """Sigma_D: four physical numbers, or entry by entry."""
    if noise.entries is not None:
        yield _Line("[data_noise]", "entries", noise.entries, "standard deviations of the live entries of D, by column")
        return
    for key, unit in DATA_NOISE_UNITS.items():
        std = getattr(noise, key)
        yield _Line("[data_noise]", key, std if len(set(std)) > 1 else std[0], f"{unit}, standard deviation")


def _pose(pose: PoseSetup) -> Iterable[_Line]:
    """Its noise stands in [joints]."""
    yield _Line("[sensor_pose]", "orientation", pose.orientation)
    yield _Line("[sensor_pose]", "linear", pose.linear)
    if pose.linear == "none":
        yield _Line("[sensor_pose]", "acceleration_std", pose.acceleration_std, "m/s^2")
    for key in ("frame", "base"):
        if getattr(pose, key):
            yield _Line("[sensor_pose]", key, getattr(pose, key))


def _effects(setup: Setup) -> Iterable[_Line]:
    for name, values in setup.effects.items():
        if isinstance(values, (list, tuple)):  # [[effects.term]]
            for number, entry in enumerate(values, 1):
                yield _Line(f"[[effects.{_key(name)}]]", "", number)
                yield from (_Line(f"[[effects.{_key(name)}]]", key, value) for key, value in entry.items())
            continue
        section = f"[effects.{_key(name)}]"
        yield _Line(section, "", None)  # an effect without parameters is still an effect
        for key, value in values.items():
            yield _Line(section, key, value)


def _full_key(line: _Line) -> str:
    return f"{line.section.strip('[]')}.{line.key}"


def _comment(words: str) -> str:
    printable = "".join(c if c.isprintable() else " " for c in words)  # TOML forbids control characters here
    return f"  # {printable}" if printable else ""


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _string(key)


def _string(text: str) -> str:
    # JSON's escapes are TOML's, but for DEL, which JSON leaves bare.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _value(value: Any) -> str:
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
            return f"[{', '.join(_value(item) for item in value)}]"
        case Mapping():
            return "{" + ", ".join(f"{_key(key)} = {_value(item)}" for key, item in value.items()) + "}"
    return str(value.isoformat())  # TOML's dates and times are Python's
