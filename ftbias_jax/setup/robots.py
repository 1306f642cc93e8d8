"""Built-in robots from arms.toml, in NumPy float64."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ftbias_jax.setup.chains import Pose, pose_at, read_dh, revolute_screw
from ftbias_jax.setup.fields import Section, read_only
from ftbias_jax.setup.types import RobotSetup
from ftbias_jax.types import Array

STANDARD_GRAVITY = (0.0, 0.0, -9.81)  # m/s^2, base frame

_ARMS: dict[str, dict[str, Any]] = tomllib.loads(Path(__file__).with_name("arms.toml").read_text(encoding="utf-8"))
BUILT_IN = tuple(_ARMS)


def describe_robot(model: str) -> str:
    """One line that says which robot and which flange a name of ``BUILT_IN`` stands for."""
    return str(_ARMS[model]["about"])


def with_makers_flange(model: str) -> str:
    """The name of the same arm with its manufacturer's flange; of most that is its own name."""
    return str(_ARMS[model].get("like", model))


def built_in_robot(model: str, gravity: Array = STANDARD_GRAVITY) -> RobotSetup:
    """A robot of ``BUILT_IN``.

    Args:
        model: its name.
        gravity: (3,) m/s^2, base frame.

    Raises:
        KeyError: there is no robot of this name.
    """
    return RobotSetup(gravity=read_only(np.array(gravity, float)), model=model, **_arm(model))


@cache
def _arm(model: str) -> dict[str, Any]:
    """Screws, flange, names and limits, from the arm's joints or its Denavit-Hartenberg table."""
    data = _ARMS[model]
    data = _ARMS.get(data.get("like", ""), {}) | data
    limits = {}
    if "dh" in data:
        table = Section(data | {"joint_names": _names(data)}, model, "arms.toml")
        screws, flange, names = read_dh(table, "dh", data["convention"], "m,deg")
    else:
        joints, pose, axes = data["joints"], pose_at(), []
        for joint in joints:  # each stands on the one before it, as in a URDF
            pose = pose.then(_place(joint))
            axes.append(revolute_screw(pose.rotation @ _axis(joint.get("axis", "z")), pose.translation))
        screws, flange = np.stack(axes), pose.then(_place(data["flange"]))
        names = tuple(joint["name"] for joint in joints)
        travel = [joint.get("range", (-np.inf, np.inf)) for joint in joints]
        limits = {"position_limits": travel, "velocity_limits": [joint["speed"] for joint in joints]}
    return {
        "screws": read_only(screws),
        "joint_names": names,
        "flange_translation": read_only(flange.translation),
        "flange_rotation": read_only(flange.rotation),
        **{name: read_only(np.radians(degrees)) for name, degrees in limits.items()},
    }


def _place(place: Mapping[str, Any]) -> Pose:
    return pose_at(place["xyz"], np.radians(place.get("rpy", (0.0, 0.0, 0.0))))


def _names(data: Mapping[str, Any]) -> list[str]:
    """Names of the joints, of which a pattern with a # means one for each number."""
    names = data["names"]
    count = sum(len(row) == 4 for row in data["dh"])
    return list(names) if isinstance(names, list) else [names.replace("#", str(i + 1)) for i in range(count)]


def _axis(name: str) -> Array:
    """The unit vector of "x", "y", "z", or "-x" and so on."""
    unit = np.eye(3)["xyz".index(name[-1])]
    return -unit if name.startswith("-") else unit
