import sys

import numpy as np
import pytest
import recordings
from recordings import FORMATS, START, Joints, Wrench
from rosbags import rosbag1

from ftbias_jax.errors import LogError
from ftbias_jax.io import read_log
from ftbias_jax.io.log import Repair
from ftbias_jax.io.ros.record import read_recording


def assert_same(log, expected):
    for name in ("q", "dq", "wrench"):
        np.testing.assert_array_equal(getattr(log, name), getattr(expected, name))
    np.testing.assert_allclose(log.t, expected.t, rtol=0, atol=1e-12)
    assert log.start == pytest.approx(expected.start, abs=1e-6)


@pytest.fixture(scope="session")
def expected(tmp_path_factory, setup):
    """The same log as read from the native format."""
    path = tmp_path_factory.mktemp("native") / "log.npz"
    np.savez(path, **recordings.arrays())
    return read_log(path, setup)


@pytest.mark.parametrize("kind", FORMATS)
def test_every_container_gives_the_same_log_and_has_nothing_to_salvage(tmp_path, setup, expected, kind):
    path = recordings.write(tmp_path, kind, recordings.messages())
    for salvage in (False, True):
        reading = read_log(path, setup, salvage=salvage)
        assert_same(reading, expected)
        assert reading.repairs == ()


@pytest.mark.parametrize("kind", ["ros1", "sqlite", "mcap"])
def test_a_gripper_on_the_same_topic_does_not_disturb_the_arm(tmp_path, setup, expected, kind):
    gripper = [Joints(START + i * 7_000_001, ("finger",), (0.1 * i,), publisher="gripper") for i in range(40)]
    published = sorted([*recordings.messages(), *gripper], key=lambda m: m.stamp)
    assert_same(read_log(recordings.write(tmp_path, kind, published), setup), expected)


def test_two_publishers_of_one_arm_are_merged(tmp_path, setup, expected):
    """One publishes the base joint, the other the elbow, with the same stamps."""
    published = []
    for m in recordings.messages():
        halves = [m._replace(names=m.names[i : i + 1], position=m.position[i : i + 1], velocity=m.velocity[i : i + 1],
                             publisher=str(i)) for i in range(2)] if isinstance(m, Joints) else [m]  # fmt: skip
        published += halves
    reading = read_log(recordings.write(tmp_path, "ros1", published), setup)
    assert_same(reading, expected)
    assert reading.repairs == ()


def test_topics_to_choose_from_are_listed_and_chosen_in_the_setup(tmp_path, setup, make_setup, expected):
    other = [m._replace(topic="/filtered" + m.topic) for m in recordings.messages()]
    path = recordings.write(tmp_path, "ros1", [*recordings.messages(), *other])
    for topics in ({}, {"joints": "/joint_states"}):
        with pytest.raises(LogError) as caught:
            read_log(path, make_setup(log={"topics": topics}))
        field = "wrench" if topics else "joints"
        assert f"log.topics.{field}: 2 topics have {field}: /filtered/" in str(caught.value)
        assert f'[log.topics] {field} = "/filtered/' in caught.value.remedy
    topics = {"joints": "/joint_states", "wrench": "/wrench"}
    assert_same(read_log(path, make_setup(log={"topics": topics})), expected)
    with pytest.raises(LogError, match="did you mean '/wrench'"):
        read_log(path, make_setup(log={"topics": {**topics, "wrench": "/wrenches"}}))


def test_recordings_without_joints_or_wrench_say_what_there_is(tmp_path, setup):
    (tmp_path / "a").mkdir()
    only_wrench = [m for m in recordings.messages() if isinstance(m, Wrench)]
    with pytest.raises(LogError, match="no motion data: no topic has the type sensor_msgs/JointState") as caught:
        read_log(recordings.write(tmp_path / "a", "ros1", only_wrench), setup)
    assert "/wrench (geometry_msgs/WrenchStamped)" in caught.value.remedy
    only_joints = [m for m in recordings.messages() if isinstance(m, Joints)]
    with pytest.raises(LogError, match="no wrench data: no topic has the type geometry_msgs/WrenchStamped"):
        read_log(recordings.write(tmp_path, "ros1", only_joints), setup)


def test_a_bag_that_was_never_closed_is_read_without_its_index(tmp_path, setup, expected):
    path = recordings.write(tmp_path, "ros1", recordings.messages())
    content = bytearray(path.read_bytes())
    at = content.index(b"index_pos=") + 10
    end = int.from_bytes(content[at : at + 8], "little")
    content[at : at + 8] = bytes(8)
    path.write_bytes(content[:end])
    assert_same(read_log(path, setup), expected)


def test_a_folder_needs_no_metadata_and_tags_in_it_are_not_run(tmp_path, setup, expected):
    path = recordings.write(tmp_path, "folder", recordings.messages())
    (path / "metadata.yaml").write_text(f"!!python/object/apply:os.system ['touch {tmp_path}/harm']")
    assert_same(read_log(path, setup), expected)
    assert not (tmp_path / "harm").exists()
    (path / "metadata.yaml").unlink()
    assert_same(read_log(path, setup), expected)


def test_folders_and_files_that_are_no_recording_are_named(tmp_path, setup):
    with pytest.raises(LogError, match=r"the folder has no file that ends in \.bag, \.db3, \.mcap"):
        read_log(tmp_path, setup)
    for name, content, words in (("a.bag", b"", "is empty"), ("a.mcap", b"t,q0,q1\n", "is no recording of ROS")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(LogError, match=words):
            read_log(tmp_path / name, setup)
    with pytest.raises(LogError, match="cannot be read: No such file"):
        read_log(tmp_path / "none.bag", setup)


@pytest.mark.parametrize(
    ("kind", "module"),
    [("ros1 lz4", "lz4.frame"), ("mcap zstd chunks", "zstandard"), ("sqlite zstd file", "zstandard")],
)
def test_a_missing_decompressor_is_named_with_its_extra(tmp_path, setup, monkeypatch, kind, module):
    path = recordings.write(tmp_path, kind, recordings.messages())
    monkeypatch.setitem(sys.modules, module, None)
    for salvage in (False, True):
        with pytest.raises(LogError, match=r"pip install 'ftbias-jax\[ros\]'") as caught:
            read_log(path, setup, salvage=salvage)
        assert str(path) in str(caught.value)


def test_real_arm_with_a_gripper(shared_data, make_setup):
    """Counts and values agree with the reader of the package rosbags."""
    path = shared_data / "real" / "ur10e_pick.bag"
    setup = make_setup(robot={"model": "ur10e"})
    names = setup.robot.joint_names
    recording = read_recording(path)
    with rosbag1.Reader(path) as reader:
        counts = {name: topic.msgcount for name, topic in reader.topics.items()}
        assert {(topic.name, topic.messages) for topic in recording.topics} == set(counts.items())
        store = recordings.get_typestore(recordings.Stores.ROS1_NOETIC)
        connections = [c for c in reader.connections if c.topic in ("/wrench", "/joint_states")]
        read = [(c.topic, store.deserialize_ros1(data, c.msgtype)) for c, _, data in reader.messages(connections)]
    wrench, *joint_streams = recording.streams
    assert 1e9 / np.median(np.diff(wrench.stamps)) == pytest.approx(500, rel=1e-3)
    fingers = ("left_finger_joint", "right_finger_joint")
    assert [stream.names for stream in joint_streams] == [tuple(sorted(names)), fingers]
    assert [len(stream.stamps) for stream in recording.streams] == [1346, 1320, 133]

    log = read_log(path, setup)
    late = "stamps of the joints and the wrench up to 2.9 ms late: those of the steady clock behind them are used"
    assert log.repairs == (Repair(late),)
    intervals = np.diff(log.t) / 2e-3  # its controller has 500 Hz, and some messages were lost
    np.testing.assert_allclose(intervals, np.rint(intervals), atol=0.01)
    theirs = [m.wrench for topic, m in read if topic == "/wrench"]
    theirs = [[w.force.x, w.force.y, w.force.z, w.torque.x, w.torque.y, w.torque.z] for w in theirs]
    np.testing.assert_array_equal(log.wrench[~np.isnan(log.wrench).all(1)], theirs)
    states = [m for topic, m in read if topic == "/joint_states" and "elbow_joint" in m.name]
    theirs = [[m.position[m.name.index(name)] for name in names] for m in states]
    np.testing.assert_array_equal(log.q[~np.isnan(log.q).all(1)], theirs)
