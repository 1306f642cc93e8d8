"""What a recording of ROS says in a setup: joints, topics, the robot's description, where the sensor is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.draft.robot import FLANGES, Keys, mounted
from ftbias_jax.io.pose import rotate
from ftbias_jax.io.ros.collect import Stream, Wanted
from ftbias_jax.io.ros.messages import JOINT_STATE, TF, WRENCH_STAMPED
from ftbias_jax.io.ros.record import Recording, read_recording
from ftbias_jax.setup.keys.template import Known
from ftbias_jax.setup.urdf.read import Pose

CONTROLLER = "_controller"
"""What UR's driver puts behind the name of a frame that the controller reports."""


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
    """What a recording has for a setup.

    Raises:
        LogError: it cannot be read, or has no joints or no wrench.
    """
    recording = read_recording(path, salvage=True, wanted=Wanted(poses=True))
    joints = _of_type(recording, JOINT_STATE, "joints", path)
    wrenches = _of_type(recording, WRENCH_STAMPED, "wrench", path)
    arm, wrench = max(joints, key=lambda x: (len(x.names), len(x.stamps))), max(wrenches, key=lambda x: len(x.stamps))
    keys = _topic("joints", arm, joints) | _topic("wrench", wrench, wrenches)
    names = tuple(dict.fromkeys(name for stream in joints if stream.topic == arm.topic for name in stream.names))
    transforms = tuple(stream for stream in recording.streams if stream.message_type == TF)
    return Recorded(keys, names, recording.description, wrench.names[0].removeprefix("/"), transforms)


def _of_type(recording: Recording, kind: str, what: str, path: str) -> list[Stream]:
    found = [stream for stream in recording.streams if stream.message_type == kind]
    if not found:
        raise LogError(f"there is no topic of the type {kind}", file=path, field=what, remedy="record it")
    return found


def _topic(what: str, chosen: Stream, streams: Sequence[Stream]) -> Keys:
    """The key that chooses a topic, where there are several."""
    others = sorted({stream.topic for stream in streams} - {chosen.topic})
    if not others:
        return {}
    return {f"log.topics.{what}": Known(chosen.topic, f"also there: {', '.join(others)}")}


def sensor_frame(recorded: Recorded) -> Keys:
    """The sensor's mounting, by the frame of the wrench and the transforms that never change; {} if they do not say."""
    frame = recorded.frame.removesuffix(CONTROLLER)
    if not frame:
        return {}
    pose = Pose(np.zeros(3), np.eye(3))
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
