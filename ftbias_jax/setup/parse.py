"""The sections of a setup: TOML tables -> frozen dataclasses. Every key is known, every value checked."""

from __future__ import annotations

import difflib
import os
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ftbias_jax.setup.chains import CONVENTIONS, dh_chain, prismatic_screw, read_dh, revolute_screw
from ftbias_jax.setup.fields import Section, check_keys, require, show, subsection, table, text
from ftbias_jax.setup.keys.read import check_section, open_section, read
from ftbias_jax.setup.keys.table import SECTIONS, section_keys, top_sections
from ftbias_jax.setup.parse_noise import bias_section, data_noise_section, joints_section
from ftbias_jax.setup.recorded import LogSetup, PoseSetup
from ftbias_jax.setup.robots import BUILT_IN, built_in_robot
from ftbias_jax.setup.rotations import rotation_from_rpy
from ftbias_jax.setup.sensor_pose import parse_pose, pose_columns, pose_robot
from ftbias_jax.setup.types import COMPENSATED, RobotSetup, SensorSetup, Setup, ToolSetup, unknown_tool
from ftbias_jax.setup.urdf.read import Pose, Urdf, load_urdf
from ftbias_jax.setup.urdf.robot import urdf_robot, urdf_tool
from ftbias_jax.types import Array

AXIS_TOLERANCE = 1e-4  # an axis rounded to four digits still means a unit axis; more is a mistake
NO_INERTIA = 1e-12  # kg m^2, a milligram at a millimetre: the round-off of a point mass
INERTIA_TOLERANCE = 1e-6  # relative to the largest principal moment: inertias printed with seven digits pass
MAX_GRAVITY = 30.0  # m/s^2: above every planet a robot stands on, below cm/s^2 or mistyped units


def parse_setup(mapping: Mapping[str, Any], file: str = "") -> Setup:
    """A setup from the tables of its TOML text.

    Args:
        mapping: what ``tomllib.loads`` returns.
        file: the name in messages.

    Raises:
        SetupError: a key is missing, unknown, of the wrong type or shape, or physically impossible.
    """
    top = check_keys(Section(mapping, "", file), top_sections())
    pose = parse_pose(top)
    robot = _robot(top) if pose is None else pose_robot(top, pose)
    n = len(robot.joint_names)
    sensor = _sensor(top)
    joints, log = joints_section(top, n, pose), _log(top, n, pose)
    tool, bias, data_noise = _tool(top, sensor), bias_section(top), data_noise_section(top)
    urdf = _urdf_path(table(top, "robot"))
    return Setup(robot, sensor, tool, bias, joints, log, _effects(top), data_noise, pose, file, urdf)


def _robot(top: Section) -> RobotSetup:
    section = open_section(top, "robot", required=True)
    return replace(_arm(section), name=read(section, "name"))


def _arm(section: Section) -> RobotSetup:
    gravity = read(section, "gravity")
    if np.linalg.norm(gravity) > MAX_GRAVITY:
        remedy = f"give m/s^2 in the base frame, at most {MAX_GRAVITY:g} long, such as [0, 0, -9.81]"
        raise section.error("gravity", f"has length {np.linalg.norm(gravity):.4g} m/s^2", remedy)
    if "urdf" in section.values:
        return _urdf_robot(section, gravity)
    for key in ("base_link", "tip_link"):
        if key in section.values:
            raise section.error(key, "belongs to robot.urdf", "remove it, or give robot.urdf")
    if "dh" in section.values:
        return _dh_robot(section, gravity)
    for key in ("dh_convention", "dh_units"):
        if key in section.values:
            raise section.error(key, "belongs to robot.dh", "remove it, or give robot.dh")
    if "model" not in section.values:
        return _screw_robot(section, gravity)
    model = read(section, "model")
    for key in ("joints", "flange"):
        if key in section.values:
            raise section.error(key, f"excluded by robot.model = {model!r}", "remove one of the two")
    robot = built_in_robot(model, gravity)
    if "joint_names" not in section.values:
        return robot
    return built_in_robot(model, gravity, read(section, "joint_names", len(robot.joint_names)))


def _urdf_robot(section: Section, gravity: Array) -> RobotSetup:
    _exclude(section, "urdf", ("model", "dh", "joints", "joint_names", "flange"))
    require(section, "tip_link", "name the link that is the flange")
    base_link, tip_link = read(section, "base_link") or "", read(section, "tip_link")
    return urdf_robot(_load_urdf(section), base_link, tip_link, gravity)


def _dh_robot(section: Section, gravity: Array) -> RobotSetup:
    _exclude(section, "dh", ("model", "joints", "flange"))
    require(section, "dh_convention", f"say which, as the table's source does: {' or '.join(CONVENTIONS)}")
    convention = read(section, "dh_convention")
    table, joint_names = read_dh(section, "dh", convention, read(section, "dh_units"))
    screws, translation, rotation = dh_chain(table, convention)
    for array in (screws, translation, rotation):
        array.setflags(write=False)
    return RobotSetup(screws, joint_names, translation, rotation, gravity)


def _exclude(section: Section, stated: str, others: Collection[str]) -> None:
    for key in others:
        if key in section.values:
            raise section.error(key, f"excluded by robot.{stated}", "remove one of the two")


def _load_urdf(robot: Section) -> Urdf:
    return load_urdf(_urdf_path(robot))


def _urdf_path(robot: Section) -> str:
    """The file that robot.urdf names, from the setup's folder if the path is relative; "" = none."""
    name = read(robot, "urdf")
    return os.path.join(os.path.dirname(robot.file), name) if name else ""


def _screw_robot(section: Section, gravity: Array) -> RobotSetup:
    entries = require(section, "joints", f"give [[robot.joints]], robot.dh, or robot.model: {', '.join(BUILT_IN)}")
    if not isinstance(entries, list) or not entries or not all(isinstance(entry, Mapping) for entry in entries):
        raise section.error("joints", f"expected tables, got {show(entries)}", "write one [[robot.joints]] per joint")
    if "joint_names" in section.values:
        raise section.error(
            "joint_names", "belongs to robot.model and robot.dh", "write name = ... in each [[robot.joints]]"
        )
    joints = [Section(entry, section.path(f"joints[{i}]"), section.file) for i, entry in enumerate(entries)]
    screws = np.stack([_screw(joint) for joint in joints])
    screws.setflags(write=False)
    joint_names = tuple(read(joint, "name", default=f"joint{i}") for i, joint in enumerate(joints, 1))
    for joint, name in zip(joints, joint_names, strict=True):
        if joint_names.count(name) > 1:
            raise joint.error("name", f"the name {show(name)} is there twice", "give every joint its own name")
    flange = open_section(section, "flange")
    return RobotSetup(screws, joint_names, read(flange, "translation"), _rotation(flange), gravity)


def _screw(joint: Section) -> Array:
    axis = read(check_section(joint), "axis")
    length = float(np.linalg.norm(axis))
    if abs(length - 1) > AXIS_TOLERANCE:
        raise joint.error("axis", f"has length {length:.6g}", "scale it to length 1")
    slides = read(joint, "type") == "prismatic"
    if not slides:
        require(joint, "point", "give 3 numbers, each finite")
    point = read(joint, "point")
    return prismatic_screw(axis / length) if slides else revolute_screw(axis / length, point)


def _rotation(section: Section) -> Array:
    rotation = rotation_from_rpy(read(section, "rotation_rpy"))
    rotation.setflags(write=False)
    return rotation


def _sensor(top: Section) -> SensorSetup:
    section = open_section(top, "sensor")
    correlated = [key for key in ("correlated_std", "correlated_time") if key in section.values]
    if len(correlated) == 1:
        raise section.error(correlated[0], "stands alone", "state correlated_std and correlated_time, or none of them")
    apart: dict[str, Any] = {"compensated": _compensated(section), "rezeroed_at": _rezeroed_at(section)}
    values = {key: read(section, key) for key in SECTIONS["sensor"].keys if key not in apart}
    return SensorSetup(rotation=_rotation(section), **values, **apart)


def _rezeroed_at(section: Section) -> tuple[float, ...]:
    times = read(section, "rezeroed_at")
    return () if times is None else tuple(map(float, np.sort(times)))


def _compensated(section: Section) -> str:
    """A name, or true for all of the tool's wrench."""
    value = section.values.get("compensated")
    if isinstance(value, bool):
        return COMPENSATED[2] if value else COMPENSATED[0]
    return str(read(section, "compensated"))


def _tool(top: Section, sensor: SensorSetup) -> ToolSetup:
    section = open_section(top, "tool")
    if "from_urdf_link" in section.values:
        return _urdf_tool(section, table(top, "robot"), sensor)
    mass, center, inertia = (read(section, key) for key in ("mass", "center_of_mass", "inertia"))
    _check_inertia(inertia, section, "inertia")
    unknown = unknown_tool()
    mass, center = unknown.mass if mass is None else mass, unknown.center_of_mass if center is None else center
    return ToolSetup(mass, center, inertia, read(section, "mass_std"), read(section, "center_of_mass_std"))


def _check_inertia(inertia: Array, section: Section, key: str) -> None:
    xx, xy, xz, yy, yz, zz = inertia
    moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    # The largest moment may not exceed the sum of the others; that also makes all three non-negative.
    if moments[2] - moments[1] - moments[0] > max(INERTIA_TOLERANCE * np.abs(moments).max(), NO_INERTIA):
        shown = ", ".join(f"{moment:.4g}" for moment in moments)
        remedy = "no body has them: none may exceed the sum of the others; all zeros = point mass"
        message = f"{show(inertia.tolist())} has the principal moments {shown} kg m^2"
        raise section.error(key, message, remedy)


def _urdf_tool(section: Section, robot: Section, sensor: SensorSetup) -> ToolSetup:
    for key in ("mass", "center_of_mass", "inertia", "mass_std", "center_of_mass_std"):
        if key in section.values:
            raise section.error(key, "excluded by tool.from_urdf_link", "remove one of the two")
    if "urdf" not in robot.values:
        raise section.error("from_urdf_link", "there is no robot.urdf", "give tool.mass and center_of_mass instead")
    pose = Pose(sensor.translation, sensor.rotation)
    tool = urdf_tool(_load_urdf(robot), read(robot, "tip_link"), read(section, "from_urdf_link"), pose)
    _check_inertia(tool.inertia, section, "from_urdf_link")
    return tool


def _log(top: Section, n: int, pose: PoseSetup | None) -> LogSetup:
    position, velocity = pose_columns(pose) if pose else (n, n)
    sizes = {"position": position, "velocity": velocity}
    log = open_section(top, "log")
    known = section_keys("log.columns").keys
    tables = {key: open_section(log, key) for key in ("topics", "clocks", "files", "time_units", "time_offsets")}
    topics, clocks, files, units, offsets = ({key: read(part, key) for key in part.values} for part in tables.values())
    if files and not {"position", "wrench"} <= files.keys():
        raise log.error("files", f"names {', '.join(files)}", "name the files of position and wrench")
    for key, name in files.items():
        if "\0" in name:  # the system's calls refuse it, each in its own way
            raise tables["files"].error(key, f"has a zero byte in {name!r}", "give the name of a file")
    if files and (others := sorted(offsets.keys() - files.keys())):
        remedy = "state the offset of the file that has them"
        raise log.error("time_offsets", f"names {', '.join(others)}, which has no file in log.files", remedy)
    part = subsection(log, "columns", _column_keys(log, known))
    columns = {key: read(part, key, sizes.get(key)) if key in known else text(part, key, "") for key in part.values}
    others = [key for key in SECTIONS["log"].keys if key not in ("columns", *tables)]
    stated: dict[str, Any] = {key: read(log, key) for key in others}
    return LogSetup(columns, topics, clocks, files, units, offsets, **stated)


def _column_keys(log: Section, known: Collection[str]) -> tuple[str, ...]:
    """Keys that [log.columns] may have: any name that is not nearly one of those known."""
    given = log.values.get("columns")
    further = (key for key in given if key not in known) if isinstance(given, Mapping) else ()
    return (*known, *(key for key in further if key.isidentifier() and not difflib.get_close_matches(key, known)))


def _effects(top: Section) -> dict[str, Any]:
    section = table(top, "effects")
    several = {name: value for name, value in section.values.items() if name == "term" and isinstance(value, list)}
    return {name: dict(table(section, name).values) for name in section.values if name not in several} | several
