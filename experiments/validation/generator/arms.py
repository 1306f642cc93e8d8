"""Serial arms as joint axes and points in the base frame at q = 0, from Denavit-Hartenberg tables."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Arm:
    """A serial arm of revolute joints and the region of joint space that its motions use."""

    name: str
    """"panda" is built into the package under test; any other arm is written out joint by joint."""
    axes: Floats
    """(n, 3) unit joint axes at q = 0, base frame."""
    points: Floats
    """(n, 3) m, a point on each axis at q = 0, base frame."""
    flange_position: Floats
    """(3,) m, origin of the flange at q = 0, base frame."""
    flange_rotation: Floats
    """(3, 3) flange axes at q = 0 in the base frame."""
    home: Floats
    """(n,) rad, centre of the motions."""
    span: Floats
    """(n,) rad, largest excursion from home."""
    forearm: int
    """Index of the joint whose link is the forearm, where a cable may be anchored."""


def _turn(axis: str, angle: float) -> Floats:
    transform = np.eye(4)
    transform[:3, :3] = Rotation.from_euler(axis, angle).as_matrix()
    return transform


def _shift(x: float, y: float, z: float) -> Floats:
    transform = np.eye(4)
    transform[:3, 3] = x, y, z
    return transform


def standard_dh(rows: Floats) -> tuple[Floats, Floats, Floats]:
    """Axes (n, 3), points (n, 3) and flange pose (4, 4) at q = 0; rows (n, 3) are a [m], alpha [rad], d [m]."""
    pose, axes, points = np.eye(4), [], []
    for a, alpha, d in rows:
        axes.append(pose[:3, 2])
        points.append(pose[:3, 3])
        pose = pose @ _shift(0, 0, d) @ _shift(a, 0, 0) @ _turn("x", alpha)
    return np.array(axes), np.array(points), pose


def modified_dh(rows: Floats) -> tuple[Floats, Floats, Floats]:
    """Axes, points and flange pose as in ``standard_dh``, for Craig's convention (a and alpha before the joint)."""
    pose, axes, points = np.eye(4), [], []
    for a, alpha, d in rows:
        pose = pose @ _turn("x", alpha) @ _shift(a, 0, 0)
        axes.append(pose[:3, 2])
        points.append(pose[:3, 3])
        pose = pose @ _shift(0, 0, d)
    return np.array(axes), np.array(points), pose


def panda() -> Arm:
    """Franka Emika Panda, manufacturer's table, with the flange frame of the package's built-in "panda".

    That frame is 107 mm beyond the manufacturer's flange, which itself is 107 mm beyond the wrist.
    """
    right = np.pi / 2
    rows = np.array(
        [
            (0, 0, 0.333),
            (0, -right, 0),
            (0, right, 0.316),
            (0.0825, right, 0),
            (-0.0825, -right, 0.384),
            (0, right, 0),
            (0.088, right, 0.107 + 0.107),
        ]
    )
    axes, points, flange = modified_dh(rows)
    home = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.785])
    span = np.array([0.5, 0.4, 0.5, 0.5, 0.9, 0.8, 1.3])
    return Arm("panda", axes, points, flange[:3, 3], flange[:3, :3], home, span, 3)


def ur_like(rng: np.random.Generator) -> Arm:
    """Six-axis arm with three parallel axes, link lengths within 20 % of those of an arm for 5 kg payload."""
    right = np.pi / 2
    a = rng.uniform(0.8, 1.2, 2) * [-0.425, -0.392]
    d = rng.uniform(0.8, 1.2, 4) * [0.1625, 0.133, 0.1, 0.1]
    rows = [(0, right, d[0]), (a[0], 0, 0), (a[1], 0, 0), (0, right, d[1]), (0, -right, d[2]), (0, 0, d[3])]
    axes, points, flange = standard_dh(np.array(rows))
    home = np.array([0.0, -1.3, 1.6, -1.9, -1.57, 0.0])
    span = np.array([0.6, 0.5, 0.6, 0.9, 1.0, 1.6])
    return Arm("ur_like", axes, points, flange[:3, 3], flange[:3, :3], home, span, 2)


def spherical_wrist(rng: np.random.Generator) -> Arm:
    """Six-axis industrial arm with random link lengths, whose last three axes intersect in one point."""
    right = np.pi / 2
    a = rng.uniform(0.8, 1.2, 3) * [0.1, 0.4, 0.05]
    d = rng.uniform(0.8, 1.2, 3) * [0.4, 0.45, 0.09]
    rows = [(a[0], -right, d[0]), (a[1], 0, 0), (a[2], -right, 0), (0, right, d[1]), (0, -right, 0), (0, 0, d[2])]
    axes, points, flange = standard_dh(np.array(rows))
    home = np.array([0.0, -1.1, 0.3, 0.0, 0.8, 0.0])
    span = np.array([0.6, 0.4, 0.5, 1.2, 0.7, 1.6])
    return Arm("spherical_wrist", axes, points, flange[:3, 3], flange[:3, :3], home, span, 3)


def random_arm(rng: np.random.Generator) -> Arm:
    """Draw an arm: the Panda in half of the cases, otherwise one of the two six-axis arms."""
    pick = rng.uniform()
    if pick < 0.5:
        return panda()
    return ur_like(rng) if pick < 0.75 else spherical_wrist(rng)
