"""Keys of a setup from a built-in robot, a URDF, an MJCF or a ROS recording: joints, topics, mounting of the sensor."""

import os
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.errors import LogError, SetupError, UsageError
from ftbias_jax.io.pose import rotate
from ftbias_jax.io.ros.messages import JOINT_STATE, TF, WRENCH_STAMPED
from ftbias_jax.io.ros.record import Stream, Wanted, read_recording
from ftbias_jax.setup.dump import Known
from ftbias_jax.setup.fields import nearest
from ftbias_jax.setup.mjcf import load_mjcf, mjcf_tool
from ftbias_jax.setup.robots import BUILT_IN, Pose, built_in_robot, describe_robot, pose_at
from ftbias_jax.setup.rotations import rpy_from_rotation
from ftbias_jax.setup.urdf import Urdf, fixed_pose, load_urdf

Keys = dict[str, Known]
FLANGES = ("tool0", "flange", "link_ee", "lbr_link_ee", "link_eef", "panda_link8", "fr3_link8", "end_effector_link")
"""Usual names of flange links; if no tip link is stated, the first of these that a URDF has is used."""
CONTROLLER = "_controller"
"""Suffix that UR's driver appends to the name of a frame that the controller reports."""


def built_in(model: str, recorded: Sequence[str] = ()) -> Keys:
    """Keys of a setup for a built-in robot."""
    if model not in BUILT_IN:
        raise UsageError(f"there is no built-in robot {model!r}", field="--robot", remedy=nearest(model, BUILT_IN))
    keys = {"robot.model": Known(model, describe_robot(model))}
    return renamed(keys, built_in_robot(model).joint_names, recorded, model)


def robots_with(recorded: Iterable[str]) -> list[str]:
    """Built-in robots whose joint names were all recorded, without those whose frame is not the flange."""
    names = set(recorded)
    found = [model for model in BUILT_IN if set(built_in_robot(model).joint_names) <= names]
    return [model for model in found if f"{model}_link8" not in found]


def from_urdf(path: str, base_link: str = "", tip_link: str = "", folder: str = "") -> Keys:
    """Keys of a setup for the arm in a URDF.

    The default base link is the root, the default tip link the first of FLANGES that the file has. ``folder`` is that
    of the setup, to which the written path is relative.
    """
    urdf = load_urdf(path)
    shown = os.path.relpath(path, folder or ".")
    keys = {"robot.urdf": Known(shown)}
    if base_link:
        keys["robot.base_link"] = Known(base_link)
    flange = tip_link or next((name for name in FLANGES if name in urdf.links), "")
    if not flange:
        ends = [link for link in urdf.links if link not in {joint.parent for joint in urdf.joints.values()}]
        remedy = f"name it with --tip; links at which nothing hangs: {', '.join(ends[:12])}"
        raise UsageError("no link has the name of a flange", file=urdf.file, field="--tip", remedy=remedy)
    return keys | {"robot.tip_link": Known(flange, "" if tip_link else "by its name")}


def from_mjcf(path: str, base: str = "", site: str = "", folder: str = "") -> Keys:
    """Keys of a setup for the arm and the tool in an MJCF.

    The default base is the world, the default site that of the file's force and torque sensors. ``folder`` is that of
    the setup, to which the written path is relative.
    """
    found = load_mjcf(path, site, base)
    file, tool = os.path.basename(path), mjcf_tool(found)
    keys = {"robot.mjcf": Known(os.path.relpath(path, folder or "."))}
    keys |= {"robot.site": Known(found.model.site(found.site).name, "" if site else "by its sensors")}
    keys |= {"robot.base_link": Known(base)} if base else {}
    keys |= mounted(pose_at(), "the site's frame is the sensor's")
    if not tool.unknown:  # comments only, because values would override those of a changed file
        numbers = {name: np.atleast_1d(getattr(tool, name)) for name in ("mass", "center_of_mass", "inertia")}
        words = {name: ", ".join(f"{x:.4g}" for x in value) for name, value in numbers.items()}
        keys |= {f"tool.{name}": Known(None, f"of {file}: {text}") for name, text in words.items()}
    return keys


def renamed(keys: Keys, theirs: Sequence[str], recorded: Sequence[str], robot: str) -> Keys:
    """Keys of a robot with joints named ``theirs``, extended by their names in a recording if these differ."""
    if not recorded or set(theirs) <= set(recorded):
        return keys
    ending = [[other for other in recorded if other.endswith(name)] for name in theirs]
    names = [found[0] for found in ending if len(found) == 1]
    if len(names) < len(theirs):
        remedy = f"name another robot; the joints of {robot} are {', '.join(theirs)}"
        raise UsageError(f"the recording has the joints {', '.join(recorded[:20])}", field="--robot", remedy=remedy)
    return keys | {"robot.joint_names": Known(names, "as recorded")}


def mounting(urdf: Urdf, tip_link: str, frame: str) -> Keys:
    """Keys of the sensor's mounting at a frame that is fixed to the flange; {} if the URDF does not state it."""
    try:
        return mounted(fixed_pose(urdf, tip_link, frame), f"{frame} in {tip_link}, from the URDF")
    except SetupError:
        return {}


def mounted(pose: Pose, remark: str) -> Keys:
    """Keys of a setup for the sensor's mounting."""
    translation, rpy = pose.translation, rpy_from_rotation(pose.rotation)
    rounded = [[round(float(x), 9) + 0.0 for x in numbers] for numbers in (translation, rpy)]  # + 0.0: no negative zero
    return {"sensor.translation": Known(rounded[0], remark), "sensor.rotation_rpy": Known(rounded[1], remark)}


class Recorded(NamedTuple):
    """Content of a recording that a setup can use."""

    keys: Keys
    joints: tuple[str, ...]
    """Names of the joints on the topic with most of them."""
    description: str
    """Text of a URDF in the recording; "" = none."""
    frame: str
    """Frame of the wrench; "" = none."""
    transforms: tuple[Stream, ...]
    """Transforms from TF."""


def look_into(path: str) -> Recorded:
    """Read the content of a recording that a setup can use."""
    recording = read_recording(path, salvage=True, wanted=Wanted(poses=True))
    keys: Keys = {}
    chosen: dict[str, Stream] = {}
    for what, kind in (("joints", JOINT_STATE), ("wrench", WRENCH_STAMPED)):
        streams = [stream for stream in recording.streams if stream.message_type == kind]
        if not streams:
            raise LogError(f"there is no topic of the type {kind}", file=path, field=what, remedy="record it")
        chosen[what] = max(streams, key=lambda stream: (len(stream.names), len(stream.stamps)))
        if others := sorted({stream.topic for stream in streams} - {chosen[what].topic}):
            keys[f"log.topics.{what}"] = Known(chosen[what].topic, f"also there: {', '.join(others)}")
    topic = (chosen["joints"].topic, JOINT_STATE)
    arm = [stream for stream in recording.streams if (stream.topic, stream.message_type) == topic]
    names = tuple(dict.fromkeys(name for stream in arm for name in stream.names))
    transforms = tuple(stream for stream in recording.streams if stream.message_type == TF)
    return Recorded(keys, names, recording.description, chosen["wrench"].names[0].removeprefix("/"), transforms)


def sensor_frame(recorded: Recorded) -> Keys:
    """Keys of the sensor's mounting from the wrench's frame and constant transforms; {} if these do not show it."""
    frame = recorded.frame.removesuffix(CONTROLLER)
    if not frame:
        return {}
    pose = pose_at()
    parents = {stream.names[1]: stream for stream in recorded.transforms if len(np.unique(stream.values, axis=0)) == 1}
    link = frame
    for _ in range(len(parents) + 1):
        if link in FLANGES:
            return mounted(pose, f"the wrench is of the frame {recorded.frame}")
        if link not in parents:
            return {}
        position, quaternion = parents[link].values[0, :3], parents[link].values[0, [6, 3, 4, 5]]
        pose = Pose(position, rotate(np.tile(quaternion, (3, 1)), np.eye(3)).T).then(pose)
        link = parents[link].names[0]
    return {}
