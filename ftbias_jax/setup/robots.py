"""Built-in robots, in NumPy float64."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ftbias_jax.setup.chains import dh_chain, moved, read_dh, revolute_screw
from ftbias_jax.setup.fields import Section
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
    """Screws, flange and limits of a robot of arms.toml, from its joints or its Denavit-Hartenberg table."""
    data = _ARMS[model]
    if "dh" in data:
        table = Section(data | {"joint_names": _names(data)}, model, "arms.toml")
        rows, names = read_dh(table, "dh", data["convention"], "m,deg")
        screws, position, rotation = dh_chain(rows, data["convention"])
        limits: dict[str, Array | None] = {"range": None, "speed": None}
    else:
        screws, position, rotation = _of_joints(data)
        names = tuple(joint["name"] for joint in data["joints"])
        endless = [-np.inf, np.inf]
        limits = {
            "range": np.radians([joint.get("range", endless) for joint in data["joints"]]),
            "speed": np.radians([joint["speed"] for joint in data["joints"]]),
        }
    arrays = {"screws": screws, "translation": position, "rotation": rotation, **limits}
    for array in arrays.values():
        if array is not None:
            array.setflags(write=False)
    return {"names": names, **arrays}


def _of_joints(data: Mapping[str, Any]) -> tuple[Array, Array, Array]:
    """Screws and flange of joints that stand one on the other as in a URDF."""
    position, rotation, screws = np.zeros(3), np.eye(3), []
    for joint in data["joints"]:
        position, rotation = _placed(position, rotation, joint)
        screws.append(revolute_screw(rotation @ _axis(joint.get("axis", "z")), position))
    return np.stack(screws), *_placed(position, rotation, data["flange"])


def _placed(position: Array, rotation: Array, place: Mapping[str, Any]) -> tuple[Array, Array]:
    return moved(position, rotation, place["xyz"], np.radians(place.get("rpy", (0.0, 0.0, 0.0))))


def _names(data: Mapping[str, Any]) -> list[str]:
    """Names of the joints, of which a pattern with a # means one for each number."""
    names = data["names"]
    count = sum(len(row) == 4 for row in data["dh"])
    return list(names) if isinstance(names, list) else [names.replace("#", str(i + 1)) for i in range(count)]


def _axis(name: str) -> Array:
    """The unit vector of "x", "y", "z", or "-x" and so on."""
    unit = np.eye(3)["xyz".index(name[-1])]
    return -unit if name.startswith("-") else unit
