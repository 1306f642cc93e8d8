import tomllib

import numpy as np
import pytest

from ftbias_jax.errors import SetupError
from ftbias_jax.setup import dump_setup, parse_setup

ARM = """<?xml version="1.0"?>
<robot name="two">
  <link name="base"/><link name="upper"/><link name="lower"/><link name="flange"/>
  <link name="hand"><inertial><origin xyz="0 0 0.05" rpy="0 0 1.5707963267948966"/><mass value="0.7"/>
    <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.0025"/></inertial></link>
  <link name="empty"/><link name="finger"/>
  <joint name="pan" type="continuous"><parent link="base"/><child link="upper"/>
    <origin xyz="0 0 0.3"/><axis xyz="0 0 2"/></joint>
  <joint name="lift" type="prismatic"><parent link="upper"/><child link="lower"/>
    <origin xyz="0.1 0 0" rpy="1.5707963267948966 0 0"/><axis xyz="0 1 0"/></joint>
  <joint name="end" type="fixed"><parent link="lower"/><child link="flange"/><origin xyz="0 0 0.2"/></joint>
  <joint name="grip" type="fixed"><parent link="flange"/><child link="hand"/><origin xyz="0 0 0.1"/></joint>
  <joint name="nothing" type="fixed"><parent link="flange"/><child link="empty"/></joint>
  <joint name="squeeze" type="prismatic"><parent link="hand"/><child link="finger"/><mimic joint="lift"/></joint>
</robot>
"""


def parse(path, tip_link="flange", tool=None, **robot):
    return parse_setup(
        {
            "robot": {"urdf": str(path), "tip_link": tip_link, **robot},
            "sensor": {"noise_std": [0.1, 0.004], "translation": [0, 0, 0.04], "rotation_rpy": [0, 0, np.pi]},
            "tool": tool or {"mass": 0.7, "center_of_mass": [0, 0, 0.06]},
        },
        str(path.with_name("setup.toml")),
    )


@pytest.fixture
def urdf(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(ARM)
    return path


def test_the_chain_as_screws(urdf):
    robot = parse(urdf).robot
    assert robot.joint_names == ("pan", "lift")
    np.testing.assert_allclose(robot.screws, [[0, 0, 0, 0, 0, 1], [0, 0, 1, 0, 0, 0]], atol=1e-15)
    np.testing.assert_allclose(robot.flange_translation, [0.1, -0.2, 0.3], atol=1e-15)
    np.testing.assert_allclose(robot.flange_rotation, [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-15)
    np.testing.assert_array_equal(robot.gravity, [0, 0, -9.81])


def test_the_limits_of_the_joints_are_read_where_they_are_stated(urdf):
    robot = parse(urdf).robot
    assert np.isinf([*robot.position_limits.flat, *robot.velocity_limits]).all()
    limits = '<limit lower="-0.5" upper="0.25" effort="9" velocity="2"/><axis xyz="0 1 0"/>'
    endless = '<limit lower="-1" upper="1" velocity="x"/><axis xyz="0 0 2"/>'
    changed = ARM.replace('<axis xyz="0 1 0"/>', limits).replace('<axis xyz="0 0 2"/>', endless)
    urdf.write_text(changed)
    robot = parse(urdf).robot
    np.testing.assert_array_equal(robot.position_limits, [[-np.inf, np.inf], [-0.5, 0.25]])
    np.testing.assert_array_equal(robot.velocity_limits, [np.inf, 2])


def test_a_setup_from_a_urdf_is_written_with_its_screws(urdf):
    robot = parse(urdf).robot
    again = parse_setup(tomllib.loads(dump_setup(parse(urdf)))).robot
    assert again.joint_names == robot.joint_names
    np.testing.assert_allclose(again.screws, robot.screws, atol=1e-15)


def test_the_tool_of_a_link_in_the_sensor_frame(urdf):
    tool = parse(urdf, tool={"from_urdf_link": "hand"}).tool
    assert tool.mass == 0.7
    # 0.1 m to the hand, 0.05 m to its centre, the sensor 0.04 m above the flange.
    np.testing.assert_allclose(tool.center_of_mass, [0, 0, 0.11], atol=1e-15)
    np.testing.assert_allclose(tool.inertia, [0.002, 0, 0, 0.001, 0, 0.0025], atol=1e-15)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<robot", '<!DOCTYPE robot [<!ENTITY a "b">]><robot', ["document type", "remove the <!DOCTYPE>"]),
        ("<robot name", "<robot><robot name", ["is not valid XML"]),
        ('<link name="base"/>', "<a>" * 40 + "</a>" * 40, ["nests more than 32 elements"]),
        (
            '<robot name="two">',
            '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:x/>',
            ["has macros", "xacro arm"],
        ),
        ('xyz="0 0 2"', 'xyz="0 0 0"', ["joint 'pan'", "axis of length 0"]),
        ('xyz="0 0 2"', 'xyz="0 nan 1"', ["joint 'pan'", "<axis xyz='0 nan 1'>", "3 finite numbers"]),
        ('xyz="0 0 2"', 'xyz="0 1"', ["joint 'pan'", "<axis xyz='0 1'>"]),
        ('xyz="0 0 0.3"', 'xyz="0 0 1e99"', ["joint 'pan'", "<origin xyz='0 0 1e99'>"]),
        (
            'type="continuous"',
            'type="planar"',
            ["joint 'pan'", "type 'planar'", "revolute, continuous, prismatic, fixed"],
        ),
        ('<axis xyz="0 1 0"/>', '<mimic joint="pan"/>', ["joint 'lift'", "follows the joint 'pan'", "before it"]),
        ('<child link="upper"/>', '<child link="uper"/>', ["joint 'pan'", "'uper'", "did you mean 'upper'"]),
        ('<child link="upper"/>', '<child link="lower"/>', ["joint 'lift'", "second", "no loops"]),
        ('<parent link="base"/>', '<parent link="hand"/>', ["link 'flange'", "does not hang on 'base'", "known links"]),
        ('<link name="base"/>', '<link name="base"/><link name="else"/>', ["base_link", "2 links", "name base_link"]),
    ],
)
def test_mistakes_are_named_with_their_remedy(urdf, old, new, words):
    assert old in ARM
    urdf.write_text(ARM.replace(old, new, 1))
    with pytest.raises(SetupError) as caught:
        parse(urdf)
    message = str(caught.value)
    assert message.startswith(f"{urdf}: ")
    assert "\n" not in message
    for word in words:
        assert word in message


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"tip_link": "flage"}, ["link 'flage': is not there", "did you mean 'flange'?"]),
        ({"base_link": "hand"}, ["link 'flange': does not hang on 'hand'"]),
        ({"base_link": "lower"}, ["no joint moves between 'lower' and 'flange'"]),
        ({"tool": {"from_urdf_link": "finger"}}, ["link 'finger': moves against 'flange' by the joint 'squeeze'"]),
        ({"tool": {"from_urdf_link": "empty"}}, ["link 'empty': has no mass", "give tool.mass"]),
        ({"joint_names": ["a", "b"]}, ["robot.joint_names: excluded by robot.urdf"]),
    ],
)
def test_what_the_setup_asks_for_must_be_there(urdf, changes, words):
    with pytest.raises(SetupError) as caught:
        parse(urdf, **changes)
    for word in words:
        assert word in str(caught.value)


def test_files_that_are_no_urdf_are_refused(tmp_path):
    for content, words in (
        (None, "No such file"),
        (b"", "is not valid XML"),
        (b"\x00\x01", "is not valid XML"),
        (b"<sdf/>", "is no URDF: it is a <sdf>"),
        (b'<?xml version="1.0" encoding="no-such"?><robot/>', "is not valid XML"),
        (b"<robot>" + b" " * (4 << 20) + b"</robot>", "is larger than 4 MiB"),
    ):
        path = tmp_path / "arm.urdf"
        if content is not None:
            path.write_bytes(content)
        with pytest.raises(SetupError, match=r"arm\.urdf: ") as caught:
            parse(path)
        assert words in str(caught.value)
