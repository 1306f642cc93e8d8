"""Serial arms in NumPy float64: screws from axes and points or Denavit-Hartenberg tables, and arms.toml's arms."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ftbias_jax.setup.fields import Section, names, read_only, rows, vector
from ftbias_jax.setup.rotations import rotation_from_rpy
from ftbias_jax.setup.types import RobotSetup
from ftbias_jax.types import Array

STANDARD_GRAVITY = (0.0, 0.0, -9.81)  # m/s^2, base frame
CONVENTIONS = ("standard", "modified")
"""Denavit-Hartenberg rows apply theta and d before a and alpha (standard), or after them (modified, Craig's)."""
UNITS = ("m,rad", "m,deg", "mm,rad", "mm,deg")
"""Units of a Denavit-Hartenberg table: lengths, angles."""
FIXED = "fixed"
SHORTEST, LONGEST = 0.03, 20.0  # m, bounds of the reach of an arm that carries a wrist sensor
TURN = 2 * np.pi + 1e-2  # rad, one turn with room for rounding

_ARMS: dict[str, dict[str, Any]] = tomllib.loads(Path(__file__).with_name("arms.toml").read_text(encoding="utf-8"))
BUILT_IN = tuple(_ARMS)


def describe_robot(model: str) -> str:
    """One line that describes the robot and the flange of a name of ``BUILT_IN``."""
    return str(_ARMS[model]["about"])


def with_makers_flange(model: str) -> str:
    """Name of the same arm with its manufacturer's flange; for most arms their own name."""
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
        screws, flange, labels = read_dh(Section(data, model, "arms.toml"), data["convention"], "m,deg")
    else:
        joints, pose, axes = data["joints"], pose_at(), []
        for joint in joints:  # each is placed in the frame of the previous one, as in a URDF
            pose = pose.then(_place(joint))
            axes.append(revolute_screw(pose.rotation @ np.array(joint.get("axis", (0, 0, 1)), float), pose.translation))
        screws, flange = np.stack(axes), pose.then(_place(data["flange"]))
        labels = tuple(joint["name"] for joint in joints)
        travel = [joint.get("range", (-np.inf, np.inf)) for joint in joints]
        limits = {"position_limits": travel, "velocity_limits": [joint["speed"] for joint in joints]}
    return {
        "screws": read_only(screws),
        "joint_names": labels,
        "flange_translation": read_only(flange.translation),
        "flange_rotation": read_only(flange.rotation),
        **{name: read_only(np.radians(degrees)) for name, degrees in limits.items()},
    }


def _place(place: Mapping[str, Any]) -> Pose:
    return pose_at(place["xyz"], np.radians(place.get("rpy", (0.0, 0.0, 0.0))))


def revolute_screw(axis: Array, point: Array) -> Array:
    """(6,) screw (-s x r; s) of a turn about the unit axis s (3,) through the point r (3,) m, same frame."""
    return np.concatenate([-np.cross(axis, point), axis])


def prismatic_screw(axis: Array) -> Array:
    """(6,) screw (d; 0) of a slide along the unit axis d (3,)."""
    return np.concatenate([axis, np.zeros(3)])


class Pose(NamedTuple):
    """Pose of a frame in another one."""

    translation: Array
    """(3,) m."""
    rotation: Array
    """(3, 3)."""

    def then(self, inner: Pose) -> Pose:
        """Pose of a frame that has the pose ``inner`` in this frame."""
        return Pose(self.translation + self.rotation @ inner.translation, self.rotation @ inner.rotation)


def pose_at(xyz: Sequence[float] = (0.0, 0.0, 0.0), rpy: Sequence[float] = (0.0, 0.0, 0.0)) -> Pose:
    """Pose of a frame at xyz (3,) m, rotated by rpy (3,) rad about the other frame's fixed x, y, z."""
    rotation = rotation_from_rpy(np.asarray(rpy))
    whole = np.rint(rotation)  # right angles give exact entries
    return Pose(np.array(xyz, float), np.where(np.abs(rotation - whole) < 1e-15, whole, rotation))


def _dh_chain(table: Array, turns: Array, convention: str) -> tuple[Array, Pose]:
    """Screws (n, 6) at q = 0, and the flange (frame of the last row), of a Denavit-Hartenberg table.

    Its rows (r, 4) are a m, alpha rad, d m and theta rad, to which the joint's angle is added; ``turns`` (r,) marks the
    rows with a joint.
    """
    pose, screws = pose_at(), []
    for (a, alpha, d, theta), has_joint in zip(table.tolist(), turns, strict=True):
        link, joint = pose_at((a, 0, 0), (alpha, 0, 0)), pose_at((0, 0, d), (0, 0, theta))
        if convention == "modified":
            pose = pose.then(link)
        if has_joint:
            screws.append(revolute_screw(pose.rotation[:, 2], pose.translation))
        pose = pose.then(joint)
        if convention == "standard":
            pose = pose.then(link)
    return np.array(screws).reshape(-1, 6), pose


def read_dh(section: Section, convention: str, units: str) -> tuple[Array, Pose, tuple[str, ...]]:
    """Read screws, flange and joint names of a Denavit-Hartenberg table, if it is plausible for an arm.

    The section has the table ``dh``, with rows of a, alpha, d, theta and optionally "fixed", and optionally
    ``joint_names``; convention and units are of CONVENTIONS and UNITS.

    Raises:
        SetupError: a row is malformed, a joint is prismatic, or the numbers cannot have these units.
    """
    given = rows(section, "dh", 4)
    joints = [i for i, row in enumerate(given) if row[4:] != [FIXED]]
    if not joints:
        raise section.error("dh", "has no joint", "give at least one row without 'fixed'")
    named = "joint_names" in section.values
    labels = names(section, "joint_names", len(joints)) if named else tuple(f"joint{i + 1}" for i in range(len(joints)))
    for label, i in zip(labels, joints, strict=True):
        if isinstance(given[i][2], str) or given[i][4:] == ["prismatic"]:
            remedy = 'a table is for joints that turn: give [[robot.joints]] with type = "prismatic", or a URDF'
            raise section.error(f"dh[{i}]", f"{label} is prismatic", remedy)
        if given[i][4:] not in ([], ["revolute"]):
            raise section.error(f"dh[{i}]", f"ends in {given[i][4]!r}", "end a row without joint in 'fixed'")
    cells = {f"dh[{i}]": row[:4] for i, row in enumerate(given)}
    numbers = np.stack([vector(Section(cells, section.name, section.file), name, 4) for name in cells])
    length, angle = units.split(",")
    _check_angles(section, numbers[:, [1, 3]], angle)
    if length == "mm":
        numbers[:, [0, 2]] /= 1e3
    if angle == "deg":
        numbers[:, [1, 3]] = np.radians(numbers[:, [1, 3]])
    turns = np.isin(np.arange(len(given)), joints)
    _check_reach(section, numbers, turns, convention, length)
    return *_dh_chain(numbers, turns, convention), labels


def _check_angles(section: Section, angles: Array, unit: str) -> None:
    """Raise an error if angles cannot have this unit: one exceeds a turn, or degrees are all below 2 pi."""
    largest = np.abs(angles).max()
    if largest > (TURN if unit == "rad" else 361):
        other = "" if unit == "deg" else '; degrees are dh_units = "m,deg" or "mm,deg"'
        raise section.error("dh", f"an angle of {largest:g} {unit} is beyond a turn", f"check its unit{other}")
    if unit == "deg" and 0 < largest <= TURN:
        remedy = 'radians are dh_units = "m,rad" or "mm,rad"'
        raise section.error("dh", f"no angle is larger than {largest:g} degrees", f"check their unit; {remedy}")


def _check_reach(section: Section, table: Array, turns: Array, convention: str, unit: str) -> None:
    """Check the reach in three poses, because single lengths of a calibrated table may be huge and cancel."""
    poses = (table + q * np.outer(turns, (0, 0, 0, 1)) for q in (0.0, 1.0, -1.0))
    reach = max(float(np.linalg.norm(_dh_chain(pose, turns, convention)[1].translation)) for pose in poses)
    if not SHORTEST <= reach <= LONGEST:
        other = "m" if unit == "mm" else "mm"
        remedy = f'check the unit of a and d; {other} are dh_units = "{other},rad" or "{other},deg"'
        raise section.error("dh", f"the flange is {reach:.4g} m from the base if lengths are in {unit}", remedy)
