"""Poses in ROS recordings: PoseStamped, chains of TF, and their faults."""

import numpy as np
import pytest
import recordings
from recordings import Pose, Wrench
from stated import pose_setup

from ftbias_jax.errors import LogError
from ftbias_jax.io import read_log
from ftbias_jax.io.info import describe
from ftbias_jax.io.pose import product, rotate

COUNT = 30


@pytest.fixture(scope="module")
def poses():
    """(T, 7) position and orientation x, y, z, w, which turns past half a turn."""
    rng = np.random.default_rng(0)
    angle = np.linspace(0, 4, COUNT)[:, None]
    axis = np.array([[0.6, 0.0, 0.8]])
    return np.hstack([rng.normal(size=(COUNT, 3)), np.sin(angle / 2) * axis, np.cos(angle / 2)])


def published(poses, names=("base",), topic="/pose"):
    wrenches = [m for m in recordings.messages() if isinstance(m, Wrench)]
    moved = [Pose(w.stamp, names, tuple(pose), topic) for w, pose in zip(wrenches, poses, strict=False)]
    return [*wrenches, *moved]


def measured(log):
    rows = np.isfinite(log.q[:, 0])
    return log.t[rows], log.q[rows]


@pytest.mark.parametrize("kind", ["ros1", "sqlite", "mcap"])
@pytest.mark.parametrize("order", ["quaternion_xyzw", "quaternion_wxyz"])
def test_a_topic_of_poses(tmp_path, poses, kind, order):
    log = read_log(recordings.write(tmp_path, kind, published(poses)), pose_setup(orientation=order))
    t, q = measured(log)
    np.testing.assert_allclose(q, poses[:, [6, 3, 4, 5, 0, 1, 2]], atol=1e-12)
    np.testing.assert_allclose(t, np.arange(COUNT) * 0.01, atol=1e-9)
    assert np.isfinite(log.wrench).all()


@pytest.mark.parametrize("base", ["", "world", "base", "camera"])
def test_a_chain_of_frames_with_static_ones_between(tmp_path, poses, base):
    rng = np.random.default_rng(1)
    quaternion = rng.normal(size=4)
    mount = np.r_[rng.normal(size=3), quaternion / np.linalg.norm(quaternion)]
    inner = np.roll(poses, 5, 0)
    messages = [
        Pose(recordings.START, ("world", "base"), (1.0, 2, 3, 0, 0, 0, 1), "/tf_static"),
        Pose(recordings.START, ("link", "/mount"), tuple(mount), "/tf_static"),
        *published(poses, ("base", "link"), "/tf"),
        *[m for m in published(inner, ("mount", "tool"), "/tf") if isinstance(m, Pose)],
        *[m for m in published(inner[:3], ("base", "camera"), "/tf") if isinstance(m, Pose)],
    ]
    messages.sort(key=lambda m: m.stamp)
    log = read_log(recordings.write(tmp_path, "mcap", messages), pose_setup(frame="tool", base=base))

    def pose_of(x):
        return x[..., :3], x[..., [6, 3, 4, 5]]

    (p1, q1), (p2, q2), (p3, q3) = pose_of(poses), pose_of(np.tile(mount, (COUNT, 1))), pose_of(inner)
    position = p1 + rotate(q1, p2 + rotate(q2, p3)) + (np.array([1, 2, 3]) if base in ("", "world") else 0)
    orientation = product(q1, product(q2, q3))
    if base == "camera":  # it moves, beside the arm, and was published only briefly
        shift, turned = pose_of(inner)
        back = turned * [1, -1, -1, -1]
        position, orientation = rotate(back, position - shift)[:3], product(back, orientation)[:3]
    t, q = measured(log)
    assert len(t) == len(position) == (3 if base == "camera" else COUNT)
    np.testing.assert_allclose(q[:, 4:], position, atol=1e-9)
    same = np.abs((q[:, :4] * orientation).sum(1))
    np.testing.assert_allclose(same, 1, atol=1e-12)


@pytest.mark.parametrize(
    ("section", "words"),
    [
        ({"frame": "tol"}, "there is no frame 'tol' in TF .did you mean 'tool'"),
        ({"frame": "tool", "base": "map"}, "there is no frame 'map' in TF"),
        ({"frame": "tool", "base": "island"}, "the frames 'island' and 'tool' of TF are not connected"),
        ({"frame": "shore", "base": "island"}, "nothing moves between 'shore' and its base"),
        ({}, "no topic has the type geometry_msgs/PoseStamped"),
        ({"frame": "tool", "linear": "specific_force"}, "there is no specific force"),
    ],
)
def test_frames_that_are_not_there_are_named(tmp_path, poses, section, words):
    island = Pose(recordings.START, ("island", "shore"), (0.0, 0, 0, 0, 0, 0, 1), "/tf_static")
    path = recordings.write(tmp_path, "mcap", [*published(poses, ("base", "tool"), "/tf"), island])
    with pytest.raises(LogError, match=words):
        read_log(path, pose_setup(**section))


def test_frames_in_a_circle_are_refused(tmp_path, poses):
    messages = [*published(poses, ("a", "b"), "/tf"), *published(poses, ("b", "a"), "/tf")[60:]]
    with pytest.raises(LogError, match="form a cycle"):
        read_log(recordings.write(tmp_path, "mcap", messages), pose_setup(frame="a"))


def test_bodies_on_one_topic_are_refused(tmp_path, poses):
    messages = [*published(poses), *[m._replace(names=("other",)) for m in published(poses)[60:]]]
    with pytest.raises(LogError, match="are in several frames: 'base', 'other'"):
        read_log(recordings.write(tmp_path, "ros1", messages), pose_setup())


def test_info_knows_poses(tmp_path, poses):
    path = recordings.write(tmp_path, "ros1", published(poses))
    info = describe(path, pose_setup())
    assert info.verdict == "can be filtered"
    assert {stream.name for stream in info.streams} == {"/pose", "/wrench"}
    assert "but no joints" in describe(path).verdict
