"""One log in several files of any format equals the log from arrays in memory."""

from dataclasses import replace

import made_weights as made
import numpy as np
import pytest
import recordings
from log_files import SUFFIXES, write
from recordings import SECOND, START, Joints, Other, Pose, Wrench

from ftbias_jax.errors import LogError, SetupError
from ftbias_jax.io import read_log
from ftbias_jax.io.log import Log
from ftbias_jax.setup import dump_setup, parse_setup
from ftbias_jax.setup.robots import built_in_robot

SAMPLES = 40
FORMATS = [*SUFFIXES, ".bag", ".mcap"]


def streams():
    """ns and values of joints (50 Hz) and wrench, which starts 3 ms later."""
    _, q, wrench = made.arm_log("ur5e", samples=SAMPLES)
    t = START + np.arange(SAMPLES) * SECOND // 50
    return t, q, t + 3_000_000, wrench


def write_recording(path, messages):
    """Write a bag or an MCAP file of that name."""
    folder = path.parent / f"of_{path.name}"
    folder.mkdir()
    recordings.write(folder, "ros1" if path.suffix == ".bag" else "mcap", messages).rename(path)


def write_joints(path):
    t, q, *_ = streams()
    if path.suffix in SUFFIXES:
        write(path, {"t" if path.suffix in (".csv", ".parquet") else "t_joints": t, "q": q})
    else:
        write_recording(path, joints(t, q))


def write_wrench(path):
    _, _, t, wrench = streams()
    if path.suffix in (".csv", ".parquet"):
        write(path, {"t": t, "wrench": wrench})
    elif path.suffix in SUFFIXES:
        write(path, {"t_wrench": t, "wrench": wrench, "temperature": t * 0.0 + 20})
    else:
        write_recording(path, [Wrench(int(s), tuple(x)) for s, x in zip(t, wrench, strict=True)])


def joints(t, q, speed=0):
    names = built_in_robot("ur5e").joint_names
    speeds = (tuple(speed * x) if speed else () for x in q)
    return [Joints(int(s), names, tuple(x), v) for s, x, v in zip(t, q, speeds, strict=True)]


def setup_of(position, wrench, **log):
    files = {"position": f"*_joints{position}", "wrench": f"*_ft{wrench}"}
    # The CSV files have integer ns, which a table of numbers does not state.
    return parse_setup(
        {"robot": {"model": "ur5e"}, "sensor": {"noise_std": 0.1}, "log": {"files": files, "time_unit": "ns", **log}}
    )


@pytest.mark.parametrize(
    ("position", "wrench"), [*((".mcap", wrench) for wrench in FORMATS), *((position, ".npz") for position in FORMATS)]
)
def test_joints_and_wrench_in_files_of_any_two_formats(tmp_path, position, wrench):
    write_joints(tmp_path / f"run1_joints{position}")
    write_wrench(tmp_path / f"run1_ft{wrench}")
    setup = setup_of(position, wrench)
    t_joints, q, t_wrench, w = streams()
    expected = Log.from_arrays(setup, (t_joints, t_wrench), q, w)
    for name in (f"run1_joints{position}", f"run1_ft{wrench}"):
        log = read_log(tmp_path / name, setup)
        # Stamps of a CSV file are floating-point numbers: ns since 1970 lose their last 256.
        np.testing.assert_allclose(log.t, expected.t, atol=6e-7 if ".csv" in (position, wrench) else 1e-12)
        np.testing.assert_array_equal(log.q, expected.q)
        np.testing.assert_array_equal(log.wrench, expected.wrench)
        assert np.nanmax(log.temperature, initial=0) == (20 if wrench in (".npz", ".h5") else 0)


def test_each_file_may_have_its_own_unit_of_time(tmp_path):
    t_joints, q, t_wrench, w = streams()
    write(tmp_path / "1_joints.csv", {"t": t_joints // 1000, "q": q})
    write(tmp_path / "1_ft.npz", {"t": t_wrench * 1e-9, "wrench": w})
    setup = setup_of(".csv", ".npz", time_unit="s", time_units={"position": "us"})
    log = read_log(tmp_path / "1_ft.npz", setup)
    np.testing.assert_allclose(log.t[~np.isnan(log.wrench).any(1)] + log.start, t_wrench * 1e-9, atol=1e-6)
    np.testing.assert_array_equal(log.q[~np.isnan(log.q).any(1)], q)
    assert 'position = "us"' in dump_setup(setup)


def test_a_clock_that_differs_by_a_constant_is_put_right(tmp_path):
    t_joints, q, t_wrench, w = streams()
    expected = Log.from_arrays(setup_of(".npz", ".npz"), (t_joints, t_wrench), q, w)
    late = t_wrench + 12_000_000  # ns; in the other file floating-point s, an hour early
    write(tmp_path / "1_joints.npz", {"t": (t_joints - START) * 1e-9 - 3600, "q": q})
    write(tmp_path / "1_ft.npz", {"t": late - START, "wrench": w})
    setup = setup_of(".npz", ".npz", time_offsets={"wrench": -0.012, "position": 3600.0})
    setup = replace(setup, log=replace(setup.log, time_unit=None))
    log = read_log(tmp_path / "1_ft.npz", setup)
    np.testing.assert_allclose(log.t, expected.t, atol=1e-9)
    np.testing.assert_array_equal(log.wrench, expected.wrench)
    np.testing.assert_array_equal(log.q, expected.q)
    assert "[log.time_offsets]" in dump_setup(setup)
    with pytest.raises(SetupError, match="time_offsets: names velocity, which has no file"):
        setup_of(".npz", ".npz", time_offsets={"velocity": 1.0})


def write_both(path, t, q, w):
    """Joints and wrench at the same stamps, in one file."""
    if path.suffix == ".mcap":
        write_recording(path, joints(t, q) + [Wrench(int(s), tuple(x)) for s, x in zip(t, w, strict=True)])
    else:
        write(path, {"t": (t - START) * 1e-9, "q": q, "wrench": w})


@pytest.mark.parametrize("suffix", [".npz", ".csv", ".mcap"])
def test_the_rate_of_the_wrenchs_clock_is_taken_off_in_every_format(tmp_path, suffix):
    t_joints, q, _, w = streams()
    stated = {"robot": {"model": "ur5e"}, "sensor": {"noise_std": 0.1}, "log": {"clocks": {"wrench_rate": 5000.0}}}
    write_both(tmp_path / f"log{suffix}", t_joints, q, w)
    setup = parse_setup(stated)
    log = read_log(tmp_path / f"log{suffix}", setup)
    since = (t_joints - t_joints[0]) * 1e-9
    np.testing.assert_allclose(log.t[np.isfinite(log.q[:, 0])], since, atol=1e-9)
    np.testing.assert_allclose(log.t[np.isfinite(log.wrench[:, 0])], 0.995 * since, atol=2e-9)
    assert "wrench_rate = 5000.0" in dump_setup(setup)
    with pytest.raises(SetupError, match=r"log\.clocks\.wrench_rat.*did you mean 'wrench_rate'"):
        parse_setup(stated | {"log": {"clocks": {"wrench_rat": 5.0}}})


@pytest.mark.parametrize("suffix", [".npz", ".csv", ".mcap"])
def test_offsets_of_one_file_move_a_stream_against_the_other(tmp_path, suffix):
    t_joints, q, t_wrench, w = streams()
    stated = {"robot": {"model": "ur5e"}, "sensor": {"noise_std": 0.1}, "log": {"time_offsets": {"wrench": 0.003}}}
    write_both(tmp_path / f"log{suffix}", t_joints, q, w)
    log = read_log(tmp_path / f"log{suffix}", parse_setup(stated))
    expected = Log.from_arrays(setup_of("", ""), (t_joints, t_wrench), q, w)
    np.testing.assert_allclose(log.t, expected.t, atol=1e-9)
    np.testing.assert_array_equal(log.wrench, expected.wrench)
    stated["log"]["time_offsets"] = {"temperature": 1.0}
    with pytest.raises(LogError, match=r"log\.time_offsets\.temperature: has no stamps of its own"):
        read_log(tmp_path / f"log{suffix}", parse_setup(stated))


def test_a_pose_its_imu_and_the_wrench_in_an_array_file_a_bag_and_a_table(tmp_path):
    t_joints, q, t_wrench, w = streams()
    turned = made.rotations(built_in_robot("ur5e"), q)
    force = np.random.default_rng(2).normal(size=(SAMPLES, 3))
    write(tmp_path / "1_pose.npz", {"t": t_joints, "orientation": turned})
    imu = [
        Other(int(s), "geometry_msgs/msg/AccelStamped", {"accel": {"linear": tuple(f)}}, "/imu")
        for s, f in zip(t_joints + 1_000_000, force, strict=True)
    ]
    write_recording(tmp_path / "1_imu.mcap", imu)
    write(tmp_path / "1_ft.parquet", {"t": t_wrench, "wrench": w})
    files = {"position": "*_pose.npz", "velocity": "*_imu.mcap", "wrench": "*_ft.parquet"}
    tables = {"sensor_pose": {"orientation": "matrix", "linear": "specific_force"}, "sensor": {"noise_std": 0.1}}
    setup = parse_setup({**tables, "log": {"files": files}})
    log = read_log(tmp_path / "1_ft.parquet", setup)
    assert len(log.t) == 3 * SAMPLES
    np.testing.assert_array_equal(log.wrench[2::3], w)
    assert np.isfinite(log.q[::3, :4]).all()
    assert np.isfinite(log.dq[1::3, 4:]).all()
    assert np.isnan(log.dq[:, :4]).all()


def test_a_temperature_in_a_bag_of_its_own(tmp_path):
    write_joints(tmp_path / "1_joints.npz")
    write_wrench(tmp_path / "1_ft.csv")
    t = streams()[0]
    warm = [Other(int(s), "sensor_msgs/msg/Temperature", {"temperature": 30.0}, "/ft") for s in t[::10]]
    write_recording(tmp_path / "1_warm.bag", warm)
    files = {"position": "*_joints.npz", "wrench": "*_ft.csv", "temperature": "*_warm.bag"}
    setup = setup_of("", "", files=files)
    log = read_log(tmp_path / "1_ft.csv", setup)
    assert (log.temperature[np.isfinite(log.temperature)] == 30).sum() == 4


def test_velocities_of_the_joints_from_another_recording(tmp_path):
    t, q, *_ = streams()
    write_joints(tmp_path / "1_joints.npz")
    write_wrench(tmp_path / "1_ft.mcap")
    write_recording(tmp_path / "1_speed.mcap", joints(t, q, 2))
    files = {"position": "*_joints.npz", "velocity": "*_speed.mcap", "wrench": "*_ft.mcap"}
    log = read_log(tmp_path / "1_ft.mcap", setup_of("", "", files=files))
    np.testing.assert_array_equal(log.dq[::2], 2 * q)
    np.testing.assert_array_equal(log.q[::2], q)


def test_further_columns_are_looked_for_in_all_files(tmp_path):
    t_joints, q, t_wrench, w = streams()
    write(tmp_path / "1_joints.npz", {"t": t_joints, "q": q})
    write(tmp_path / "1_ft.parquet", {"t": t_wrench, "wrench": w, "I": t_wrench * 0 + 7})
    log = read_log(tmp_path / "1_ft.parquet", setup_of(".npz", ".parquet", columns={"current": "I"}))
    assert (log.columns["current"].values == 7).all()
    np.testing.assert_allclose(log.columns["current"].t, (t_wrench - t_joints[0]) * 1e-9, atol=1e-6)
    with pytest.raises(LogError, match=r"I2: log\.columns of the setup names this column"):
        read_log(tmp_path / "1_ft.parquet", setup_of(".npz", ".parquet", columns={"current": "I2"}))


@pytest.mark.parametrize(
    ("name", "columns", "words"),
    [
        ("1_ft.npz", {"t": 1.0}, "there is no array wrench"),
        ("1_ft.npz", {"wrench": 6.0}, "t_wrench: there is no time"),
        ("1_ft.h5", {"t_joints": 1.0, "wrench": 6.0}, "t_wrench: there is no time"),
        ("1_ft.doc", {}, "unknown format '.doc'"),
    ],
)
def test_what_a_file_lacks_is_named(tmp_path, name, columns, words):
    write_joints(tmp_path / "1_joints.npz")
    suffix = name[name.index(".") :]
    if suffix == ".doc":
        (tmp_path / name).write_text("")
    else:
        write(tmp_path / name, {key: np.ones((SAMPLES, 6) if size > 1 else SAMPLES) for key, size in columns.items()})
    with pytest.raises(LogError, match=words):
        read_log(tmp_path / name, setup_of(".npz", suffix))


def test_a_recording_without_an_imu_or_a_temperature_says_so(tmp_path):
    write_wrench(tmp_path / "1_ft.mcap")
    write_joints(tmp_path / "1_joints.npz")
    files = {"position": "*_joints.npz", "wrench": "*_ft.mcap"}
    with pytest.raises(LogError, match="temperature: no topic, or several, have a temperature"):
        read_log(tmp_path / "1_ft.mcap", setup_of("", "", files={**files, "temperature": "*_ft.mcap"}))
    poses = [Pose(int(s), ("base",), (0, 0, 0, 0, 0, 0, 1)) for s in streams()[0]]
    write_recording(tmp_path / "1_pose.bag", poses)
    stated = {"position": "*_pose.bag", "wrench": "*_ft.mcap", "velocity": "*_pose.bag"}
    setup = parse_setup({"sensor_pose": {}, "sensor": {"noise_std": 0.1}, "log": {"files": stated}})
    with pytest.raises(LogError, match="velocity: there is no IMU"):
        read_log(tmp_path / "1_ft.mcap", setup)
