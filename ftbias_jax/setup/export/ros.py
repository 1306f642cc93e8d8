"""The tool and the bias as parameters of ROS packages that subtract them from the live reading, in the sensor frame."""

import json
import math
from collections.abc import Iterable

import numpy as np

from ftbias_jax.errors import SetupError, printable
from ftbias_jax.setup.export.payload import ExportOptions, heading, number, numbers
from ftbias_jax.setup.require import require_tool
from ftbias_jax.setup.types import REPORTS, SCREWS, Setup, sign_of
from ftbias_jax.types import Array

WORLD_FRAMES = {"ur": "base", "panda": "panda_link0", "fr3": "fr3_link0"}
"""Prefix of a robot's name -> its manufacturer's name of the setup's base frame."""


def ros_text(setup: Setup, options: ExportOptions) -> str:
    """YAML for ros2_control: the offset of the broadcaster, and a gravity compensation in its chain of filters.

    ``force_torque_sensor_broadcaster`` adds ``offset`` to the reading, then runs ``sensor_filter_chain``;
    ``control_filters/GravityCompensationWrench`` subtracts mass * gravity_field, rotated from world_frame into
    sensor_frame, and CoG x that. (ros-controls/control_toolbox, gravity_compensation.cpp; ros2_controllers,
    admittance_controller/test/test_params.yaml.) A sensor that reports the wrench on the tool reads the opposite of the
    weight, so its gravity_field points up.

    The setup states the tool, and the bias as ``identify --bias`` writes it.

    Raises:
        SetupError: the tool is not stated, or the reading has been compensated already.
    """
    tool = _tool_of_the_reading(setup)
    field = numbers(-sign_of(setup.sensor.reports) * setup.robot.gravity)
    lines = [
        *_comments(setup),
        *_offset_lines(sign_of(setup.sensor.reports) * setup.bias.initial),
        "    sensor_filter_chain:",
        "      filter1:",
        "        name: gravity_compensation",
        "        type: control_filters/GravityCompensationWrench",
        "        params:",
        f"          world_frame: {json.dumps(options.world_frame or world_frame(setup))}  # the setup's base frame",
        f"          sensor_frame: {json.dumps(options.sensor_frame)}",
        "          tool:",
        f"            CoG: {numbers(tool[1])}  # m, sensor frame",
        f"            gravity_field: {field}  # m/s^2, world frame; of a sensor that reports the {_words(setup)}",
        f"            mass: {number(tool[0])}  # kg",
    ]
    return "\n".join(lines) + "\n"


def ft_calib_text(setup: Setup, options: ExportOptions) -> str:
    """YAML as ``force_torque_sensor_calib`` writes it and ``gravity_compensation`` reads it.

    Both are in kth-ros-pkg/force_torque_tools (config/ft_calib_data_example.yaml, gravity_compensation.cpp):
    compensated = reading - bias - mass * a, where a is the acceleration that the topic ``imu`` has, in the sensor
    frame, and the torque follows from that force at the centre of mass. So ``bias`` is the usual offset, minus the bias
    of this package, and the sign of ``imu`` must be that of the sensor.

    The setup states the tool, and the bias as ``identify --bias`` writes it.

    Raises:
        SetupError: the tool is not stated, or the reading has been compensated already.
    """
    mass, center = _tool_of_the_reading(setup)
    up = "up, as an accelerometer at rest reads" if setup.sensor.reports == REPORTS[0] else "down, as gravity points"
    lines = [
        *_comments(setup),
        f"# the topic imu must have 9.81 m/s^2 {up}, because the sensor reports the {_words(setup)}",
        f"bias: {numbers(-sign_of(setup.sensor.reports) * setup.bias.initial)}  # N, Nm: subtracted from the reading",
        f"gripper_com_frame_id: {json.dumps(options.sensor_frame)}",
        'gripper_com_child_frame_id: "gripper_com"',
        f"gripper_com_pose: {numbers([*center, 0.0, 0.0, 0.0])}  # m, rad, sensor frame",
        f"gripper_mass: {number(mass)}  # kg",
    ]
    return "\n".join(lines) + "\n"


def dump_offsets(bias: Array, reports: str = REPORTS[0], remark: str = "") -> str:
    """YAML text with the offsets that the broadcaster adds to each reading.

    The broadcaster publishes reading + offset (and multiplies afterwards, by 1 unless configured otherwise). The bias
    is what is added to the wrench on the tool, so the offset *is* the bias; a sensor that reports the wrench on itself
    reads the opposite sign, and so its offset is minus the bias.

    Args:
        bias: (6,) N and Nm, the report's sign: unbiased = measured + bias.
        reports: one of REPORTS, as in the setup.
        remark: a line on where the bias comes from.

    Raises:
        ValueError: a bias is not finite, or reports is none of REPORTS.
    """
    if not all(math.isfinite(value) for value in bias) or reports not in REPORTS:
        raise ValueError(f"no offsets for the bias {bias} of a sensor that reports {reports!r}")
    comment = [f"# {printable(remark)}"] if remark else []
    return "\n".join([*comment, *_offset_lines(sign_of(reports) * np.asarray(bias, float))]) + "\n"


def world_frame(setup: Setup) -> str:
    """The usual name of the setup's base frame in TF."""
    model = setup.robot.model
    names = (frame for start, frame in WORLD_FRAMES.items() if model != SCREWS and model.startswith(start))
    return next(names, setup.pose.base if setup.pose and setup.pose.base else "base_link")


def _tool_of_the_reading(setup: Setup) -> tuple[float, Array]:
    """Mass and centre of mass (3,) of the tool, whose weight must be in the reading."""
    tool = require_tool(setup).tool
    if setup.sensor.compensated != "none":
        message = f"{setup.sensor.compensated!r}: the reading has no weight left to subtract"
        remedy = "switch the controller's compensation off, or this one"
        raise SetupError(message, file=setup.path, field="sensor.compensated", remedy=remedy)
    return tool.mass, tool.center_of_mass


def _offset_lines(offset: Iterable[float]) -> list[str]:
    """The offset (6,) N, Nm as a parameter of the broadcaster."""
    x = [number(value) for value in offset]
    return [
        "force_torque_sensor_broadcaster:",
        "  ros__parameters:",
        "    offset:  # N, Nm: added to the reading",
        f"      force: {{x: {x[0]}, y: {x[1]}, z: {x[2]}}}",
        f"      torque: {{x: {x[3]}, y: {x[4]}, z: {x[5]}}}",
    ]


def _words(setup: Setup) -> str:
    return setup.sensor.reports.replace("_", " ")


def _comments(setup: Setup) -> list[str]:
    lines = heading(setup)
    if not np.any(setup.bias.initial):
        lines.append("the setup states no bias (bias.initial), so its offset is zero: ftbias identify --bias finds it")
    return [f"# {line}" for line in lines]
