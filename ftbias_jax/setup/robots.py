"""Built-in robots, and screws from axes and points, in NumPy float64."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ftbias_jax.setup.rotations import rotation_from_rpy
from ftbias_jax.setup.types import RobotSetup
from ftbias_jax.types import Array

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
_FRANKA_FLANGE = (0.088, 0.0, 0.926 - 0.107)  # m: the manufacturer's flange, and 107 mm below it the report's frame
_OF_THE_REPORT = {"panda": "panda_link8", "fr3": "fr3_link8"}
"""Robots with the report's frame -> the same arm with the manufacturer's flange."""


def _published() -> dict[str, Any]:
    with open(Path(__file__).with_name("arms.toml"), "rb") as stream:
        return tomllib.load(stream)


_ARMS = _published()
BUILT_IN = (*_OF_THE_REPORT, *_ARMS)


def describe_robot(model: str) -> str:
    """One line that says which robot and which flange a name of ``BUILT_IN`` stands for."""
    if model in _OF_THE_REPORT:
        link = _OF_THE_REPORT[model]
        return f"{_ARMS[link]['about'].split(',')[0]}, a frame 107 mm beyond the manufacturer's flange, {link}"
    return str(_ARMS[model]["about"])


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
        joint_names: one a joint, or none for those of the manufacturer's ROS driver.

    Raises:
        KeyError: there is no robot of this name.
    """
    if model not in BUILT_IN:
        raise KeyError(model)
    arm = _arm(_OF_THE_REPORT.get(model, model))
    if model in _OF_THE_REPORT:
        screws = np.stack([revolute_screw(np.array(s, float), np.array(r, float)) for s, r in _FRANKA_JOINTS])
        arm = arm | {"screws": screws, "translation": np.array(_FRANKA_FLANGE), "rotation": np.diag([1.0, -1.0, -1.0])}
    numbers = np.array(gravity, float)
    for array in (arm["screws"], arm["translation"], arm["rotation"], numbers):
        array.setflags(write=False)
    return RobotSetup(
        screws=arm["screws"],
        joint_names=joint_names or arm["names"],
        flange_translation=arm["translation"],
        flange_rotation=arm["rotation"],
        gravity=numbers,
        model=model,
        position_limits=arm["range"],
        velocity_limits=arm["speed"],
    )


@cache
def _arm(model: str) -> dict[str, Any]:
    """Screws, flange and limits of a robot of arms.toml; the joints stand one on the other as in a URDF."""
    data = _ARMS[model]
    position, rotation, screws = np.zeros(3), np.eye(3), []
    for joint in data["joints"]:
        position, rotation = _moved(position, rotation, joint)
        screws.append(revolute_screw(rotation @ _axis(joint.get("axis", "z")), position))
    position, rotation = _moved(position, rotation, data["flange"])
    endless = [-np.inf, np.inf]
    arrays = {
        "screws": np.stack(screws),
        "translation": position,
        "rotation": rotation,
        "range": np.radians([joint.get("range", endless) for joint in data["joints"]]),
        "speed": np.radians([joint["speed"] for joint in data["joints"]]),
    }
    for array in arrays.values():
        array.setflags(write=False)
    return {"names": tuple(joint["name"] for joint in data["joints"]), **arrays}


def _moved(position: Array, rotation: Array, place: Mapping[str, Any]) -> tuple[Array, Array]:
    """The frame that stands at a place in the frame given by position and rotation."""
    inner = rotation_from_rpy(np.radians(place.get("rpy", (0.0, 0.0, 0.0))))
    whole = np.rint(inner)
    inner = np.where(np.abs(inner - whole) < 1e-15, whole, inner)  # right angles turn axes into axes
    return position + rotation @ np.array(place["xyz"]), rotation @ inner


def _axis(name: str) -> Array:
    """The unit vector of "x", "y", "z", or "-x" and so on."""
    unit = np.eye(3)["xyz".index(name[-1])]
    return -unit if name.startswith("-") else unit
