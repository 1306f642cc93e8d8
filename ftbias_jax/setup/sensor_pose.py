"""The section [sensor_pose] of a setup: the sensor's pose is recorded instead of the joints of an arm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ftbias_jax.setup.fields import Section, read_only, refuse, require
from ftbias_jax.setup.keys.table import open_section, read, read_all
from ftbias_jax.setup.recorded import PoseSetup
from ftbias_jax.setup.rotations import rotation_from_rpy
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

ORIENTATION_COLUMNS = {"matrix": 9, "axis_angle": 3}
"""Of a quaternion there are four."""
NAMES = ("orientation w", "orientation x", "orientation y", "orientation z", "position x", "position y", "position z")


def parse_pose(top: Section) -> PoseSetup | None:
    """The section, if it is there."""
    if "sensor_pose" not in top.values:
        return None
    section = open_section(top, "sensor_pose")
    linear = read(section, "linear")
    if linear != "none":
        refuse(section, ("acceleration_std",), f"excluded by linear = {linear!r}")
    if section.values.get("orientation") in ("matrix", "axis_angle"):
        refuse(section, ("frame",), "TF has quaternions", "leave orientation out")
    if "base" in section.values:
        require(section, "frame", "name the frame of TF that the sensor is mounted on")
    names = ("orientation", "position", "angular_velocity", "linear_velocity")
    orientation, position, turn, slide = (read(section, f"{name}_noise_std") for name in names)
    values = read_all(section, ("imu_rotation_rpy", *(f"{name}_noise_std" for name in names)))
    values |= {key: values[key] or "" for key in ("frame", "base")}
    # An angle moves the quaternion by half of it.
    return PoseSetup(
        position_noise_std=_entries(orientation / 2, position, linear),
        velocity_noise_std=_entries(turn / 2, slide, linear),
        imu_rotation=rotation_from_rpy(read(section, "imu_rotation_rpy")),
        **values,
    )


def pose_columns(pose: PoseSetup) -> tuple[int, int]:
    """How many columns the recorded pose has, and the recorded rates if there are any."""
    orientation = ORIENTATION_COLUMNS.get(pose.orientation, 4)
    return orientation + 3 * (pose.linear == "position"), 3 * pose.gyroscope + 3 * (pose.linear == "specific_force")


def orientation_alone(setup: Setup) -> Setup:
    """The setup for poses at rest, of which only the orientation is read; one with joints as it is."""
    pose = setup.pose
    if pose is None:
        return setup
    still = replace(pose, linear="none", position_noise_std=pose.position_noise_std[:4])
    entries = pose_columns(still)[0]
    columns = {name: x[:entries] if name == "position" else x for name, x in setup.log.columns.items()}
    joints = replace(setup.joints, position_noise_std=setup.joints.position_noise_std[:4])
    robot = replace(setup.robot, screws=setup.robot.screws[:4], joint_names=setup.robot.joint_names[:4])
    return replace(setup, pose=still, robot=robot, joints=joints, log=replace(setup.log, columns=columns))


def _entries(turn: float, slide: float, linear: str) -> Array:
    return read_only(np.array([turn] * 4 + [slide] * (0 if linear == "none" else 3)))
