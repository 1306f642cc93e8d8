"""Export of a planned motion to robot controllers: ROS 2, Universal Robots, Franka."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Iterable
from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np

from ftbias_jax.errors import UsageError, printable
from ftbias_jax.io.budget import need
from ftbias_jax.io.write.mcap import CDR, schema_with_header
from ftbias_jax.planning.limits import NOT_KNOWN
from ftbias_jax.planning.shape import Motion
from ftbias_jax.setup.export.payload import heading
from ftbias_jax.setup.types import Setup

if TYPE_CHECKING:
    from ftbias_jax.planning.result import Plan

ROS_RATE, UR_RATE, FRANKA_RATE = 50.0, 125.0, 1000.0
"""Points per second: ROS's joint trajectory controller interpolates by quintic splines, servoj of a UR smooths over
several points, libfranka requests one per millisecond."""
DIGITS = 10
TOPIC, TRAJECTORY = "/joint_trajectory_controller/joint_trajectory", "trajectory_msgs/msg/JointTrajectory"
"""Default topic of the joint trajectory controller of ros2_control, and its message type."""
SCHEMA = schema_with_header(
    "std_msgs/Header header\nstring[] joint_names\nJointTrajectoryPoint[] points\n",
    "trajectory_msgs/JointTrajectoryPoint\nfloat64[] positions\nfloat64[] velocities\nfloat64[] accelerations\n"
    "float64[] effort\nbuiltin_interfaces/Duration time_from_start\n",
    "builtin_interfaces/Duration\nint32 sec\nuint32 nanosec\n",
)
APPROACH = "movej({q}, a=0.5, v=0.3)  # slowly to the first pose"


def ros_trajectory(plan: Plan) -> str:
    """YAML of a trajectory_msgs/msg/JointTrajectory, with the joints' names of the setup."""
    motion = _sampled(plan, ROS_RATE)
    lines = [
        *_comments(plan, f"{TRAJECTORY}, rad, rad/s, rad/s^2"),
        'header: {stamp: {sec: 0, nanosec: 0}, frame_id: ""}',
        f"joint_names: {json.dumps(list(plan.setup.robot.joint_names))}",
        "points:",
    ]
    for t, q, dq, ddq, _ in zip(*motion, strict=True):
        seconds, nanoseconds = divmod(round(t * 1e9), 10**9)
        lines += [
            f"- positions: {_row(q)}",
            f"  velocities: {_row(dq)}",
            f"  accelerations: {_row(ddq)}",
            f"  time_from_start: {{sec: {seconds}, nanosec: {nanoseconds}}}",
        ]
    return "\n".join(lines) + "\n"


def ros_bag(plan: Plan) -> bytes:
    """Recording (MCAP) of a single JointTrajectory message, for ``ros2 bag play``."""
    message = bytearray()  # CDR, little endian: numbers are aligned to their size

    def put(kind: str, *values: float) -> None:
        message.extend(bytes(-len(message) % struct.calcsize(kind)) + struct.pack(f"<{len(values)}{kind}", *values))

    def put_text(text: str) -> None:
        put("I", len(text.encode()) + 1)
        message.extend(text.encode() + b"\0")

    names, motion = plan.setup.robot.joint_names, _sampled(plan, ROS_RATE)
    put("I", 0, 0)  # a zero stamp: start immediately
    put_text("")
    put("I", len(names))
    for name in names:
        put_text(name)
    put("I", len(motion.t))
    for t, *rows, _ in zip(*motion, strict=True):
        for row in rows:
            put("I", len(row))
            put("d", *row)
        put("I", 0, *divmod(round(t * 1e9), 10**9))  # no effort
    file, about = BytesIO(), _comments(plan, TRAJECTORY)
    writer = need("mcap.writer", "ros", writes=True).Writer(file)
    writer.start(profile="ros2", library=heading(plan.setup)[0])
    schema = writer.register_schema(TRAJECTORY, "ros2msg", SCHEMA.encode())
    channel = writer.register_channel(TOPIC, "cdr", schema, {"about": "\n".join(about)})
    writer.add_message(channel, 0, CDR + bytes(message), 0)
    writer.finish()
    return file.getvalue()


def ur_script(plan: Plan) -> str:
    """URScript that moves slowly to the first pose and then follows the motion by servoj."""
    motion = _sampled(plan, UR_RATE)
    lines = [
        *_comments(plan, "URScript"),
        "def ftbias_motion():",
        f"  {APPROACH.format(q=_row(motion.q[0]))}",
        "  sleep(1.0)",
    ]
    lines += [f"  servoj({_row(q)}, t={1 / UR_RATE:g}, lookahead_time=0.1, gain=300)" for q in motion.q]
    return "\n".join([*lines, "  stopj(0.5)", "end", "ftbias_motion()"]) + "\n"


def franka_joints(plan: Plan) -> str:
    """JSON with one joint position and velocity a millisecond, as a control loop of libfranka returns them."""
    motion = _sampled(plan, FRANKA_RATE)
    q, dq = ([[float(x) for x in row] for row in np.round(values, DIGITS)] for values in (motion.q, motion.dq))
    about = [*heading(plan.setup), NOT_KNOWN]
    content = {"about": about, "rate": FRANKA_RATE, "joint_names": list(plan.setup.robot.joint_names), "q": q, "dq": dq}
    return json.dumps(content, separators=(",", ":")) + "\n"


FORMATS: dict[str, Callable[[Plan], str | bytes]] = {
    "ros": ros_trajectory,
    "bag": ros_bag,
    "ur": ur_script,
    "franka": franka_joints,
}
JOINTS = {"ur": (6, "a robot of Universal Robots"), "franka": (7, "a Franka arm")}
"""Number of joints, and description, of the robots of a format."""


def check_controllers(setup: Setup, formats: Iterable[str]) -> None:
    """Raise an error for formats (keys of FORMATS) of robots other than the setup's arm.

    Raises:
        UsageError: there is no such format, or the arm has another number of joints. OutputError: the package that
            writes it is missing.
    """
    n = len(setup.robot.joint_names)
    for name in formats:
        if name not in FORMATS:
            raise UsageError(f"got {name!r}", field="format", remedy=f"give one of {', '.join(FORMATS)}")
        if name == "bag":
            need("mcap.writer", "ros", "--bag", writes=True)
        joints, robot = JOINTS.get(name, (n, ""))
        if n != joints:
            message = f"the setup's arm has {n} joints, {robot} has {joints}"
            raise UsageError(message, field=f"--{name}", remedy="leave it out")


def _sampled(plan: Plan, rate: float) -> Motion:
    """Sample the motion at ``rate`` points per second, both ends included."""
    count = int(np.ceil(plan.options.duration * rate))
    return plan.at(np.minimum(np.arange(count + 1) / rate, plan.options.duration))


def _comments(plan: Plan, kind: str) -> list[str]:
    """Header comments of a file for a controller."""
    first = ", ".join(f"{x:.4f}" for x in plan.motion.q[0])
    words = [kind, *heading(plan.setup), f"starts and ends at rest at [{first}] rad: be there first", NOT_KNOWN]
    return [f"# {printable(line)}" for line in words]


def _row(values: Iterable[float]) -> str:
    return "[" + ", ".join(f"{value:.{DIGITS}g}" for value in np.round(np.asarray(values), DIGITS) + 0.0) + "]"
