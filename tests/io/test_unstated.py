"""Logs that no setup describes: ``ftbias info`` shows their content, and the keys that would state it."""

import tomllib

import made_weights as made
import numpy as np
import pytest
import recordings
from recordings import SECOND, START, Other, Pose, Wrench
from scipy.spatial.transform import Rotation

from ftbias_jax.cli.main import main
from ftbias_jax.errors import LogError
from ftbias_jax.io import read_log
from ftbias_jax.io.draft.table import look
from ftbias_jax.io.info import describe, is_usual, look_at
from ftbias_jax.setup import parse_setup
from ftbias_jax.setup.robots import built_in_robot

T, Q, WRENCH = made.arm_log("ur5e", samples=80)
TURNED = Rotation.from_matrix(made.rotations(built_in_robot("ur5e"), Q))
NAMES = ["fx", "fy", "fz", "tx", "ty", "tz"]
MATRIX = [f"r{i}{j}" for i in "123" for j in "123"]


def write_csv(path, names, *columns, separator=","):
    table = np.column_stack(columns)
    lines = [separator.join("" if np.isnan(x) else repr(float(x)) for x in row) for row in table]
    path.write_text("\n".join([separator.join(names), *lines]) + "\n")
    return path


def stated(info):
    """The keys that info proposes, as tables of a setup."""
    return tomllib.loads("\n".join(line.replace("...", "50.0") for line in info.keys))


def test_a_pose_in_milliseconds_with_an_accelerometer_in_g(tmp_path):
    force = np.random.default_rng(0).normal([0, 0, 1], 0.01, (80, 3))
    log = write_csv(
        tmp_path / "log.csv",
        ["time", *MATRIX, "ax", "ay", "az", *NAMES, "note"],
        1.7e12 + 1000 * T,
        TURNED.as_matrix().reshape(-1, 9),
        force,
        WRENCH,
        T,
        separator=";",
    )
    info = describe(log)
    assert [(stream.name, stream.kind, stream.samples) for stream in info.streams] == [
        ("pose", "matrix", 80),
        ("imu", "acceleration", 80),
        ("wrench", "N, Nm", 80),
    ]
    assert all(stream.rate == pytest.approx(50, rel=0.02) for stream in info.streams)
    assert info.others == ("note",)
    assert stated(info) == {
        "sensor_pose": {"orientation": "matrix", "linear": "specific_force", "gyroscope": False},
        "log": {"time_unit": "ms", "acceleration_unit": "g"},
    }
    assert "ftbias setup log.csv -o setup.toml" in info.verdict
    read = read_log(log, parse_setup({**stated(info), "sensor": {"noise_std": 1.0}}))
    np.testing.assert_allclose(read.wrench, WRENCH)
    assert "can be filtered" in describe(log, parse_setup({**stated(info), "sensor": {"noise_std": 1.0}})).verdict


def test_of_a_log_with_joints_and_a_pose_the_joints_are_shown_and_rows_need_a_rate(tmp_path, capsys):
    pose = [f"current_orientation_{x}" for x in "wxyz"]
    joints = [f"joint_{i}" for i in range(1, 7)]
    log = write_csv(tmp_path / "log.csv", [*pose, *NAMES, *joints], TURNED.as_quat(scalar_first=True), WRENCH, Q)
    info = describe(log)
    assert [(stream.name, stream.kind) for stream in info.streams] == [("joints", "q"), ("wrench", "N, Nm")]
    assert "has 6 joints (and a pose, read without --robot) and a wrench" in info.verdict
    assert stated(info) == {"log": {"rate": 50.0}}
    assert main(["info", str(log)]) == 0
    assert "--robot NAME --rate HZ -o setup.toml" in capsys.readouterr().out.splitlines()[-1]


def test_an_array_of_four_may_have_either_order_and_rows_need_a_rate(tmp_path):
    np.savez(tmp_path / "log.npz", orientation=TURNED.as_quat(), wrench=WRENCH, position=Q[:, :3])
    info = describe(tmp_path / "log.npz")
    pose, wrench = info.streams
    assert pose.kind == "quaternion_xyzw or quaternion_wxyz and position"
    assert wrench.trouble == ("it has no stamps",)
    assert np.isnan(wrench.rate)
    assert 'orientation = "quaternion_xyzw"  # or "quaternion_wxyz"' in info.keys
    tables = stated(info)
    assert tables["log"] == {"rate": 50.0}
    assert "--rate HZ" in info.verdict
    assert len(read_log(tmp_path / "log.npz", parse_setup({**tables, "sensor": {"noise_std": 1.0}})).t) == 80


@pytest.mark.parametrize(
    ("names", "columns", "words"),
    [
        (NAMES, WRENCH, "has a wrench, but not joints or a pose: if that is in other files"),
        (MATRIX, TURNED.as_matrix().reshape(-1, 9), "has the pose of the sensor's mount, but not the wrench"),
        (["ax", "ay", "az"], WRENCH[:, :3], "has an IMU, but not joints or a pose and the wrench"),
        (
            ["a", "b", "c"],
            WRENCH[:, :3],
            "has no columns with known names: ftbias setup 1_part.csv --robot NAME",
        ),
    ],
)
def test_one_file_of_several_says_what_is_missing(tmp_path, names, columns, words):
    info = describe(write_csv(tmp_path / "1_part.csv", ["t", *names], T, columns))
    assert words in info.verdict


def test_the_usual_log_needs_no_guess(tmp_path):
    np.savez(tmp_path / "log.npz", t=T, q=Q, wrench=WRENCH)
    table = look(str(tmp_path / "log.npz"))
    assert is_usual(table)
    assert look_at(str(tmp_path / "log.npz"), table).keys == ()


def test_a_recording_with_poses_names_the_section_that_reads_it(tmp_path):
    stamps = START + np.arange(40) * SECOND // 50
    poses = [Pose(int(s), ("base", "tool0"), (0, 0, 0, 0, 0, 0, 1), topic="/tf") for s in stamps]
    wrenches = [Wrench(int(s), tuple(x)) for s, x in zip(stamps, WRENCH[:40], strict=True)]
    imu = [Other(int(s), "sensor_msgs/msg/Imu", {}, "/imu") for s in stamps]
    info = describe(recordings.write(tmp_path, "mcap", [*poses, *wrenches, *imu]))
    assert "a setup with [sensor_pose] reads it" in info.verdict
    assert info.keys[:2] == ("[sensor_pose]", "frame = ...  # what the sensor is mounted on, of TF's frames tool0")
    assert info.keys[2].startswith('linear = "position"  # or "specific_force"')
    assert {stream.name for stream in info.streams} == {"/wrench", "/imu"}


def test_the_command_prints_the_keys(tmp_path, capsys):
    log = write_csv(tmp_path / "log.csv", ["rx", "ry", "rz", *NAMES, "odd"], TURNED.as_rotvec(), WRENCH, T)
    assert main(["info", str(log)]) == 0
    printed = capsys.readouterr().out
    assert "pose: axis_angle or rpy, 80 samples\n  it has no stamps\n" in printed
    assert "other columns: odd\n" in printed
    assert '  orientation = "axis_angle"  # or "rpy"\n' in printed
    assert "  rate = ...  # Hz: there are no stamps (t)\n" in printed


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"wrench": WRENCH[:, :5]}, "wrench: has 5 numbers a sample, not 6"),
        ({"wrench": WRENCH[:70]}, "for 80 stamps"),
        ({"wrench": np.float64(3)}, "wrench"),
        ({"wrench": WRENCH.astype(str)}, "wrench: has shape"),
        ({"angular_velocity": WRENCH[:, :2], "wrench": WRENCH}, "dq: has 2 numbers a sample, not 3"),
        ({"orientation": TURNED.as_quat()[:60], "wrench": WRENCH}, "for 80 stamps"),
        ({"t": np.full(80, np.nan), "wrench": WRENCH}, "give every sample a finite stamp"),
    ],
)
def test_arrays_that_make_no_sense_are_errors_of_ours(tmp_path, arrays, words):
    np.savez(tmp_path / "log.npz", **{"t": T, **arrays})
    with pytest.raises(LogError, match=words):
        describe(tmp_path / "log.npz")
