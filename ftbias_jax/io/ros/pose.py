"""The pose of the sensor's mount in a ROS recording: from a topic of PoseStamped, or from frames of TF."""

from collections.abc import Mapping
from functools import reduce

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.pose import product, rotate
from ftbias_jax.io.ros.messages import POSE, POSE_STAMPED, TRANSFORM
from ftbias_jax.io.ros.record import Recording, Stream
from ftbias_jax.setup.fields import nearest
from ftbias_jax.setup.recorded import PoseSetup
from ftbias_jax.types import Array


def pose_streams(recording: Recording, pose: PoseSetup, file: str) -> list[Stream]:
    """Candidate streams of position (m) and orientation (x, y, z, w), (T, 7)."""
    if pose.frame:
        return [_follow_frames(recording, pose, file)]
    found = [stream for stream in recording.streams if stream.role == POSE]
    if not found:
        message = f"no motion data: no topic has the type {POSE_STAMPED}"
        remedy = "record it, or name a frame of TF in the setup: sensor_pose.frame"
        raise LogError(message, file=file, field="pose", remedy=remedy)
    return found


def _follow_frames(recording: Recording, pose: PoseSetup, file: str) -> Stream:
    """The pose of a frame in its base, at the stamps that all moving transforms between them share."""
    links = {stream.names[1]: stream for stream in recording.streams if stream.role == TRANSFORM}
    to_frame = _from_root(links, pose.frame, file)
    to_base = _from_root(links, pose.base, file) if pose.base else []
    roots = [chain[0].names[0] if chain else frame for chain, frame in ((to_frame, pose.frame), (to_base, pose.base))]
    if pose.base and roots[0] != roots[1]:
        message = f"the frames {pose.base!r} and {pose.frame!r} of TF are not connected"
        raise LogError(message, file=file, field="sensor_pose.base", remedy="name frames of one tree")
    shared = sum(one is other for one, other in zip(to_frame, to_base, strict=False))
    down, back = to_frame[shared:], to_base[shared:]
    moving = [link for link in (*back, *down) if len(np.unique(link.stamps)) > 1]
    if not moving:
        message = f"nothing moves between {pose.frame!r} and its base"
        raise LogError(message, file=file, field="sensor_pose.frame", remedy="name another")
    stamps = reduce(np.intersect1d, [link.stamps for link in moving])
    if not len(stamps):
        frames = ", ".join(repr(link.names[1]) for link in moving)
        message = f"the moving frames {frames} share no stamp"
        raise LogError(message, file=file, field="sensor_pose.frame", remedy="record the pose as PoseStamped")
    nowhere = np.tile([0.0, 0, 0, 0, 0, 0, 1], (len(stamps), 1))
    in_root, base_in_root = (reduce(_compose, [_at(link, stamps) for link in chain], nowhere) for chain in (down, back))
    back_turn = np.concatenate([-base_in_root[:, 3:6], base_in_root[:, 6:]], 1)
    root_in_base = np.concatenate([-rotate(back_turn[:, [3, 0, 1, 2]], base_in_root[:, :3]), back_turn], 1)
    values = _compose(root_in_base, in_root)
    return moving[-1].at(_rows_at(moving[-1], stamps))._replace(values=values)


def _from_root(links: Mapping[str, Stream], frame: str, file: str) -> list[Stream]:
    """The transforms from the root of the tree of frames to one frame."""
    names = {name for link in links.values() for name in link.names}
    if frame not in names:
        message = f"there is no frame {frame!r} in TF"
        raise LogError(message, file=file, field="sensor_pose", remedy=nearest(frame, names))
    chain: list[Stream] = []
    while frame in links:
        if links[frame] in chain:
            raise LogError("the TF frames form a cycle", file=file, field="sensor_pose", remedy="mend TF")
        chain.insert(0, links[frame])
        frame = links[frame].names[0]
    return chain


def _at(link: Stream, stamps: Array) -> Array:
    """Transforms (T, 7) of a link at stamps that it has, or at any stamps if it never moves."""
    if len(np.unique(link.stamps)) == 1:
        return np.broadcast_to(link.values[-1], (len(stamps), 7))
    return link.values[_rows_at(link, stamps)]


def _rows_at(link: Stream, stamps: Array) -> Array:
    order = np.argsort(link.stamps, kind="stable")
    return order[np.searchsorted(link.stamps[order], stamps)]


def _compose(outer: Array, inner: Array) -> Array:
    """Compose two poses (T, 7): the pose of the inner frame in the base of the outer one."""
    first, second = (x[:, [6, 3, 4, 5]] for x in (outer, inner))
    position = outer[:, :3] + rotate(first, inner[:, :3])
    return np.concatenate([position, product(first, second)[:, [1, 2, 3, 0]]], 1)


def in_setup_order(values: Array, pose: PoseSetup) -> Array:
    """Convert (T, 7) position and orientation (x, y, z, w) to the columns that ``pose.pose_entries`` expects."""
    orientation = values[:, 3:] if pose.orientation == "quaternion_xyzw" else values[:, [6, 3, 4, 5]]
    return np.concatenate([orientation, values[:, : 3 * (pose.linear == "position")]], 1)
