"""What a built-in robot or a URDF says in a setup."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence

import numpy as np

from ftbias_jax.errors import UsageError
from ftbias_jax.setup.fields import nearest
from ftbias_jax.setup.keys.template import Known
from ftbias_jax.setup.robots import BUILT_IN, built_in_robot, describe_robot
from ftbias_jax.setup.rotations import rpy_from_rotation
from ftbias_jax.setup.urdf.read import FIXED, Pose, Urdf, load_urdf

Keys = dict[str, Known]
FLANGES = ("tool0", "flange", "link_ee", "lbr_link_ee", "link_eef", "panda_link8", "fr3_link8", "end_effector_link")
"""Names of flanges, the first that a URDF has is meant if nobody says which."""


def built_in(model: str, recorded: Sequence[str] = ()) -> Keys:
    """Keys of a built-in robot.

    Args:
        model: its name.
        recorded: names of joints in a recording, which may have something before the names of the maker's driver.

    Raises:
        UsageError: there is no such robot, or the recording has other joints.
    """
    if model not in BUILT_IN:
        raise UsageError(f"there is no built-in robot {model!r}", field="--robot", remedy=nearest(model, BUILT_IN))
    keys = {"robot.model": Known(model, describe_robot(model))}
    theirs = built_in_robot(model).joint_names
    if recorded and not set(theirs) <= set(recorded):
        names = [_longer(name, recorded) for name in theirs]
        if "" in names:
            remedy = f"name another robot; the joints of {model} are {', '.join(theirs)}"
            message = f"the recording has the joints {', '.join(recorded[:20])}"
            raise UsageError(message, field="--robot", remedy=remedy)
        keys["robot.joint_names"] = Known(names, "as recorded")
    return keys


def _longer(name: str, recorded: Iterable[str]) -> str:
    """The only recorded name that ends in a name; "" = none or several."""
    found = [other for other in recorded if other.endswith(name)]
    return found[0] if len(found) == 1 else ""


def robots_with(recorded: Iterable[str]) -> list[str]:
    """The built-in robots that have exactly these names of joints, without those whose frame is not the flange."""
    names = set(recorded)
    found = [model for model in BUILT_IN if set(built_in_robot(model).joint_names) <= names]
    return [model for model in found if f"{model}_link8" not in found]


def from_urdf(path: str, base_link: str = "", tip_link: str = "", folder: str = "") -> Keys:
    """Keys of the arm in a URDF.

    Args:
        path: of the file.
        base_link: whose frame is the base frame; "" = the root.
        tip_link: the flange; "" = the first of FLANGES that the file has.
        folder: of the setup, at which a relative path starts.

    Raises:
        SetupError: the file cannot be read. UsageError: no link has the name of a flange.
    """
    urdf = load_urdf(path)
    shown = os.path.relpath(path, folder or ".")
    keys = {"robot.urdf": Known(shown)}
    if base_link:
        keys["robot.base_link"] = Known(base_link)
    keys["robot.tip_link"] = Known(tip_link or _flange(urdf), "" if tip_link else "by its name")
    return keys


def _flange(urdf: Urdf) -> str:
    found = next((name for name in FLANGES if name in urdf.links), "")
    if not found:
        ends = [link for link in urdf.links if link not in {joint.parent for joint in urdf.joints.values()}]
        remedy = f"name it with --tip; links at which nothing hangs: {', '.join(ends[:12])}"
        raise UsageError("no link has the name of a flange", file=urdf.file, field="--tip", remedy=remedy)
    return found


def mounting(urdf: Urdf, tip_link: str, frame: str) -> Keys:
    """Where a frame that is fixed to the flange is, as the sensor's mounting; {} if the URDF does not say."""
    pose, link = Pose(np.zeros(3), np.eye(3)), frame
    while link != tip_link:
        joint = urdf.joints.get(link)
        if joint is None or joint.kind not in FIXED:
            return {}
        pose, link = joint.origin.then(pose), joint.parent
    remark = f"{frame} in {tip_link}, from the URDF"
    return mounted(pose, remark)


def mounted(pose: Pose, remark: str) -> Keys:
    """The sensor's mounting as keys."""
    translation, rpy = pose.translation, rpy_from_rotation(pose.rotation)
    rounded = [[round(float(x), 9) + 0.0 for x in numbers] for numbers in (translation, rpy)]  # + 0.0: no minus zero
    return {"sensor.translation": Known(rounded[0], remark), "sensor.rotation_rpy": Known(rounded[1], remark)}
