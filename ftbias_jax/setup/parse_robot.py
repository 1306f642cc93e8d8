"""The section [robot] of a setup: a built-in arm, a URDF, a Denavit-Hartenberg table, screws, or only gravity."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ftbias_jax.setup.chains import CONVENTIONS, prismatic_screw, read_dh, revolute_screw
from ftbias_jax.setup.fields import Section, read_only, refuse, require, show, subsection
from ftbias_jax.setup.keys.table import check_section, open_section, read
from ftbias_jax.setup.recorded import POSE, PoseSetup
from ftbias_jax.setup.robots import BUILT_IN, built_in_robot
from ftbias_jax.setup.rotations import rotation_from_rpy
from ftbias_jax.setup.sensor_pose import NAMES
from ftbias_jax.setup.types import RobotSetup
from ftbias_jax.setup.urdf.read import load_urdf
from ftbias_jax.setup.urdf.robot import urdf_robot
from ftbias_jax.types import Array

AXIS_TOLERANCE = 1e-4  # an axis rounded to four digits still means a unit axis; more is a mistake
MAX_GRAVITY = 30.0  # m/s^2: above every planet a robot stands on, below cm/s^2 or mistyped units


def robot_section(top: Section, pose: PoseSetup | None) -> RobotSetup:
    """[robot]; where a pose is recorded only its gravity, and the entries of the pose take the place of joints."""
    if pose is not None:
        section = subsection(top, "robot", ("gravity",))
        count = 4 if pose.linear == "none" else 7
        screws, translation, rotation = map(read_only, (np.zeros((count, 6)), np.zeros(3), np.eye(3)))
        return RobotSetup(screws, NAMES[:count], translation, rotation, read(section, "gravity"), POSE)
    section = open_section(top, "robot", required=True)
    return replace(_arm(section), name=read(section, "name"))


def _arm(section: Section) -> RobotSetup:
    gravity = read(section, "gravity")
    if np.linalg.norm(gravity) > MAX_GRAVITY:
        remedy = f"give m/s^2 in the base frame, at most {MAX_GRAVITY:g} long, such as [0, 0, -9.81]"
        raise section.error("gravity", f"has length {np.linalg.norm(gravity):.4g} m/s^2", remedy)
    if "urdf" in section.values:
        return _urdf_robot(section, gravity)
    refuse(section, ("base_link", "tip_link"), "belongs to robot.urdf", "remove it, or give robot.urdf")
    if "dh" in section.values:
        return _dh_robot(section, gravity)
    refuse(section, ("dh_convention", "dh_units"), "belongs to robot.dh", "remove it, or give robot.dh")
    if "model" not in section.values:
        return _screw_robot(section, gravity)
    model = read(section, "model")
    refuse(section, ("joints", "flange"), f"excluded by robot.model = {model!r}")
    robot = built_in_robot(model, gravity)
    if "joint_names" not in section.values:
        return robot
    return replace(robot, joint_names=read(section, "joint_names", len(robot.joint_names)))


def urdf_path(robot: Section) -> str:
    """The file that robot.urdf names, from the setup's folder if the path is relative; "" = none."""
    name = read(robot, "urdf")
    return os.path.join(os.path.dirname(robot.file), name) if name else ""


def _urdf_robot(section: Section, gravity: Array) -> RobotSetup:
    refuse(section, ("model", "dh", "joints", "joint_names", "flange"), "excluded by robot.urdf")
    require(section, "tip_link", "name the link that is the flange")
    base_link, tip_link = read(section, "base_link") or "", read(section, "tip_link")
    return urdf_robot(load_urdf(urdf_path(section)), base_link, tip_link, gravity)


def _dh_robot(section: Section, gravity: Array) -> RobotSetup:
    refuse(section, ("model", "joints", "flange"), "excluded by robot.dh")
    require(section, "dh_convention", f"say which, as the table's source does: {' or '.join(CONVENTIONS)}")
    convention = read(section, "dh_convention")
    screws, flange, joint_names = read_dh(section, "dh", convention, read(section, "dh_units"))
    translation, rotation = map(read_only, flange)
    return RobotSetup(read_only(screws), joint_names, translation, rotation, gravity)


def _screw_robot(section: Section, gravity: Array) -> RobotSetup:
    entries = require(section, "joints", f"give [[robot.joints]], robot.dh, or robot.model: {', '.join(BUILT_IN)}")
    if not isinstance(entries, list) or not entries or not all(isinstance(entry, Mapping) for entry in entries):
        raise section.error("joints", f"expected tables, got {show(entries)}", "write one [[robot.joints]] per joint")
    remedy = "write name = ... in each [[robot.joints]]"
    refuse(section, ("joint_names",), "belongs to robot.model and robot.dh", remedy)
    joints = [Section(entry, section.path(f"joints[{i}]"), section.file) for i, entry in enumerate(entries)]
    screws = read_only(np.stack([_screw(joint) for joint in joints]))
    joint_names = tuple(read(joint, "name", default=f"joint{i}") for i, joint in enumerate(joints, 1))
    for joint, name in zip(joints, joint_names, strict=True):
        if joint_names.count(name) > 1:
            raise joint.error("name", f"the name {show(name)} is there twice", "give every joint its own name")
    flange = open_section(section, "flange")
    rotation = read_only(rotation_from_rpy(read(flange, "rotation_rpy")))
    return RobotSetup(screws, joint_names, read(flange, "translation"), rotation, gravity)


def _screw(joint: Section) -> Array:
    axis = read(check_section(joint), "axis")
    length = float(np.linalg.norm(axis))
    if abs(length - 1) > AXIS_TOLERANCE:
        raise joint.error("axis", f"has length {length:.6g}", "scale it to length 1")
    if read(joint, "type") == "prismatic":
        read(joint, "point")
        return prismatic_screw(axis / length)
    require(joint, "point", "give 3 numbers, each finite")
    return revolute_screw(axis / length, read(joint, "point"))
