"""A small log for the tests of the check: an arm of six axes that swings, as arrays and tables, without JAX."""

import copy

import numpy as np

import ftbias_jax as ft
from ftbias_jax.check.motion import arm_motion, data_matrices
from ftbias_jax.check.regression import stated_tool

TABLES = {
    "robot": {
        "flange": {"translation": [0.82, 0.23, 0.06], "rotation_rpy": [-1.5708, 0.0, 0.0]},
        "joints": [
            {"axis": [0, 0, 1], "point": [0, 0, 0]},
            {"axis": [0, 1, 0], "point": [0, 0, 0.16]},
            {"axis": [0, 1, 0], "point": [0.42, 0, 0.16]},
            {"axis": [0, 1, 0], "point": [0.82, 0, 0.16]},
            {"axis": [0, 0, -1], "point": [0.82, 0.13, 0]},
            {"axis": [0, 1, 0], "point": [0.82, 0, 0.06]},
        ],
    },
    "sensor": {"rotation_rpy": [0.0, 0.0, 0.5235987755982988], "noise_std": [0.1, 0.004]},
    "tool": {"mass": 0.8, "center_of_mass": [0.01, -0.005, 0.06], "inertia": [2e-3, 0, 0, 2e-3, 0, 1e-3]},
    "joints": {"position_noise_std": 2e-5, "velocity_noise_std": 1e-3},
}
BIAS = np.array([2.0, -1.0, 3.0, 0.1, -0.2, 0.05])


def motion_of_joints(t, seed=0):
    """q, dq and ddq (T, 6) of motions that are sums of sines."""
    rng = np.random.default_rng(seed)
    omega = 2 * np.pi * rng.uniform(0.05, 0.3, (3, 6))
    size, phase = rng.uniform(0.1, 0.35, (3, 6)), rng.uniform(0, 6, (3, 6))
    angle = omega * t[:, None, None] + phase
    return (
        (size * np.sin(angle)).sum(1),
        (size * omega * np.cos(angle)).sum(1),
        (-size * omega**2 * np.sin(angle)).sum(1),
    )


def right_log(seed=0, duration=30.0, rate=100.0, **other_tables):
    """Tables of a setup, and arrays of a log that agrees with it."""
    rng, tables = np.random.default_rng(seed), copy.deepcopy({**TABLES, **other_tables})
    setup = ft.parse_setup(tables)
    t = np.arange(0, duration, 1 / rate)
    q, dq, ddq = motion_of_joints(t, seed)
    motion = arm_motion(setup.robot, setup.sensor, q, dq, ddq)
    wrench = data_matrices(motion, setup.robot.gravity) @ stated_tool(setup.tool).theta - BIAS
    noise = setup.sensor.noise_std * rng.normal(size=wrench.shape)
    arrays = {"q": q + 2e-5 * rng.normal(size=q.shape), "dq": dq + 1e-3 * rng.normal(size=q.shape)}
    return tables, {"t": t, "wrench": wrench + noise, **arrays}


def log_with_rests(seed, rests, duration=40.0, rate=100.0):
    """The same with an arm that rests from time to time; also the tool's wrench (T, 6) and the motion of the sensor.

    Args:
        seed: of the motion, noise and bias.
        rests: (start, end) in s of each rest; the arm stops and starts within half a second outside it.
        duration: s.
        rate: Hz.
    """
    rng, tables = np.random.default_rng(seed), copy.deepcopy(TABLES)
    setup = ft.parse_setup(tables)
    t = np.arange(0, duration, 1 / rate)
    speed = np.ones(len(t))
    for start, end in rests:
        speed *= np.clip(np.maximum((start - t) / 0.5, (t - end) / 0.5), 0, 1)
    q, dq, ddq = motion_of_joints(np.cumsum(speed) / rate, seed)
    speed, growth = speed[:, None], np.gradient(speed, t)[:, None]
    dq, ddq = dq * speed, ddq * speed**2 + dq * growth
    motion = arm_motion(setup.robot, setup.sensor, q, dq, ddq)
    tool = data_matrices(motion, setup.robot.gravity) @ stated_tool(setup.tool).theta
    wrench = tool - BIAS + setup.sensor.noise_std * rng.normal(size=tool.shape)
    arrays = {"q": q + 2e-5 * rng.normal(size=q.shape), "dq": dq + 1e-3 * rng.normal(size=q.shape)}
    return tables, {"t": t, "wrench": wrench, **arrays}, tool, motion


def static_poses(seed=0, count=24, **sections):
    """Tables of a setup, and arrays of readings at rest that agree with it."""
    rng, tables = np.random.default_rng(seed), {**copy.deepcopy(TABLES), **sections}
    setup = ft.parse_setup(tables)
    q = rng.uniform(-1.5, 1.5, (count, 6))
    motion = arm_motion(setup.robot, setup.sensor, q, 0 * q, 0 * q)
    wrench = data_matrices(motion, setup.robot.gravity) @ stated_tool(setup.tool).theta - BIAS
    return tables, {"q": q, "wrench": wrench + setup.sensor.noise_std * rng.normal(size=wrench.shape)}


def checked_poses(tables, arrays):
    """Result of checking static poses."""
    setup = ft.parse_setup(tables)
    return ft.check_setup(setup, [ft.Poses.from_arrays(setup, **arrays)])


def checked(tables, arrays):
    """Result of checking a log."""
    setup = ft.parse_setup(tables)
    return ft.check_setup(setup, [ft.Log.from_arrays(setup, **arrays)])
