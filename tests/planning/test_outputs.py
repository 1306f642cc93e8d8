"""The plan as files for controllers and as a page, for a made-up motion."""

import json
import re
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from pages import Page
from rosbags import highlevel as readers

import ftbias_jax as ft
from ftbias_jax.errors import UsageError
from ftbias_jax.io.write.outputs import EXPORT, kind_of
from ftbias_jax.planning.controllers import FRANKA_RATE, ROS_RATE, UR_RATE
from ftbias_jax.planning.forecast import Cannot, Forecast
from ftbias_jax.planning.page import plan_page, tip_path
from ftbias_jax.planning.result import Options, Plan
from ftbias_jax.planning.shape import motion_at, random_shapes

SETUP = """
[robot]
model = "ROBOT"
[sensor]
noise_std = 0.1
[tool]
mass = 1.0
center_of_mass = [0, 0, 0.1]
[limits]
floor = 0.1
box_lower = [-1, -1, 0]
box_upper = [1, 1, 2]
"""
DURATION = 4.0


def made(robot, *, label="mass"):
    setup = ft.parse_setup(tomllib.loads(SETUP.replace("ROBOT", robot)), "setup.toml")
    n = len(setup.robot.joint_names)
    start, coefficients = np.linspace(-1, 1, n), 0.1 * random_shapes(0, 1, n, 3)[0]
    motion = motion_at(np.arange(401) / 100, DURATION, start, coefficients)
    told = Forecast(
        (label, "Ixx"),
        ("kg", "kg m^2"),
        np.array([0.01, np.nan]),
        None,
        None,
        {"a:b": 20.0},
        (Cannot("Ixx", "because"),),
    )
    options = Options("tool", DURATION, 100.0, 0.1, 0)
    return Plan(setup, options, (), motion, coefficients, told, np.full((4, n), 0.5), ("jerk: assumed",))


def numbers(text):
    return np.array([float(x) for x in text.strip("[]").split(",")])


def test_a_trajectory_of_ros_has_the_motion_at_its_points(tmp_path):
    plan = made("panda")
    plan.save_for(tmp_path / "motion.yaml", "ros")
    text = (tmp_path / "motion.yaml").read_text()
    assert json.loads(re.search(r"^joint_names: (.*)$", text, re.MULTILINE)[1]) == list(plan.setup.robot.joint_names)
    count = round(DURATION * ROS_RATE) + 1
    expected = plan.at(np.arange(count) / ROS_RATE)
    for key, values in (("- positions", expected.q), ("  velocities", expected.dq), ("  accelerations", expected.ddq)):
        rows = [numbers(row) for row in re.findall(rf"^{key}: (.*)$", text, re.MULTILINE)]
        np.testing.assert_allclose(rows, values, atol=1e-9)
    stamps = re.findall(r"time_from_start: {sec: (\d+), nanosec: (\d+)}", text)
    np.testing.assert_allclose([int(s) + 1e-9 * int(n) for s, n in stamps], np.arange(count) / ROS_RATE)
    assert "# Not known to the plan" in text


def test_a_bag_of_ros_has_the_same_trajectory_by_a_reader_of_others(tmp_path):
    plan, path = made("panda"), tmp_path / "motion.mcap"
    plan.save_for(path, "bag")
    with readers.AnyReader([path]) as reader:
        ((connection, _, raw),) = reader.messages()
        message = reader.deserialize(raw, connection.msgtype)
    assert connection.topic == "/joint_trajectory_controller/joint_trajectory"
    assert message.joint_names == list(plan.setup.robot.joint_names)
    expected = plan.at(np.arange(len(message.points)) / ROS_RATE)
    for key, values in (("positions", expected.q), ("velocities", expected.dq), ("accelerations", expected.ddq)):
        np.testing.assert_allclose([getattr(point, key) for point in message.points], values, atol=1e-12)
    last = message.points[-1].time_from_start
    assert (len(message.points), last.sec, last.nanosec) == (DURATION * ROS_RATE + 1, DURATION, 0)
    assert kind_of(path) == EXPORT


def test_a_script_of_ur_goes_to_the_first_pose_slowly_and_then_follows(tmp_path):
    plan = made("ur5e")
    plan.save_for(tmp_path / "motion.script", "ur")
    lines = (tmp_path / "motion.script").read_text().splitlines()
    body = [line.strip() for line in lines if not line.startswith("#")]
    assert body[0] == "def ftbias_motion():"
    assert body[1].startswith("movej([")
    steps = [re.fullmatch(r"servoj\((\[.*\]), t=0.008, lookahead_time=0.1, gain=300\)", line) for line in body[3:-3]]
    rows = [numbers(step[1]) for step in steps]
    np.testing.assert_allclose(rows, plan.at(np.arange(len(rows)) / UR_RATE).q, atol=1e-9)
    assert len(rows) == DURATION * UR_RATE + 1
    assert body[-3:] == ["stopj(0.5)", "end", "ftbias_motion()"]


def test_a_franka_gets_a_position_every_millisecond(tmp_path):
    plan = made("fr3")
    plan.save_for(tmp_path / "motion.json", "franka")
    content = json.loads((tmp_path / "motion.json").read_text())
    expected = plan.at(np.arange(DURATION * FRANKA_RATE + 1) / FRANKA_RATE)
    np.testing.assert_allclose(content["q"], expected.q, atol=1e-9)
    np.testing.assert_allclose(content["dq"], expected.dq, atol=1e-9)


@pytest.mark.parametrize(("robot", "format"), [("panda", "ur"), ("ur5e", "franka"), ("panda", "kuka")])
def test_a_format_of_another_robot_is_refused(tmp_path, robot, format):
    with pytest.raises(UsageError, match="joints" if format != "kuka" else "give one of ros, bag, ur, franka"):
        made(robot).save_for(tmp_path / "motion", format)
    assert not list(tmp_path.iterdir())


def test_the_page_says_what_to_expect_what_not_and_what_is_not_known(tmp_path):
    plan = made("panda", label="<b>mass</b>")
    plan.to_html(tmp_path / "plan.html")
    text = (tmp_path / "plan.html").read_text()
    page = Page(text)
    words = page.text
    for expected in ("<b>mass</b> [kg]", "0.01", "not determined", "a:b: 20.0 nats", "Ixx: because", "jerk: assumed"):
        assert expected in words
    assert "collisions of the arm with itself" in words
    assert page.values("src", "href") == []
    assert "<script" not in text
    assert "<animate" not in text
    assert text.count("<svg") == 2 + 1 + 7
    assert re.findall(r"NaN|nan\b", text) == []


def test_the_page_of_two_logs_has_a_column_for_each_and_for_both():
    plan = made("panda")
    both = plan.forecast._replace(logs=np.array([0.05, np.nan]), together=np.array([0.009, np.nan]))
    words = Page(plan_page(replace(plan, forecast=both))).text
    for expected in ("logs at hand", "0.05", "0.009"):
        assert expected in words


def test_the_path_on_the_page_is_that_of_the_tip():
    plan = made("panda")
    path = tip_path(plan)
    step = np.linalg.norm(np.diff(path, axis=0), axis=1)
    assert path.shape == (len(plan.motion.t), 3)
    np.testing.assert_allclose(path[0], path[-1], atol=1e-9)
    assert 0 < step.max() < 0.05
