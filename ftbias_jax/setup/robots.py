"""Built-in robots, and screws from axes and points, in NumPy float64."""

from __future__ import annotations

import numpy as np

from ftbias_jax.setup.types import RobotSetup
from ftbias_jax.types import Array

BUILT_IN = ("panda", "fr3")
STANDARD_GRAVITY = (0.0, 0.0, -9.81)  # m/s^2, base frame

# (axis s, point r in m) of each joint, base frame, q = 0: the report's nominal values, the same for Panda and FR3.
_FRANKA_JOINTS = (
    ((0, 0, 1), (0, 0, 0)),
    ((0, 1, 0), (0, 0, 0.333)),
    ((0, 0, 1), (0, 0, 0.649)),
    ((0, -1, 0), (0.0825, 0, 0.649)),
    ((0, 0, 1), (0, 0, 1.033)),
    ((0, -1, 0), (0, 0, 1.033)),
    ((0, 0, -1), (0.088, 0, 0.926)),
)
_FRANKA_FLANGE = (0.088, 0.0, 0.926 - 0.107)  # m: joint 7, and the flange 107 mm below it


def revolute_screw(axis: Array, point: Array) -> Array:
    """(6,) screw (-s x r; s) of a turn about the unit axis s (3,) through the point r (3,) m, same frame."""
    return np.concatenate([-np.cross(axis, point), axis])


def prismatic_screw(axis: Array) -> Array:
    """(6,) screw (d; 0) of a slide along the unit axis d (3,)."""
    return np.concatenate([axis, np.zeros(3)])


def built_in_robot(model: str, gravity: Array = STANDARD_GRAVITY, joint_names: tuple[str, ...] = ()) -> RobotSetup:
    """A robot of ``BUILT_IN``.

    Args:
        model: its name.
        gravity: (3,) m/s^2, base frame.
        joint_names: seven, or none for ``MODEL_joint1`` and so on.

    Raises:
        KeyError: there is no robot of this name.
    """
    if model not in BUILT_IN:
        raise KeyError(model)
    screws = [revolute_screw(np.array(s, float), np.array(r, float)) for s, r in _FRANKA_JOINTS]
    names = joint_names or tuple(f"{model}_joint{i}" for i in range(1, len(screws) + 1))
    arrays = (np.stack(screws), np.array(_FRANKA_FLANGE), np.diag([1.0, -1.0, -1.0]), np.array(gravity, float))
    for array in arrays:
        array.setflags(write=False)
    return RobotSetup(arrays[0], names, *arrays[1:], model)
