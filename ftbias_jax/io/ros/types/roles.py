"""What messages are to a log: which types tell of joints, wrench, pose, IMU or temperature, and in which fields."""

from __future__ import annotations

from typing import NamedTuple

from ftbias_jax.io.ros.messages import JOINT_STATE, POSE_STAMPED, TF, WRENCH_STAMPED

JOINTS, WRENCH, POSE, TRANSFORM, IMU, TEMPERATURE = "joints", "wrench", "pose", "transform", "imu", "temperature"
POSITION, VELOCITY = "position", "velocity"
"""Of joints or of a pose, by fields that the setup names."""
BY_FIELD = (POSITION, VELOCITY, WRENCH, TEMPERATURE, IMU)
"""Roles for which [log.topics] may name a field."""

FRANKA1, FRANKA2 = "franka_msgs/FrankaState", "franka_msgs/FrankaRobotState"


class Source(NamedTuple):
    """What a type has for one role."""

    role: str
    fields: str
    """Paths by commas; "" = its own reader."""
    rank: int = 0
    """Of several topics for a role, those of the lowest rank are meant, unless the setup names another."""


SOURCES: dict[str, tuple[Source, ...]] = {
    JOINT_STATE: (Source(JOINTS, ""),),
    WRENCH_STAMPED: (Source(WRENCH, ""),),
    POSE_STAMPED: (Source(POSE, ""),),
    TF: (Source(TRANSFORM, ""),),
    "geometry_msgs/Wrench": (Source(WRENCH, "force,torque", 1),),
    # The robot's own estimate: the controller has taken its payload off, and it is of the frame K or EE.
    FRANKA1: (Source(JOINTS, "q,dq", 1), Source(WRENCH, "K_F_ext_hat_K", 2)),
    FRANKA2: (
        Source(JOINTS, "measured_joint_state.position,measured_joint_state.velocity", 1),
        Source(WRENCH, "k_f_ext_hat_k.wrench", 2),
    ),
    "sensor_msgs/Imu": (Source(IMU, "angular_velocity,linear_acceleration"),),
    # Accelerometers publish what they feel, which is the specific force, in these types.
    "geometry_msgs/AccelStamped": (Source(IMU, "accel.linear", 1),),
    "geometry_msgs/AccelWithCovarianceStamped": (Source(IMU, "accel.accel.linear", 1),),
    "geometry_msgs/Accel": (Source(IMU, "linear", 2),),
    "sensor_msgs/Temperature": (Source(TEMPERATURE, "temperature"),),
}
"""Plain type -> its roles."""


def types_with(role: str) -> str:
    """The types that have a role, in words."""
    return " or ".join(kind for kind, sources in SOURCES.items() if any(source.role == role for source in sources))
