"""What a result states about its origin, in every format that can hold it."""

import hashlib
import json

import numpy as np
import pytest
import recordings
import small_archive
from mcap import reader
from pyarrow import parquet

from ftbias_jax import __version__
from ftbias_jax.cli.main import main
from ftbias_jax.io import read_log
from ftbias_jax.io.log import Log
from ftbias_jax.io.write import save_results
from ftbias_jax.io.write.fields import FIELDS, SIGN
from ftbias_jax.io.write.npz import load_npz, save_npz_parts
from ftbias_jax.io.write.provenance import provenance, sha256_of, source_of
from ftbias_jax.io.write.selection import About
from ftbias_jax.setup import dump_setup, load_setup

NAMED = small_archive.named()
ARRAYS = {"t": np.arange(3) * 0.01 + 1.7e9, "bias": np.ones((3, 6)), "log_likelihood": np.float64(3.0)}


def sha256_of_url(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.fixture
def origin(tmp_path, setup):
    path = recordings.write(tmp_path, "ros1", recordings.messages())
    return provenance(setup, [source_of(read_log(path, setup))], {"smooth": True})


def test_it_names_version_log_setup_robot_and_options(tmp_path, setup, origin):
    (log,) = origin["logs"]
    assert log["name"] == "log.bag"
    assert log["sha256"] == sha256_of_url(tmp_path / "log.bag")
    assert (log["samples"], origin["samples"]) == (60, 60)
    assert log["duration"] == pytest.approx(0.59)
    assert log["rate"] == pytest.approx(100.0)
    assert origin["version"] == __version__
    assert origin["robot"] == "2 joints"
    assert origin["options"] == {"smooth": True}
    assert origin["setup"] == {"name": "", "sha256": hashlib.sha256(dump_setup(setup).encode()).hexdigest()}
    assert json.loads(json.dumps(origin)) == origin


def test_the_date_is_that_of_the_logs_own_stamps(origin):
    start = np.datetime64(recordings.START, "ns").astype("datetime64[ms]")
    assert np.datetime64(origin["date"].removesuffix("+00:00")) == start


def test_of_arrays_and_a_setup_from_a_file_the_setup_is_named_with_its_sum(tmp_path):
    (tmp_path / "setup.toml").write_text(NAMED)
    setup = load_setup(tmp_path / "setup.toml")
    wrench = np.random.default_rng(0).normal(size=(100, 6))
    log = Log.from_arrays(setup, np.arange(100) * 0.01, np.zeros((100, 2)), wrench)
    said = provenance(setup, [source_of(log)], {}, ["mine"])
    assert said["date"] is None
    assert said["setup"] == {"name": "setup.toml", "sha256": sha256_of_url(tmp_path / "setup.toml")}
    assert {key: said["logs"][0][key] for key in ("name", "sha256", "date")} == {
        "name": "mine",
        "sha256": None,
        "date": None,
    }


def test_a_folder_has_a_sum_that_every_file_of_it_changes(tmp_path):
    recordings.write(tmp_path, "folder", recordings.messages())
    before = sha256_of(str(tmp_path / "log"))
    assert before == sha256_of(str(tmp_path / "log"))
    (tmp_path / "log" / "metadata.yaml").write_text("changed")
    assert sha256_of(str(tmp_path / "log")) != before
    assert sha256_of(str(tmp_path / "log.npz")) is None


@pytest.fixture
def said(tmp_path, origin):
    """Format -> (what it states about the arrays, their provenance), of one result in all formats."""
    about = About("wrist", origin, [{"start": 1.0, "end": 2.0}])
    for suffix in (".npz", ".parquet", ".mcap", ".csv"):
        save_results(tmp_path / f"out{suffix}", ARRAYS, about)
    save_npz_parts(tmp_path / "parts.npz", [ARRAYS], lambda: about)
    found = {}
    for name in ("out.npz", "parts.npz"):
        arrays = load_npz(tmp_path / name)
        found[name] = [json.loads(str(arrays[text])) for text in ("about", "provenance")]
    words = parquet.read_schema(tmp_path / "out.parquet").metadata
    found["out.parquet"] = [json.loads(words[name]) for name in (b"ftbias_about", b"ftbias")]
    with open(tmp_path / "out.mcap", "rb") as file:
        (record,) = reader.make_reader(file).iter_metadata()
    assert record.name == "ftbias"
    found["out.mcap"] = [json.loads(record.metadata[name]) for name in ("about", "provenance")]
    (note,) = json.loads((tmp_path / "out.csv-metadata.json").read_text())["notes"]
    found["out.csv"] = [note["about"], note["provenance"]]
    return found


def test_every_format_says_origin_unit_sign_frame_and_contacts(said, origin):
    for about, made_from in said.values():
        assert made_from == origin
        units = {name: field["unit"] for name, field in about["fields"].items()}
        assert units == {"t": "s", "bias": "N, Nm", "log_likelihood": "nats"}
        assert (about["sign"], about["frame"], about["precision"]) == (SIGN, "wrist", "single")
        assert about["contacts"] == [{"start": 1.0, "end": 2.0}]


def test_a_frame_that_the_log_does_not_name_is_the_sensors(tmp_path):
    save_results(tmp_path / "out.npz", ARRAYS)
    arrays = load_npz(tmp_path / "out.npz")
    assert arrays.keys() == {*ARRAYS, "about"}  # without the provenance, which is unknown
    assert json.loads(str(arrays["about"]))["frame"] == "the sensor frame of the setup"


def test_the_columns_of_tables_have_units(tmp_path, said):
    columns = json.loads((tmp_path / "out.csv-metadata.json").read_text())["tableSchema"]["columns"]
    units = {column["titles"]: column["schema:unitText"] for column in columns}
    header = (tmp_path / "out.csv").read_text().splitlines()[0].split(",")
    assert list(units) == header
    assert (units["t"], units["bias_fz"], units["bias_tx"]) == ("s", "N", "Nm")
    schema = parquet.read_schema(tmp_path / "out.parquet")
    assert {name: schema.field(name).metadata[b"unit"].decode() for name in schema.names} == units


def test_the_channels_and_schemas_of_mcap_explain_themselves(tmp_path, said):
    with open(tmp_path / "out.mcap", "rb") as file:
        summary = reader.make_reader(file).get_summary()
    (channel,) = summary.channels.values()
    (schema,) = summary.schemas.values()
    assert channel.metadata == {"unit": "N, Nm", "meaning": FIELDS["bias"].meaning, "sign": SIGN}
    assert SIGN in schema.data.decode()
    assert "Vector3 force  # N\n" in schema.data.decode()


def test_simulated_logs_say_what_they_were_made_from(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "setup.toml").write_text(NAMED)
    made = ["simulate", "--setup", "setup.toml", "-o", "log.npz", "--duration", "1", "--rate", "50"]
    assert main([*made, "--effect", "tool_mass:mass=0.8"]) == 0
    for name in ("log.npz", "log_truth.npz"):
        arrays = load_npz(tmp_path / name)
        origin, about = (json.loads(str(arrays[text])) for text in ("provenance", "about"))
        assert origin["setup"] == {"name": "setup.toml", "sha256": sha256_of_url(tmp_path / "setup.toml")}
        assert (origin["samples"], origin["options"]) == (50, {"simulated": True, "seed": 0})
        assert about["units"]["t"] == "s"
    assert "0.8" not in str(load_npz(tmp_path / "log.npz")["provenance"])  # the log does not reveal the truth


def test_filter_writes_it_and_the_recordings_own_frame(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "setup.toml").write_text(NAMED)
    published = [m._replace(frame="wrist_ft") if isinstance(m, recordings.Wrench) else m for m in recordings.messages()]
    path = recordings.write(tmp_path, "ros1", published)
    code = main(["filter", path.name, "--setup", "setup.toml", "-o", "out.mcap"])
    assert code in (0, 3)  # random numbers may count as data loss
    with open(tmp_path / "out.mcap", "rb") as file:
        made = reader.make_reader(file)
        (record,) = made.iter_metadata()
        _, channel, message = next(iter(made.iter_messages(["/ftbias/bias"])))
    assert message.log_time == pytest.approx(recordings.START, abs=1e3)  # ns, rounded by seconds in float64
    assert channel.metadata["unit"] == "N, Nm"
    said = json.loads(record.metadata["provenance"])
    assert said["logs"][0]["sha256"] == sha256_of_url(path)
    assert said["setup"] == {"name": "setup.toml", "sha256": sha256_of_url(tmp_path / "setup.toml")}
    assert said["options"]["salvage"] is False
    assert b"wrist_ft\x00" in message.data
