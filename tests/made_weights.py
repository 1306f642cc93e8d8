"""Logs of a robot that holds a tool still in many poses, computed without the package's kinematics."""

import numpy as np
from scipy.linalg import expm

from ftbias_jax.setup.robots import built_in_robot

MASS, CENTER = 0.93, np.array([0.01, -0.005, 0.044])
BIAS = np.array([3.0, -2.0, 5.0, 0.3, -0.2, 0.1])
GRAVITY = np.array([0.0, 0.0, -9.81])


def rotations(robot, q):
    """(T, 3, 3) flange in the base frame, by matrix exponentials."""
    turned = []
    for angles in q:
        rotation = np.eye(3)
        for screw, angle in zip(robot.screws, angles, strict=True):
            x, y, z = screw[3:] * angle
            rotation = rotation @ expm(np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]))
        turned.append(rotation @ robot.flange_rotation)
    return np.array(turned)


def readings(turned, noise=0.05, seed=0, sign=1.0):
    """(T, 6) reading of a sensor at the flange that carries the tool."""
    force = -MASS * np.einsum("tji,j->ti", turned, GRAVITY)
    wrench = np.concatenate([force, np.cross(CENTER, force)], 1)
    scale = noise * np.array([1, 1, 1, 0.04, 0.04, 0.04])
    return sign * wrench - BIAS + np.random.default_rng(seed).normal(size=wrench.shape) * scale


def arm_log(name="ur5e", samples=400, **options):
    """t, q and wrench of a built-in robot, 50 Hz."""
    robot = built_in_robot(name)
    t = np.arange(samples) / 50
    phases = np.arange(len(robot.joint_names))
    q = 0.8 * np.sin(0.7 * t[:, None] + phases) - 0.3
    return t, q, readings(rotations(robot, q), **options)
