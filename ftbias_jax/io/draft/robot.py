"""What a built-in robot, a URDF, an MJCF or a recording of ROS says in a setup: joints, topics, where the sensor is."""

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
"""Names of flanges, the first that a URDF has is meant if nobody says which."""
CONTROLLER = "_controller"
"""What UR's driver puts behind the name of a frame that the controller reports."""


def built_in(model: str, recorded: Sequence[str] = ()) -> Keys:
    """Keys of a built-in robot."""
    if model not in BUILT_IN:
        raise UsageError(f"there is no built-in robot {model!r}", field="--robot", remedy=nearest(model, BUILT_IN))
    keys = {"robot.model": Known(model, describe_robot(model))}
    return renamed(keys, built_in_robot(model).joint_names, recorded, model)


def robots_with(recorded: Iterable[str]) -> list[str]:
    """The built-in robots that have exactly these names of joints, without those whose frame is not the flange."""
    names = set(recorded)
    found = [model for model in BUILT_IN if set(built_in_robot(model).joint_names) <= names]
    return [model for model in found if f"{model}_link8" not in found]


def from_urdf(path: str, base_link: str = "", tip_link: str = "", folder: str = "") -> Keys:
    """Keys of the arm in a URDF.

    Without a base link that is the root, without a tip link the first of FLANGES that the file has. ``folder`` is that
    of the setup, at which a relative path starts.
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
    """Keys of the arm and the tool in an MJCF.

    Without a base that is the world, without a site the one of the file's force and torque sensors. ``folder`` is that
    of the setup, at which a relative path starts.
    """
    found = load_mjcf(path, site, base)
    file, tool = os.path.basename(path), mjcf_tool(found)
    keys = {"robot.mjcf": Known(os.path.relpath(path, folder or "."))}
    keys |= {"robot.site": Known(found.model.site(found.site).name, "" if site else "by its sensors")}
    keys |= {"robot.base_link": Known(base)} if base else {}
    keys |= mounted(pose_at(), "the site's frame is the sensor's")
    if not tool.unknown:  # not written as values, which would hold against those of a changed file
        numbers = {name: np.atleast_1d(getattr(tool, name)) for name in ("mass", "center_of_mass", "inertia")}
        words = {name: ", ".join(f"{x:.4g}" for x in value) for name, value in numbers.items()}
        keys |= {f"tool.{name}": Known(None, f"of {file}: {text}") for name, text in words.items()}
    return keys


def renamed(keys: Keys, theirs: Sequence[str], recorded: Sequence[str], robot: str) -> Keys:
    """The keys of a robot with joints of the names ``theirs``, and with their names in a recording if these differ."""
    if not recorded or set(theirs) <= set(recorded):
        return keys
    ending = [[other for other in recorded if other.endswith(name)] for name in theirs]
    names = [found[0] for found in ending if len(found) == 1]
    if len(names) < len(theirs):
        remedy = f"name another robot; the joints of {robot} are {', '.join(theirs)}"
        raise UsageError(f"the recording has the joints {', '.join(recorded[:20])}", field="--robot", remedy=remedy)
    return keys | {"robot.joint_names": Known(names, "as recorded")}


def mounting(urdf: Urdf, tip_link: str, frame: str) -> Keys:
    """Where a frame that is fixed to the flange is, as the sensor's mounting; {} if the URDF does not say."""
    try:
        return mounted(fixed_pose(urdf, tip_link, frame), f"{frame} in {tip_link}, from the URDF")
    except SetupError:
        return {}


def mounted(pose: Pose, remark: str) -> Keys:
    """The sensor's mounting as keys."""
    translation, rpy = pose.translation, rpy_from_rotation(pose.rotation)
    rounded = [[round(float(x), 9) + 0.0 for x in numbers] for numbers in (translation, rpy)]  # + 0.0: no minus zero
    return {"sensor.translation": Known(rounded[0], remark), "sensor.rotation_rpy": Known(rounded[1], remark)}


class Recorded(NamedTuple):
    """What a recording has for a setup."""

    keys: Keys
    joints: tuple[str, ...]
    """Names of the joints on the topic with most of them."""
    description: str
    """A URDF, or ""."""
    frame: str
    """Of the wrench, or ""."""
    transforms: tuple[Stream, ...]
    """Of TF."""


def look_into(path: str) -> Recorded:
    """What a recording has for a setup."""
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
    """The sensor's mounting, by the frame of the wrench and the transforms that never change; {} if they do not say."""
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
