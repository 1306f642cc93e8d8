"""A planned motion as robots' controllers take it: ROS 2, Universal Robots, Franka."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

import numpy as np

from ftbias_jax.errors import UsageError, printable
from ftbias_jax.planning.limits import NOT_KNOWN
from ftbias_jax.planning.shape import Motion
from ftbias_jax.setup.export.payload import heading
from ftbias_jax.setup.types import Setup

if TYPE_CHECKING:
    from ftbias_jax.planning.result import Plan

ROS_RATE, UR_RATE, FRANKA_RATE = 50.0, 125.0, 1000.0
"""Points a second: ROS's joint trajectory controller joins them by quintic splines, servoj of a UR smooths over several
of them, libfranka asks for one a millisecond."""
DIGITS = 10
APPROACH = "movej({q}, a=0.5, v=0.3)  # slowly to the first pose"


def ros_trajectory(plan: Plan) -> str:
    """YAML of a trajectory_msgs/msg/JointTrajectory, with the joints' names of the setup."""
    motion = _sampled(plan, ROS_RATE)
    lines = [
        *_comments(plan, "trajectory_msgs/msg/JointTrajectory, rad, rad/s, rad/s^2"),
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


FORMATS: dict[str, Callable[[Plan], str]] = {"ros": ros_trajectory, "ur": ur_script, "franka": franka_joints}
JOINTS = {"ur": (6, "a robot of Universal Robots"), "franka": (7, "a Franka arm")}
"""How many joints the robots of a format have."""


def check_controllers(setup: Setup, formats: Iterable[str]) -> None:
    """Refuse formats of robots that the setup's arm is not.

    Args:
        setup: with the arm.
        formats: keys of FORMATS.

    Raises:
        UsageError: there is no such format, or the arm has another number of joints.
    """
    n = len(setup.robot.joint_names)
    for name in formats:
        if name not in FORMATS:
            raise UsageError(f"got {name!r}", field="format", remedy=f"give one of {', '.join(FORMATS)}")
        joints, robot = JOINTS.get(name, (n, ""))
        if n != joints:
            message = f"the setup's arm has {n} joints, {robot} has {joints}"
            raise UsageError(message, field=f"--{name}", remedy="leave it out")


def _sampled(plan: Plan, rate: float) -> Motion:
    """The motion at so many points a second, both ends included."""
    count = int(np.ceil(plan.options.duration * rate))
    return plan.at(np.minimum(np.arange(count + 1) / rate, plan.options.duration))


def _comments(plan: Plan, kind: str) -> list[str]:
    """What stands at the head of a file for a controller."""
    first = ", ".join(f"{x:.4f}" for x in plan.motion.q[0])
    words = [kind, *heading(plan.setup), f"starts and ends at rest at [{first}] rad: be there first", NOT_KNOWN]
    return [f"# {printable(line)}" for line in words]


def _row(values: Iterable[float]) -> str:
    return "[" + ", ".join(f"{value:.{DIGITS}g}" for value in np.round(np.asarray(values), DIGITS) + 0.0) + "]"
