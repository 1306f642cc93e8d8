"""Definitions of common types, where a recording brings none: SQLite bags do so since ROS 2 Iron."""

from __future__ import annotations

import importlib
from typing import Any

from ftbias_jax.io.ros.raw import Definition
from ftbias_jax.io.ros.types.definition import Types, parse_msg
from ftbias_jax.io.ros.types.idl import parse_idl

_VECTOR = "float64 x\nfloat64 y\nfloat64 z"
COMMON = {
    "geometry_msgs/Vector3": _VECTOR,
    "geometry_msgs/Quaternion": f"{_VECTOR}\nfloat64 w",
    "geometry_msgs/Wrench": "Vector3 force\nVector3 torque",
    "geometry_msgs/WrenchStamped": "std_msgs/Header header\nWrench wrench",
    "geometry_msgs/Accel": "Vector3 linear\nVector3 angular",
    "geometry_msgs/AccelStamped": "std_msgs/Header header\nAccel accel",
    "geometry_msgs/AccelWithCovariance": "Accel accel\nfloat64[36] covariance",
    "geometry_msgs/AccelWithCovarianceStamped": "std_msgs/Header header\nAccelWithCovariance accel",
    "sensor_msgs/Temperature": "std_msgs/Header header\nfloat64 temperature\nfloat64 variance",
    "sensor_msgs/Imu": "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\n"
    "float64[9] orientation_covariance\ngeometry_msgs/Vector3 angular_velocity\n"
    "float64[9] angular_velocity_covariance\ngeometry_msgs/Vector3 linear_acceleration\n"
    "float64[9] linear_acceleration_covariance",
    "sensor_msgs/JointState": "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n"
    "float64[] effort",
    "std_msgs/Float64": "float64 data",
    "std_msgs/Float32": "float32 data",
}
_RULE = "\n" + "=" * 80 + "\n"
STORES = ("ROS2_HUMBLE", "LATEST")
"""Of the package rosbags, which is asked for types of ROS 2 that are not common, if it is installed."""


def types_of(message_type: str, encoding: str, definition: Definition) -> Types | None:
    """The types that a message is made of; None if nobody says."""
    ros1 = encoding == "ros1"
    if definition.text.strip():
        if definition.format == "ros2idl":
            return parse_idl(definition.text, message_type)
        return parse_msg(definition.text, message_type, ros1)
    if message_type in COMMON:
        others = [f"MSG: {name}\n{text}" for name, text in COMMON.items() if name != message_type]
        return parse_msg(_RULE.join([COMMON[message_type], *others]), message_type, ros1)
    return None if ros1 else _by_rosbags(message_type)


def _by_rosbags(message_type: str) -> Types | None:
    """The definition that the package rosbags has of a type of ROS 2; None without the package, or the type."""
    try:
        typesys: Any = importlib.import_module("rosbags.typesys")
    except ImportError:
        return None
    package, _, name = message_type.rpartition("/")
    for store in STORES:
        known = typesys.get_typestore(typesys.Stores[store])
        full = f"{package}/msg/{name}"
        if full in known.types:
            text, _ = known.generate_msgdef(full, ros_version=2)
            return parse_msg(text, message_type, ros1=False)
    return None
