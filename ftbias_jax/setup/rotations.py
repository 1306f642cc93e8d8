"""Rotation matrices from roll, pitch and yaw, and back, in NumPy float64."""

import numpy as np

from ftbias_jax.types import Array


def rotation_from_rpy(rpy: Array) -> Array:
    """R = Rz(yaw) Ry(pitch) Rx(roll) of (3,) rad: turns about the fixed x, then y, then z axis.

    The columns of the (3, 3) are the axes of the turned frame in the fixed one.
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
    """Roll, pitch and yaw (3,) rad whose ``rotation_from_rpy`` is the given (3, 3), to round-off at any pitch.

    Pitch is within +-pi/2, roll and yaw in (-pi, pi].
    """
    R = rotation
    yaw = np.arctan2(R[1, 0], R[0, 0])
    pitch = np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0]))
    # Near pitch = +-pi/2 yaw is mostly round-off; a roll that undoes exactly this yaw keeps the product right.
    s, c = np.sin(yaw), np.cos(yaw)
    roll = np.arctan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    angles = np.array([roll, pitch, yaw])
    return np.where(angles <= -np.pi, np.pi, angles)


_GENERATORS = np.cross(np.eye(3)[:, None], np.eye(3)).swapaxes(1, 2).reshape(3, 9)
"""Matrices [e_i] of the unit vectors' cross products, one per row."""


def skew(vectors: Array) -> Array:
    """Matrices [v] (..., 3, 3) of the cross product, [v] w = v x w, of vectors (..., 3)."""
    vectors = np.asarray(vectors)
    return (vectors @ _GENERATORS).reshape(*vectors.shape, 3)


def rotation_from_vector(vector: Array) -> Array:
    """(3, 3) matrix of a rotation vector (3,) rad: axis times angle (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    r = skew(vector)
    return np.eye(3) + np.sinc(angle / np.pi) * r + np.sinc(angle / (2 * np.pi)) ** 2 / 2 * (r @ r)


def vector_from_rotation(rotation: Array) -> Array:
    """Rotation vector (3,) rad of a rotation (3, 3), at most pi long: axis times angle, to round-off at any angle."""
    (quaternion,) = quaternions_of(rotation[None])
    quaternion = quaternion * (1.0 if quaternion[0] >= 0 else -1.0)
    sine = np.linalg.norm(quaternion[1:])
    angle = 2 * np.arctan2(sine, quaternion[0])
    return quaternion[1:] * (angle / sine if sine > 0 else 2.0)


def quaternions_of(matrices: Array) -> Array:
    """(T, 3, 3) rotation matrices -> (T, 4) w, x, y, z; by the largest entry, which loses no digits (Shepperd 1978)."""
    R = matrices
    trace = R[:, 0, 0] + R[:, 1, 1] + R[:, 2, 2]
    diagonal = np.stack([R[:, 0, 0], R[:, 1, 1], R[:, 2, 2]], 1)
    squares = np.concatenate([1 + trace[:, None], 1 + 2 * diagonal - trace[:, None]], 1)  # 4 w^2, 4 x^2, ...
    pairs = np.empty((len(R), 4, 4))  # 4 times the products of the entries
    pairs[:, range(4), range(4)] = squares
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        pairs[:, 0, 1 + i] = pairs[:, 1 + i, 0] = R[:, k, j] - R[:, j, k]
        pairs[:, 1 + i, 1 + j] = pairs[:, 1 + j, 1 + i] = R[:, i, j] + R[:, j, i]
    rows = np.arange(len(R))
    best = np.nan_to_num(squares).argmax(1)
    quaternion = pairs[rows, best]
    return quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
