"""Simulated static poses of five arms, as in the standard calibration, with a right setup except for its tool."""

import numpy as np
from logs import SIX_AXES
from mistakes import MISTAKES

import ftbias_jax as ft
from ftbias_jax.check.motion import arm_motion, data_matrices
from ftbias_jax.check.regression import stated_tool

ARMS = {
    "panda": {"model": "panda"},
    "iiwa7": {"model": "iiwa7"},
    "ur5e": {"model": "ur5e"},
    "ur10e": {"model": "ur10e"},
    "six axes": SIX_AXES,
}
KINDS = {"sign", "gravity", "wrench_units", "tool_units", "angle_units", "force_torque_swapped", "sensor_axes"}
"""Mistakes that readings at rest can show."""
OF_TOOL = {"wrench_units", "tool_units"}
"""Mistakes that can be found only if a tool is stated."""
FEWEST, MOST = 17, 100
"""Smallest and largest number of poses of a log."""


def _gravity(rng):
    """Random gravity: along -z, along any base axis, or in any direction, because the arm may be mounted anywhere."""
    kind = rng.integers(3)
    if kind == 0:
        return np.array([0.0, 0.0, -9.81])
    if kind == 1:
        return 9.81 * rng.choice([-1, 1]) * np.eye(3)[rng.integers(3)] + 0.0
    down = rng.normal(size=3)
    return 9.81 * down / np.linalg.norm(down)


def mistakes_of(tables):
    """Select those of ``MISTAKES`` that readings at rest can show with this setup, and that change the setup."""
    floor = tables["robot"]["gravity"]
    same = {"gravity up": [0.0, 0.0, 9.81], "gravity along x": [9.81, 0.0, 0.0]}
    return {
        name: (expected, change)
        for name, (expected, change) in MISTAKES.items()
        if expected in KINDS
        and (expected not in OF_TOOL or "tool" in tables)
        and not (name in same and np.allclose(same[name], floor))
        and (name != "rpy in degrees" or np.any(tables["sensor"]["rotation_rpy"]))
    }


def simulated(arm, seed):
    """Simulate static poses; return tables and arrays, with a right setup except for a tool mass known to 10 %.

    Args:
        arm: one of ARMS.
        seed: seed of the poses; the same seed makes the same poses.
    """
    rng = np.random.default_rng([seed, list(ARMS).index(arm)])
    noise = float(rng.uniform(0.02, 0.2))
    mass = float(rng.uniform(0.3, 3.0))
    tables = {
        "robot": {**ARMS[arm], "gravity": _gravity(rng).tolist()},
        "sensor": {
            "rotation_rpy": np.radians([180.0 * rng.integers(2), 0.0, 45.0 * rng.integers(8)]).tolist(),
            "noise_std": [noise, noise / 25],
            "reports": str(rng.choice(["wrench_on_tool", "wrench_on_sensor"])),
        },
        "tool": {
            "mass": mass,
            "center_of_mass": [*rng.uniform(-0.02, 0.02, 2).tolist(), float(rng.uniform(0.03, 0.12))],
        },
    }
    setup = ft.parse_setup(tables)
    count = int(rng.integers(FEWEST, MOST + 1))
    q = rng.uniform(-1, 1, setup.robot.screws.shape[0]) + rng.uniform(-1.5, 1.5, (count, len(setup.robot.screws)))
    rest = np.zeros_like(q)
    weight = data_matrices(arm_motion(setup.robot, setup.sensor, q, rest, rest), setup.robot.gravity)
    wrench = weight @ stated_tool(setup.tool).theta * rng.uniform(0.95, 1.05, 6)
    scale = np.repeat([1.0, 0.04], 3)
    bias = scale * rng.normal(0, 3, 6)
    drift = scale * rng.choice([0.0, noise / 2]) * rng.normal(size=(count, 6)).cumsum(0)
    wrench = wrench + bias + drift + np.repeat([noise, noise / 25], 3) * rng.normal(size=(count, 6))
    sign = 1.0 if setup.sensor.reports == "wrench_on_tool" else -1.0
    tables["tool"]["mass"] *= float(rng.uniform(0.9, 1.1))
    center = np.array(tables["tool"]["center_of_mass"]) + rng.uniform(-0.01, 0.01, 3)
    tables["tool"]["center_of_mass"] = center.tolist()
    if rng.uniform() < 0.3:  # nobody has weighed the tool yet
        del tables["tool"]
    arrays = {"q": q, "wrench": sign * wrench}
    if rng.uniform() < 0.5:
        arrays["t"] = 1.7e9 + np.cumsum(rng.uniform(4.0, 60.0, count))
    return tables, arrays
