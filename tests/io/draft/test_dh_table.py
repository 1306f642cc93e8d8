"""``ftbias setup --dh``: tables as copied from manuals."""

import made_weights as made
import numpy as np
import pytest

from ftbias_jax.cli.main import main
from ftbias_jax.errors import FtbiasError
from ftbias_jax.io.draft.dh_table import DhTable, from_table
from ftbias_jax.setup import load_setup
from ftbias_jax.setup.robots import built_in_robot

MANUAL = """Joint,theta [rad],a [m],d [m],alpha [rad]
1,0,0,0.089159,pi/2
2,0,-0.425,0,0
3,0,-0.39225,0,0
4,0,0,0.10915,π/2
5,0,0,0.09465,-pi/2
6,0,0,0.0823,0
"""
SEMICOLONS = """\ufeffname;a_i (mm);\u03b1_i (°);d_i (mm);θ_i (°)
base;0;90;89,159;q1
lift;\u2212425;0;0;q2 + 0
elbow;\u2212392,25;0;0;q3
w1;0;90°;109,15;q4
w2;0;\u221290;94,65;q5
w3;0;0;82,3;q6
"""
BARE = "0\t90\t89.159\t0\n-425\t0\t0\t0\n-392.25\t0\t0\t0\n0\t90\t109.15\t0\n0\t-90\t94.65\t0\n0\t0\t82.3\t0\n"
FRANKA = """alpha(i-1) [rad],a(i-1) [m],d_i [m],theta_i [rad],row
0,0,0.333,θ1,1
-pi/2,0,0,θ2,2
pi/2,0,0.316,θ3,3
pi/2,0.0825,0,θ4,4
-pi/2,-0.0825,0.384,θ5,5
pi/2,0,0,θ6,6
pi/2,0.088,0,θ7,7
0,0,0.107,0,flange
"""


def written(folder, text):
    path = folder / "table.csv"
    path.write_text(text, encoding="utf-8")
    return str(path)


def drafted(folder, text, *words):
    setup = folder / "setup.toml"
    assert main(["setup", "--dh", written(folder, text), *words, "-o", str(setup)]) == 0
    return load_setup(setup).robot


@pytest.mark.parametrize(
    ("text", "convention", "units", "model"),
    [
        (MANUAL, "standard", (), "ur5"),
        (SEMICOLONS, "standard", (), "ur5"),
        (BARE, "standard", ("--dh-units", "mm,deg"), "ur5"),
        (FRANKA, "modified", (), "panda_link8"),
    ],
)
def test_a_table_as_manuals_print_it_is_the_arm(tmp_path, text, convention, units, model):
    robot, expected = drafted(tmp_path, text, "--dh-convention", convention, *units), built_in_robot(model)
    for name in ("screws", "flange_translation", "flange_rotation"):
        np.testing.assert_allclose(getattr(robot, name), getattr(expected, name), atol=1e-12)


def test_a_column_of_names_names_the_joints(tmp_path):
    robot = drafted(tmp_path, SEMICOLONS, "--dh-convention", "standard")
    assert robot.joint_names == ("base", "lift", "elbow", "w1", "w2", "w3")


def test_an_offset_beside_the_joints_variable_is_added_to_it(tmp_path):
    text = "a [m],alpha [deg],d [m],theta [deg]\n0,-90,0.3,q1\n0.4,0,0,q2 - 90\n0,0,0.1,theta_3+45°\n"
    keys = from_table(DhTable(written(tmp_path, text), "standard"))
    assert [row[3] for row in keys["robot.dh"].value] == [0, -90, 45]


@pytest.mark.parametrize(
    ("text", "units", "words"),
    [
        (BARE, "", "does not state the unit of lengths .*--dh-units"),
        (MANUAL.replace(" [m]", ""), "", "does not state the unit of lengths"),
        (MANUAL.replace("theta [rad]", "theta [deg]"), "", "states angles in deg and rad"),
        (MANUAL, "mm,rad", "states lengths in m and mm"),
        (MANUAL.replace("[m]", "[mm]"), "", "if lengths are in mm .*m are dh_units"),
        (BARE, "m,deg", "if lengths are in m .*mm are dh_units"),
        (BARE, "mm,rad", "90 rad is beyond a turn"),
        (MANUAL.replace("0.10915", "d4"), "", "joint4 is prismatic"),
        (MANUAL.replace("Joint", "type").replace("\n3,", "\nP,"), "", "joint3 is prismatic"),
        (MANUAL.replace("Joint", "mass"), "", "column 'mass' is not known"),
        (MANUAL.replace("alpha [rad]", "a [m]"), "", "two columns of a"),
        (MANUAL.replace("alpha [rad]", "link"), "", "no column alpha"),
        (MANUAL.replace("2,0,-0.425", "2,-0.425"), "", "row 2 has 4 cells"),
        (MANUAL.replace("0.0823", "long"), "", "d of row 6 is 'long'"),
        (MANUAL.replace("6,0,", "6,-q6,"), "", "theta of row 6 is '-q6'"),
        (MANUAL.replace("0.0823", ""), "", "d of row 6 is ''"),
        ("0,0,1\n", "m,rad", "no header and 3 columns"),
        ("", "", "has no rows"),
        ("x" * 70000, "", "is larger than 64 KiB"),
    ],
)
def test_what_a_table_leaves_open_or_says_twice_is_refused_with_a_remedy(tmp_path, text, units, words):
    with pytest.raises(FtbiasError, match=words) as caught:
        from_table(DhTable(written(tmp_path, text), "standard", units))
    assert caught.value.remedy
    assert "table.csv" in str(caught.value)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "the Denavit-Hartenberg convention is not stated"),
        (("--dh-convention", "standard", "--robot", "ur5"), "the robot is named twice"),
    ],
)
def test_the_command_guesses_no_convention_and_takes_one_robot(tmp_path, capsys, words, said):
    assert main(["setup", "--dh", written(tmp_path, MANUAL), *words]) == 2
    assert said in capsys.readouterr().err
    assert main(["setup", "--robot", "ur5", "--dh-units", "m,rad"]) == 2
    assert "there is no table" in capsys.readouterr().err


def test_a_table_that_cannot_be_read_is_one_line(tmp_path, capsys):
    for path in (tmp_path, tmp_path / "none.csv"):
        assert main(["setup", "--dh", str(path), "--dh-convention", "standard"]) == 1
        assert len(capsys.readouterr().err.splitlines()) == 1
    (tmp_path / "b.csv").write_bytes(b"\xff\xfe\x00")
    assert main(["setup", "--dh", str(tmp_path / "b.csv"), "--dh-convention", "standard"]) == 1


def test_a_log_beside_a_table_gives_the_tool_and_joints_in_degrees(tmp_path):
    """A table states no limits: joints are in degrees if they exceed any joint's travel in radians."""
    t, q, wrench = made.arm_log("ur5")
    columns = ["t", *(f"q{i}" for i in range(6)), "fx", "fy", "fz", "tx", "ty", "tz"]
    log = tmp_path / "log.csv"
    np.savetxt(log, np.column_stack([t, np.degrees(q), wrench]), delimiter=",", header=",".join(columns), comments="")
    words = ("setup", str(log), "--dh", written(tmp_path, MANUAL), "--dh-convention", "standard")
    assert main([*words, "-o", str(tmp_path / "setup.toml")]) == 0
    setup = load_setup(tmp_path / "setup.toml")
    assert setup.log.angle_unit == "deg"
    assert abs(setup.tool.mass - made.MASS) < 0.05
    np.testing.assert_allclose(setup.tool.center_of_mass, made.CENTER, atol=4e-3)
