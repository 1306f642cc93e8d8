"""Rotation matrices from roll, pitch and yaw, and back, in NumPy float64."""

from __future__ import annotations

import numpy as np

from ftbias_jax.types import Array


def rotation_from_rpy(rpy: Array) -> Array:
    """R = Rz(yaw) Ry(pitch) Rx(roll): turns about the fixed x, then y, then z axis.

    Args:
        rpy: (3,) rad.

    Returns:
        (3, 3); its columns are the axes of the turned frame in the fixed one.
    """
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def rpy_from_rotation(rotation: Array) -> Array:
    """Roll, pitch and yaw whose ``rotation_from_rpy`` is the given rotation, to round-off at any pitch.

    Args:
        rotation: (3, 3), orthogonal with determinant 1.

    Returns:
        (3,) rad, pitch within +-pi/2.
    """
    R = rotation
    yaw = np.arctan2(R[1, 0], R[0, 0])
    pitch = np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0]))
    # Near pitch = +-pi/2 yaw is mostly round-off; a roll that undoes exactly this yaw keeps the product right.
    s, c = np.sin(yaw), np.cos(yaw)
    roll = np.arctan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    return np.array([roll, pitch, yaw])
