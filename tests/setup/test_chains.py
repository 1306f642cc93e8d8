"""Denavit-Hartenberg tables in a setup."""

import tomllib

import numpy as np
import pytest

from ftbias_jax.errors import SetupError
from ftbias_jax.setup import dump_setup, load_setup, parse_setup
from ftbias_jax.setup.robots import built_in_robot

UR5 = [
    [0, 90, 89.159, 0],
    [-425, 0, 0, 0],
    [-392.25, 0, 0, 0],
    [0, 90, 109.15, 0],
    [0, -90, 94.65, 0],
    [0, 0, 82.3, 0],
]
PANDA = """
dh = [
    [0, 0, 0.333, 0], [0, -1.5707963267948966, 0, 0], [0, 1.5707963267948966, 0.316, 0],
    [0.0825, 1.5707963267948966, 0, 0], [-0.0825, -1.5707963267948966, 0.384, 0],
    [0, 1.5707963267948966, 0, 0], [0.088, 1.5707963267948966, 0, 0], [0, 0, 0.107, 0, "fixed"],
]
dh_convention = "modified"
"""


def parse(robot):
    return parse_setup({"robot": robot, "sensor": {"noise_std": 0.1}}, "setup.toml").robot


def ur5(**changed):
    return {"dh": UR5, "dh_convention": "standard", "dh_units": "mm,deg"} | changed


def with_row(i, row):
    return ur5(dh=[*UR5[:i], row, *UR5[i + 1 :]])


def in_units(length, angle):
    return [[a * length, alpha * angle, d * length, theta * angle] for a, alpha, d, theta in UR5]


def same_arm(one, two):
    for name in ("screws", "flange_translation", "flange_rotation"):
        np.testing.assert_allclose(getattr(one, name), getattr(two, name), atol=1e-12)


def test_joints_of_a_table_are_counted_or_named():
    assert parse(ur5()).joint_names == tuple(f"joint{i}" for i in range(1, 7))
    assert parse(ur5(joint_names=list("abcdef"))).joint_names == tuple("abcdef")


@pytest.mark.parametrize("units", ["m,rad", "m,deg", "mm,rad", "mm,deg"])
def test_a_table_is_the_same_arm_in_any_units(units):
    length, angle = units.split(",")
    table = in_units(1.0 if length == "mm" else 1e-3, 1.0 if angle == "deg" else np.pi / 180)
    same_arm(parse(ur5(dh=table, dh_units=units)), built_in_robot("ur5"))


def test_a_modified_table_has_its_twists_first_and_a_fixed_row_has_no_joint(tmp_path):
    path = tmp_path / "setup.toml"
    path.write_text(f"[robot]{PANDA}[sensor]\nnoise_std = 0.1\n")
    same_arm(load_setup(path).robot, built_in_robot("panda_link8"))


def test_a_table_survives_saving_and_its_arm_survives_a_dump(tmp_path):
    path, again = tmp_path / "setup.toml", tmp_path / "again.toml"
    path.write_text(f"[robot]{PANDA}[sensor]\nnoise_std = 0.1\n")
    setup = load_setup(path)
    setup.save(again)
    assert PANDA in again.read_text()
    same_arm(load_setup(again).robot, setup.robot)
    same_arm(parse_setup(tomllib.loads(dump_setup(setup))).robot, setup.robot)


@pytest.mark.parametrize("row", [[0, 90, "d3", 0], [0, 90, 100, 0, "prismatic"]])
def test_a_prismatic_joint_is_refused_by_its_name(row):
    with pytest.raises(SetupError, match=r"robot.dh\[2\]: joint3 is prismatic .*\[\[robot.joints\]\]"):
        parse(with_row(2, row))
    with pytest.raises(SetupError, match="slide is prismatic"):
        parse(with_row(2, row) | {"joint_names": ["a", "b", "slide", "d", "e", "f"]})


@pytest.mark.parametrize(
    ("changed", "field", "words"),
    [
        ({"dh_units": "m,deg"}, "robot.dh", "m from the base if lengths are in m .*mm are dh_units"),
        ({"dh_units": "mm,deg", "dh": in_units(1e-3, 1)}, "robot.dh", "if lengths are in mm .*; m are dh_units"),
        ({"dh_units": "mm,rad"}, "robot.dh", "90 rad is beyond a turn .*degrees are dh_units"),
        ({"dh": in_units(1, np.pi / 180)}, "robot.dh", "no angle is larger than 1.57.* degrees .*radians are dh_units"),
        ({"dh_units": "cm,deg"}, "robot.dh_units", "unknown value"),
        ({"dh_convention": "craig"}, "robot.dh_convention", "unknown value"),
        ({"dh": []}, "robot.dh", "expected rows"),
        ({"dh": [[0, 0, 1, 0, "fixed"]]}, "robot.dh", "no joint"),
        ({"dh": [[0, 0, 1]]}, r"robot.dh\[0\]", "has 3 entries"),
        ({"dh": [[0, "x", 100, 0]]}, r"robot.dh\[0\]", "expected numbers"),
        ({"dh": [[0, 0, 100, 0, "free"]]}, r"robot.dh\[0\]", "ends in 'free'"),
        ({"dh": [[0, 0, float("nan"), 0]]}, r"robot.dh\[0\]", "finite"),
        ({"joint_names": ["a"]}, "robot.joint_names", "give 6"),
        ({"model": "ur5"}, "robot.model", "excluded by robot.dh"),
        ({"urdf": "arm.urdf", "tip_link": "tool0"}, "robot.dh", "excluded by robot.urdf"),
    ],
)
def test_a_table_that_is_none_is_told_by_field_and_remedy(changed, field, words):
    with pytest.raises(SetupError, match=f"{field}: .*{words}"):
        parse(ur5(**changed))


def test_a_calibrated_table_whose_huge_lengths_cancel_is_an_arm():
    """Nearly parallel axes meet after offsets of 100 m and back, as in calibrations of such arms."""
    there, back = [-425, 0, 1e5, 0], [-392.25, 0, -1e5, 0]
    same_arm(parse(ur5(dh=[UR5[0], there, back, *UR5[3:]])), built_in_robot("ur5"))


def test_the_convention_must_be_stated_and_belongs_to_a_table():
    with pytest.raises(SetupError, match=r"robot.dh_convention: missing key .*standard or modified"):
        parse({"dh": UR5, "dh_units": "mm,deg"})
    with pytest.raises(SetupError, match=r"robot.dh_units: belongs to robot.dh"):
        parse({"model": "ur5", "dh_units": "mm,deg"})


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("UR5", "ur5"),
        ("ur-10", "ur10"),
        ("jaco", "jaco2"),
        ("TM5 700", "tm5-700"),
        ("lwr4", "lwr4+"),
        ("CRX-10iA", "crx10ia"),
    ],
)
def test_a_name_that_is_nearly_a_robots_is_told(typed, meant):
    with pytest.raises(SetupError, match=f"did you mean '{meant}'".replace("+", r"\+")):
        parse({"model": typed})
