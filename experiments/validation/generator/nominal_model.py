"""The nominal model (arm, sensor, tool and noise), drawn at random, and the setup file that states it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from validation.generator.arms import Arm, Floats, random_arm


@dataclass(frozen=True)
class Tool:
    """Everything distal of the sensor as one rigid body, in the sensor frame."""

    mass: float
    """kg."""
    com: Floats
    """(3,) m, centre of mass."""
    inertia: Floats
    """(3, 3) kg m^2 about the centre of mass."""


@dataclass(frozen=True)
class Belief:
    """The nominal model as a setup file states it."""

    arm: Arm
    gravity: Floats
    """(3,) m/s^2, base frame."""
    mount_position: Floats
    """(3,) m, sensor origin in the flange frame."""
    mount_rpy: Floats
    """(3,) rad, sensor frame in the flange frame, fixed axes."""
    tool: Tool
    noise_std: Floats
    """(6,) N and Nm, standard deviation of one sample."""
    reports: str
    """"wrench_on_tool" or "wrench_on_sensor" (the opposite sign)."""
    bias_density: Floats
    """(6,) N/s^1.5 and Nm/s^1.5, of the white noise that drives the drift."""
    position_noise_std: float
    """rad, noise of the measured joint positions."""
    velocity_noise_std: float
    """rad/s, noise of the measured joint velocities."""


def random_tool(rng: np.random.Generator) -> Tool:
    """Draw a tool of 0.3 to 2 kg: a box of random size and orientation in front of the sensor."""
    mass = float(np.exp(rng.uniform(np.log(0.3), np.log(2.0))))
    com = np.array([*rng.uniform(-0.02, 0.02, 2), rng.uniform(0.03, 0.12)])
    squared = rng.uniform([0.04, 0.04, 0.06], [0.12, 0.12, 0.22]) ** 2  # edges of the box
    turn = Rotation.random(rng=rng) if rng.uniform() < 0.3 else Rotation.from_rotvec(rng.normal(0, 0.3, 3))
    rotation = turn.as_matrix()
    inertia = rotation @ np.diag(mass / 12 * (squared.sum() - squared)) @ rotation.T
    return Tool(mass, com, inertia)


def random_gravity(rng: np.random.Generator) -> Floats:
    """Draw gravity (3,) m/s^2, base frame: a table mount, or in a fifth of the cases a wall or ceiling mount."""
    pick = rng.uniform()
    if pick < 0.8:
        return np.array([0.0, 0.0, -9.81])
    return np.array([0.0, 0.0, 9.81]) if pick < 0.9 else np.array([0.0, -9.81, 0.0])


def random_belief(rng: np.random.Generator) -> Belief:
    """Draw a robot, a sensor mounting, a tool, and noise of one sample between 0.04 and 0.15 N."""
    yaw = rng.uniform(-np.pi, np.pi)
    rpy = np.array([*rng.normal(0, 0.1, 2), yaw]) if rng.uniform() < 0.7 else rng.uniform(-1.5, 1.5, 3)
    force = np.exp(rng.uniform(np.log(0.04), np.log(0.15)))
    torque = force * np.exp(rng.uniform(np.log(0.03), np.log(0.06)))
    sigma = np.repeat([force, torque], 3) * (rng.uniform(0.7, 1.4, 6) if rng.uniform() < 0.5 else np.ones(6))
    density = rng.uniform(0.5, 2.0) * np.repeat([2e-4, 1e-5], 3)
    return Belief(
        arm=random_arm(rng),
        gravity=random_gravity(rng),
        mount_position=np.array([*rng.uniform(-0.02, 0.02, 2), rng.uniform(0.0, 0.06)]),
        mount_rpy=rpy,
        tool=random_tool(rng),
        noise_std=sigma,
        reports="wrench_on_sensor" if rng.uniform() < 0.2 else "wrench_on_tool",
        bias_density=density,
        position_noise_std=float(np.exp(rng.uniform(np.log(8e-6), np.log(3e-5)))),
        velocity_noise_std=float(np.exp(rng.uniform(np.log(4e-4), np.log(1.5e-3)))),
    )


def _row(values: Floats | list[float]) -> str:
    return "[" + ", ".join(f"{value:.9g}" for value in values) + "]"


def _robot_section(belief: Belief) -> str:
    arm = belief.arm
    if arm.name == "panda":
        return f'[robot]\nmodel = "panda"\ngravity = {_row(belief.gravity)}   # m/s^2, base frame\n'
    rpy = Rotation.from_matrix(arm.flange_rotation).as_euler("xyz")
    lines = ["[robot]", f"gravity = {_row(belief.gravity)}   # m/s^2, base frame", "", "[robot.flange]"]
    lines += [f"translation = {_row(arm.flange_position)}   # m", f"rotation_rpy = {_row(rpy)}   # rad"]
    for axis, point in zip(arm.axes, arm.points, strict=True):
        lines += ["", "[[robot.joints]]", f"axis = {_row(axis)}", f"point = {_row(point)}   # m"]
    return "\n".join(lines) + "\n"


def setup_toml(belief: Belief) -> str:
    """Return the text of the setup file of ``belief`` as a user would write it."""
    inertia = belief.tool.inertia
    return f"""# What the robot's owner believes: robot, sensor mounting, tool, noise.
{_robot_section(belief)}
[sensor]
translation = {_row(belief.mount_position)}   # m, sensor origin in the flange frame
rotation_rpy = {_row(belief.mount_rpy)}   # rad, fixed-axis roll-pitch-yaw, sensor frame in the flange frame
noise_std = {_row(belief.noise_std)}   # N, N, N, Nm, Nm, Nm
reports = "{belief.reports}"

[tool]
mass = {belief.tool.mass:.9g}   # kg, everything distal of the sensor
center_of_mass = {_row(belief.tool.com)}   # m, sensor frame
inertia = {_row(list(inertia[np.triu_indices(3)]))}   # kg m^2: Ixx Ixy Ixz Iyy Iyz Izz about the centre of mass

[bias]   # W = D theta - b + noise; b drifts as integrated white noise on its rate
noise_density = {_row(belief.bias_density)}   # sigma_Q: N/s^1.5, Nm/s^1.5
initial_std = [5.0, 5.0, 5.0, 0.5, 0.5, 0.5]   # N, Nm
initial_drift_std = [0.01, 0.01, 0.01, 5e-4, 5e-4, 5e-4]   # N/s, Nm/s

[joints]
position_noise_std = {belief.position_noise_std:.9g}   # rad
velocity_noise_std = {belief.velocity_noise_std:.9g}   # rad/s
"""
