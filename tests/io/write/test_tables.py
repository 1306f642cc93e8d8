import numpy as np
import pytest
from mcap import reader
from mcap_ros2 import decoder
from pyarrow import parquet

from ftbias_jax.errors import OutputError, UsageError
from ftbias_jax.io.ros.record import read_recording
from ftbias_jax.io.write import WRITERS, save_results
from ftbias_jax.io.write.mcap import TOPICS, save_mcap
from ftbias_jax.io.write.selection import About, Selection
from ftbias_jax.setup.export.ros import dump_offsets
from ftbias_jax.types import AXES

T, START = 30, 1_700_000_000.25
DOUBLE = About(selection=Selection(precision="double"))


def result():
    rng = np.random.default_rng(0)
    arrays = {"t": START + np.sort(rng.uniform(0, 9, T))}
    names = ("bias", "drift", "bias_std", "wrench_unbiased", "wrench_tool", "innovation")
    arrays |= {name: rng.normal(size=(T, 6)) for name in names}
    arrays |= {name: rng.normal(size=(T, 6)) for name in ("q", "dq", "ddq", "ddq_std")}
    arrays["innovation"][3, 2] = np.nan
    return {**arrays, "nis": rng.uniform(size=T), "log_likelihood": np.array(-12.5)}


def columns():
    for name, values in result().items():
        if values.ndim < 2:
            yield name, np.broadcast_to(values, T)
        else:
            for i, axis in enumerate(AXES):
                yield (f"{name}{i}" if "q" in name else f"{name}_{axis}"), values[:, i]


@pytest.mark.parametrize("suffix", WRITERS)
def test_the_same_result_gives_the_same_bytes(tmp_path, suffix):
    contents = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        save_results(tmp_path / name / f"out{suffix}", result())
        contents.append([path.read_bytes() for path in sorted((tmp_path / name).iterdir())])
    assert contents[0] == contents[1]


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_tables_keep_every_bit(tmp_path, suffix):
    path = tmp_path / f"result{suffix}"
    save_results(path, result(), DOUBLE)
    if suffix == ".csv":
        read = np.genfromtxt(path, delimiter=",", names=True)
    else:
        table = parquet.read_table(path)
        read = {name: table.column(name).to_numpy() for name in table.column_names}
        assert list(read) == [name for name, _ in columns()]
    for name, values in columns():
        np.testing.assert_array_equal(read[name], values)


def test_mcap_is_read_by_the_decoder_of_its_makers(tmp_path):
    path = tmp_path / "result.mcap"
    save_results(path, result(), DOUBLE)
    seen = dict.fromkeys(TOPICS, 0)
    with path.open("rb") as stream:
        decoders = [decoder.DecoderFactory()]
        for item in reader.make_reader(stream, True, decoders).iter_decoded_messages():
            name = item.channel.topic.removeprefix("/ftbias/")
            i, message = seen[name], item.decoded_message
            seen[name] += 1
            force, torque = message.wrench.force, message.wrench.torque
            wrench = [force.x, force.y, force.z, torque.x, torque.y, torque.z]
            np.testing.assert_array_equal(wrench, result()[name][i])
            stamp = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
            assert stamp == pytest.approx(result()["t"][i], abs=1e-6)
            assert message.header.frame_id == "ft_sensor"
            assert item.schema.name == "geometry_msgs/msg/WrenchStamped"
    assert seen == {name: T if name in result() else 0 for name in TOPICS}


@pytest.mark.parametrize("frame", ["", "a", "ft_sensor", "<script>alert(1)</script>", "größe", "x" * 100])
def test_frames_of_any_length_keep_the_numbers_aligned(tmp_path, frame):
    save_mcap(tmp_path / "result.mcap", result(), About(frame or " "))
    streams = {stream.topic: stream for stream in read_recording(tmp_path / "result.mcap").streams}
    assert streams["/ftbias/bias"].names == (frame or " ",)
    np.testing.assert_array_equal(streams["/ftbias/bias"].values, result()["bias"])


@pytest.mark.parametrize(("bias", "reports"), [([np.nan] + [0.0] * 5, "wrench_on_tool"), ([0.0] * 6, "on_tool")])
def test_offsets_that_mean_nothing_are_refused(bias, reports):
    with pytest.raises(ValueError, match="no offsets"):
        dump_offsets(bias, reports)


def test_unknown_suffixes_and_folders_are_named(tmp_path):
    with pytest.raises(UsageError, match=r"\.npz, \.parquet, \.csv, \.mcap"):
        save_results(tmp_path / "result.xlsx", result())
    for suffix in WRITERS:
        with pytest.raises(OutputError, match="cannot be written"):
            save_results(tmp_path / "none" / f"result{suffix}", result())


@pytest.mark.parametrize(("suffix", "module"), [(".parquet", "pyarrow"), (".mcap", "mcap.writer")])
def test_a_missing_package_is_named_with_its_extra(tmp_path, monkeypatch, suffix, module):
    monkeypatch.setitem(__import__("sys").modules, module, None)
    with pytest.raises(OutputError, match=r"pip install 'ftbias-jax\[(ros|parquet)\]'"):
        save_results(tmp_path / f"result{suffix}", result())


def test_shapes_that_are_no_table_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"bias has shape \(30, 5\)"):
        save_results(tmp_path / "result.csv", {**result(), "bias": np.zeros((T, 5))})


def test_stamps_that_ros_cannot_have_are_named(tmp_path):
    with pytest.raises(OutputError, match="do not fit a ROS header"):
        save_results(tmp_path / "result.mcap", {**result(), "t": result()["t"] - 2 * START})
