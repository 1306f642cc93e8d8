"""What a result says about where it comes from, in every format that has a place for it."""

import hashlib
import json

import numpy as np
import pytest
import recordings

from ftbias_jax import __version__
from ftbias_jax.cli.main import main
from ftbias_jax.io import read_log
from ftbias_jax.io.write import save_results
from ftbias_jax.io.write.npz import load_npz, save_npz_parts
from ftbias_jax.io.write.provenance import provenance, sha256_of, source_of
from ftbias_jax.setup import dump_setup, load_setup

NAMED = """
[robot.flange]
translation = [0, 0, 1]
[[robot.joints]]
axis = [0, 0, 1]
point = [0, 0, 0]
name = "base"
[[robot.joints]]
axis = [0, 1, 0]
point = [0, 0, 0.5]
name = "elbow"
[sensor]
noise_std = [0.1, 0.004]
[tool]
mass = 0.7
center_of_mass = [0, 0, 0.06]
"""
ARRAYS = {"t": np.arange(3) * 0.01 + 1.7e9, "bias": np.ones((3, 6)), "log_likelihood": np.float64(3.0)}


def sum_of(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.fixture
def origin(tmp_path, setup):
    path = recordings.write(tmp_path, "ros1", recordings.messages())
    return provenance(setup, [source_of(read_log(path, setup))], {"smooth": True})


def test_it_names_version_log_setup_robot_and_options(tmp_path, setup, origin):
    (log,) = origin["logs"]
    assert log["name"] == "log.bag"
    assert log["sha256"] == sum_of(tmp_path / "log.bag")
    assert (log["samples"], origin["samples"]) == (60, 60)
    assert log["duration"] == pytest.approx(0.59)
    assert log["rate"] == pytest.approx(100.0)
    assert origin["version"] == __version__
    assert origin["robot"] == "2 joints"
    assert origin["options"] == {"smooth": True}
    assert origin["setup"] == {"name": "", "sha256": hashlib.sha256(dump_setup(setup).encode()).hexdigest()}
    assert json.loads(json.dumps(origin)) == origin


def test_the_date_is_that_of_the_logs_own_stamps(origin, setup):
    start = np.datetime64(recordings.START, "ns").astype("datetime64[ms]")
    assert np.datetime64(origin["date"].removesuffix("+00:00")) == start
    log = read_log_of_seconds(setup)
    assert provenance(setup, [source_of(log)], {})["date"] is None


def read_log_of_seconds(setup):
    from ftbias_jax.io.log import Log

    t = np.arange(100) * 0.01
    return Log.from_arrays(setup, t, np.zeros((100, 2)), np.random.default_rng(0).normal(size=(100, 6)))


def test_a_setup_from_a_file_is_named_with_its_sum(tmp_path):
    (tmp_path / "setup.toml").write_text(NAMED)
    setup = load_setup(tmp_path / "setup.toml")
    said = provenance(setup, [source_of(read_log_of_seconds(setup))], {}, ["mine"])
    assert said["setup"] == {"name": "setup.toml", "sha256": sum_of(tmp_path / "setup.toml")}
    assert said["logs"][0] | {"date": None} == said["logs"][0]
    assert (said["logs"][0]["name"], said["logs"][0]["sha256"]) == ("mine", None)


def test_a_folder_has_a_sum_that_every_file_of_it_changes(tmp_path):
    recordings.write(tmp_path, "folder", recordings.messages())
    before = sha256_of(str(tmp_path / "log"))
    assert before == sha256_of(str(tmp_path / "log"))
    (tmp_path / "log" / "metadata.yaml").write_text("changed")
    assert sha256_of(str(tmp_path / "log")) != before


def test_a_file_that_is_gone_has_no_sum(tmp_path):
    assert sha256_of(str(tmp_path / "log.npz")) is None


def test_every_format_but_csv_keeps_it(tmp_path, origin):
    for suffix in (".npz", ".parquet", ".mcap", ".csv"):
        save_results(tmp_path / f"out{suffix}", ARRAYS, 0.0, "wrist", origin)
    save_npz_parts(tmp_path / "parts.npz", [ARRAYS], origin)
    for name in ("out.npz", "parts.npz"):
        assert json.loads(str(load_npz(tmp_path / name)["provenance"])) == origin
    parquet, reader = pytest.importorskip("pyarrow.parquet"), pytest.importorskip("mcap.reader")
    assert json.loads(parquet.read_schema(tmp_path / "out.parquet").metadata[b"ftbias"]) == origin
    with open(tmp_path / "out.mcap", "rb") as file:
        (record,) = reader.make_reader(file).iter_metadata()
    assert record.name == "ftbias"
    assert json.loads(record.metadata["provenance"]) == origin


def test_without_it_nothing_is_added(tmp_path):
    save_results(tmp_path / "out.npz", ARRAYS)
    assert load_npz(tmp_path / "out.npz").keys() == ARRAYS.keys()


def test_filter_writes_it_and_the_recordings_own_frame(tmp_path, monkeypatch):
    reader = pytest.importorskip("mcap.reader")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "setup.toml").write_text(NAMED)
    published = [m._replace(frame="wrist_ft") if isinstance(m, recordings.Wrench) else m for m in recordings.messages()]
    path = recordings.write(tmp_path, "ros1", published)
    code = main(["filter", path.name, "--setup", "setup.toml", "-o", "out.mcap"])
    assert code in (0, 3)  # random numbers explain nothing
    with open(tmp_path / "out.mcap", "rb") as file:
        made = reader.make_reader(file)
        (record,) = made.iter_metadata()
        _, _, message = next(iter(made.iter_messages()))
    said = json.loads(record.metadata["provenance"])
    assert said["logs"][0]["sha256"] == sum_of(path)
    assert said["setup"] == {"name": "setup.toml", "sha256": sum_of(tmp_path / "setup.toml")}
    assert said["options"]["salvage"] is False
    assert b"wrist_ft\x00" in message.data
