"""Simulated logs of several arms, rates, tools and motions, with the tables of their right setup."""

import copy

import numpy as np

import ftbias_jax as ft
from ftbias_jax.check.motion import arm_motion, in_sensor

SIX_AXES = {
    "flange": {"translation": [0.82, 0.23, 0.06], "rotation_rpy": [-1.5708, 0.0, 0.0]},
    "joints": [
        {"axis": [0, 0, 1], "point": [0, 0, 0]},
        {"axis": [0, 1, 0], "point": [0, 0, 0.16]},
        {"axis": [0, 1, 0], "point": [0.42, 0, 0.16]},
        {"axis": [0, 1, 0], "point": [0.82, 0, 0.16]},
        {"axis": [0, 0, -1], "point": [0.82, 0.13, 0]},
        {"axis": [0, 1, 0], "point": [0.82, 0, 0.06]},
    ],
}
"""Arm with the geometry of a UR5."""
FOUR_AXES = {
    "flange": {"translation": [0.7, 0.0, 0.9], "rotation_rpy": [0.0, 1.5708, 0.0]},
    "joints": [
        {"axis": [0, 0, 1], "point": [0, 0, 0]},
        {"axis": [1, 0, 0], "point": [0, 0, 0], "type": "prismatic"},
        {"axis": [0, 1, 0], "point": [0.3, 0, 0.9]},
        {"axis": [1, 0, 0], "point": [0.3, 0, 0.9]},
    ],
}
"""Arm with a rotating column, a prismatic joint and a wrist of two axes."""
ARMS = {"panda": {"model": "panda"}, "six axes": SIX_AXES, "four axes": FOUR_AXES}
SHAPES = (
    ("panda", "sines", 250.0, 30.0, 1),
    ("six axes", "sines", 125.0, 40.0, 1),
    ("panda", "moves", 100.0, 60.0, 1),
    ("four axes", "sines", 500.0, 20.0, 50),
    ("six axes", "sines", 7000.0, 6.0, 1),
)
"""Arm, motion, rate in Hz, duration in s, and number of joint samples per wrench sample."""


def random_tables(arm, rng):
    """Random tables of the setup that a log is simulated with."""
    angles = [180.0 * rng.integers(2), 0.0, float(rng.choice([30.0, 45.0, 90.0, -135.0, 180.0]))]
    mass = float(rng.uniform(0.3, 3.0))
    center = [*rng.uniform(-0.02, 0.02, 2).tolist(), float(rng.uniform(0.03, 0.12))]
    size = mass * rng.uniform(0.02, 0.05) ** 2
    noise = rng.uniform(0.02, 0.2)
    return {
        "robot": copy.deepcopy(ARMS[arm]),
        "sensor": {
            "translation": [0.0, 0.0, 0.04],
            "rotation_rpy": np.radians(angles).tolist(),
            "noise_std": [noise, noise / 25],
            "reports": str(rng.choice(["wrench_on_tool", "wrench_on_sensor"])),
        },
        "tool": {"mass": mass, "center_of_mass": center, "inertia": [size, 0.0, 0.0, size, 0.0, size / 2]},
        "bias": {"initial_drift_std": [0.02, 1e-3]},
        "joints": {"position_noise_std": 2e-5, "velocity_noise_std": 1e-3},
    }


def simulated(shape, seed):
    """Simulate a log; return the tables of its right setup and its arrays.

    Args:
        shape: an entry of SHAPES.
        seed: seed of the log; the same seed makes the same log.
    """
    arm, motion, rate, duration, every = shape
    rng = np.random.default_rng(seed)
    tables = random_tables(arm, rng)
    setup = ft.parse_setup(tables)
    log = ft.simulate(setup, duration=duration, rate=rate, motion=motion, seed=seed).log
    sign = 1.0 if tables["sensor"]["reports"] == "wrench_on_tool" else -1.0
    wrench = np.where((np.arange(len(log.t)) % every == 0)[:, None], sign * log.wrench, np.nan)
    arrays = {"t": log.t, "q": log.q, "wrench": wrench}
    if rng.uniform() < 0.7:
        arrays["dq"] = log.dq
    return tables, arrays


def as_pose(tables, arrays, rng):
    """Convert a log into a recording of the flange's pose with a gyroscope; return tables and arrays."""
    setup = ft.parse_setup(tables)
    robot, bare = setup.robot, copy.copy(setup.sensor)
    object.__setattr__(bare, "translation", np.zeros(3))
    object.__setattr__(bare, "rotation", np.eye(3))
    q = arrays["q"]
    dq = arrays.get("dq", np.gradient(q, arrays["t"], axis=0))
    motion = arm_motion(robot, bare, q, dq, np.zeros_like(q))
    at_sensor = arm_motion(robot, setup.sensor, q, dq, np.zeros_like(q))
    pose = {name: value for name, value in tables.items() if name not in ("robot", "joints")}
    pose |= {"robot": {}, "sensor_pose": {"orientation": "quaternion_xyzw", "linear": "position"}}
    quaternion = _quaternions(motion.rotation)[:, [1, 2, 3, 0]] + 1e-5 * rng.normal(size=(len(q), 4))
    return pose, {
        "t": arrays["t"],
        "wrench": arrays["wrench"],
        "orientation": quaternion,
        "position": motion.position + 1e-5 * rng.normal(size=(len(q), 3)),
        "angular_velocity": in_sensor(at_sensor, at_sensor.velocity) + 1e-3 * rng.normal(size=(len(q), 3)),
    }


def _quaternions(matrices):
    from ftbias_jax.io.pose import continuous, quaternions_of

    return continuous(quaternions_of(matrices))
