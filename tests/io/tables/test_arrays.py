"""[log.columns] of logs of arrays: the names are those of the file's arrays, in place of the native ones."""

import numpy as np
import pytest
from log_files import write
from stated import PANDA

from ftbias_jax.cli.main import main
from ftbias_jax.errors import LogError
from ftbias_jax.io import read_log
from ftbias_jax.io.parts import open_log
from ftbias_jax.setup import dump_setup, load_setup, parse_setup

T = 20
JOINTS = [f"j{i}" for i in range(7)]
CHANNELS = ["force_1", "force_2", "force_3", "torque_1", "torque_2", "torque_3"]
COLUMNS = {"time": "stamp", "position": JOINTS, "wrench": CHANNELS, "temperature": "degrees", "current": "amperes"}


def setup_of(columns, **more):
    return parse_setup(PANDA | {"log": {"columns": columns}} | more)


def arrays():
    rng = np.random.default_rng(0)
    q, wrench = rng.normal(size=(T, 7)), rng.normal(size=(T, 6))
    named = dict(zip(JOINTS, q.T, strict=True)) | dict(zip(CHANNELS, wrench.T, strict=True))
    stamps = 5.0 + 0.01 * np.arange(T)
    return named | {"stamp": stamps, "degrees": np.full(T, 21.5), "amperes": np.arange(T) ** 2.0}


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
@pytest.mark.parametrize("native", [False, True], ids=["alone", "beside native arrays that it comes before"])
def test_named_arrays_are_what_is_read(tmp_path, suffix, native):
    content = arrays()
    if native:
        content |= {
            "q": np.zeros((T, 7)),
            "wrench": np.zeros((T, 6)),
            "t_joints": np.arange(T),
            "t_wrench": np.arange(T),
        }
    path, setup = write(tmp_path / f"log{suffix}", content), setup_of(COLUMNS)
    for log in (read_log(path, setup, raw=True), open_log(path, setup).whole()):
        np.testing.assert_array_equal(log.q, np.stack([content[name] for name in JOINTS], 1))
        np.testing.assert_array_equal(log.wrench, np.stack([content[name] for name in CHANNELS], 1))
        np.testing.assert_array_equal(log.temperature, content["degrees"])
        assert log.start == 5.0
        np.testing.assert_allclose(log.columns["current"].t, 0.01 * np.arange(T), atol=1e-9)
        np.testing.assert_array_equal(log.columns["current"].values, content["amperes"])


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
@pytest.mark.parametrize(
    ("key", "value", "name"),
    [("position", [*JOINTS[:6], "none"], "none"), ("time", "none", "none"), ("position", [*JOINTS[:6], "q"], "q")],
)
def test_a_name_that_is_not_that_of_a_list_in_the_file_is_told(tmp_path, suffix, key, value, name):
    content = arrays() | {"q": np.zeros((T, 7)), "t": np.arange(T) * 0.01}
    path = write(tmp_path / f"log{suffix}", content)
    with pytest.raises(LogError, match=rf"{name}: log.columns.{key} of the setup names"):
        read_log(path, setup_of(COLUMNS | {key: value}))


def test_named_arrays_of_a_pose_come_before_the_native_ones(tmp_path):
    names = ["w", "x", "y", "z"]
    content = {name: np.full(T, float(name == "w")) for name in names}
    content |= {
        "t": np.arange(T) * 0.01,
        "wrench": np.random.default_rng(1).normal(size=(T, 6)),
        "orientation": np.full((T, 4), 9.0),
    }
    pose = {"orientation": "quaternion_wxyz", "linear": "none"}
    stated = {key: value for key, value in PANDA.items() if key != "robot"}
    setup = parse_setup(stated | {"sensor_pose": pose, "log": {"columns": {"position": names}}})
    log = read_log(write(tmp_path / "log.npz", content), setup, raw=True)
    np.testing.assert_array_equal(np.abs(log.q), np.tile([1.0, 0.0, 0.0, 0.0], (T, 1)))


def test_a_log_that_simulate_wrote_has_the_native_names(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with open("setup.toml", "w") as file:
        file.write(dump_setup(setup_of({"position": JOINTS})))
    assert main(["simulate", "--setup", "setup.toml", "-o", "sim.npz", "--duration", "2", "--rate", "50"]) == 0
    assert len(read_log("sim.npz", load_setup("setup.toml")).t) == 100


def test_a_recording_of_ros_has_no_columns(tmp_path):
    (tmp_path / "log.mcap").write_bytes(b"")
    with pytest.raises(LogError, match="names wrench, but a recording of ROS has no columns"):
        read_log(tmp_path / "log.mcap", setup_of({"wrench": CHANNELS}))
