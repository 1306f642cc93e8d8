"""Files and names made to hang, fill the memory or cause a traceback: one line soon, or a counted repair.

Every time limit is ten times what is needed here; the faults that the rows guard against took a minute or never ended.
"""

import bz2
import os
import re
import sqlite3
import struct
import zlib
from dataclasses import replace

import h5py
import numpy as np
import pyarrow as arrow
import pytest
import recordings
import zstandard
from bounded import bounded
from pyarrow import parquet
from recordings import Wrench, bag_of, bag_record
from small_archive import named

from ftbias_jax.cli.main import main
from ftbias_jax.errors import LogError, OutputError, SetupError
from ftbias_jax.fleet.find import find_logs
from ftbias_jax.io import read_log
from ftbias_jax.io.write.outputs import check_writable
from ftbias_jax.setup import load_setup
from ftbias_jax.setup.recorded import LogSetup

COLUMNS = ["t", "q0", "q1", "fx", "fy", "fz", "tx", "ty", "tz"]
GIGABYTE = 1 << 30


@pytest.fixture
def refused(setup):
    """Check that a log is refused in both modes of reading, soon and with little memory."""

    def run(path, match, setup=setup):
        with bounded(30, 512):
            with pytest.raises(LogError, match=match):
                read_log(path, setup)
            with pytest.raises(LogError):
                read_log(path, setup, salvage=True)

    return run


def hole(path):
    """Write a sparse file of 40 GiB that begins like a file of this kind."""
    starts = {".csv": ",".join(COLUMNS).encode() + b"\n0,1,2,3,4,5,6,7,8\n", ".bag": b"#ROSBAG V2.0\n"}
    with open(path, "wb") as file:
        file.write(starts.get(path.suffix, b"x"))
        file.truncate(40 * GIGABYTE)


NO_FILES = {
    "a FIFO that would be waited for": (os.mkfifo, "is a FIFO"),
    "a device without an end": (lambda path: path.symlink_to("/dev/zero"), "is a device"),
    "a circle of links": (lambda path: path.symlink_to(path.name), "symbolic links"),
    "a hole": (hole, r"has 42949672960 bytes, of which \d+ are stored: the file is sparse"),
}


@pytest.mark.parametrize("what", NO_FILES)
@pytest.mark.parametrize("suffix", ["npz", "csv", "parquet", "h5", "bag", "db3", "mcap"])
def test_a_log_that_is_no_file_of_data_is_refused_soon(tmp_path, refused, suffix, what):
    make, words = NO_FILES[what]
    make(tmp_path / f"log.{suffix}")
    refused(tmp_path / f"log.{suffix}", words)


@pytest.mark.parametrize("kind", ["fifo", "device", "folder", "circle"])
def test_a_setup_that_is_no_file(tmp_path, kind):
    path = tmp_path / "setup.toml"
    make = {"fifo": os.mkfifo, "device": lambda path: path.symlink_to("/dev/zero"), "folder": os.mkdir}
    make.get(kind, lambda path: path.symlink_to("setup.toml"))(path)
    with pytest.raises(SetupError, match=r"is a FIFO|is a device|is a folder|symbolic links"):
        load_setup(path)


def test_a_setup_without_a_name_is_none_left_out(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["info", "log.npz", "--setup", ""]) == 1
    assert "the setup with an empty name: cannot be read" in capsys.readouterr().err


def test_a_fifo_as_a_result_is_refused_before_the_work(tmp_path):
    os.mkfifo(tmp_path / "out.npz")
    with pytest.raises(OutputError, match="is a FIFO"):
        check_writable(tmp_path / "out.npz")


def test_folders_whose_links_lead_back_are_searched_once(tmp_path):
    (tmp_path / "logs" / "day").mkdir(parents=True)
    (tmp_path / "logs" / "day" / "a.npz").touch()
    for i in range(4):
        (tmp_path / "logs" / f"link{i}").symlink_to("..")
        (tmp_path / "logs" / "day" / f"link{i}").symlink_to(tmp_path / "logs")
    tasks = find_logs([str(tmp_path / "logs")], str(tmp_path / "out"), ".npz")
    assert [task.output for task in tasks] == ["day/a.npz"]


class Harmful:
    """An object that runs a command when it is unpickled."""

    def __reduce__(self):
        return eval, ("open('harm', 'w')",)


def test_pickled_objects_are_not_unpickled(tmp_path, monkeypatch, refused):
    monkeypatch.chdir(tmp_path)
    arrays = {"t": np.arange(50) * 0.01, "wrench": np.ones((50, 6))}
    np.savez("log.npz", q=np.array([[Harmful()] * 2] * 50, object), **arrays)
    refused("log.npz", r"q: holds Python objects \(save plain arrays")
    assert os.listdir() == ["log.npz"]


def test_an_array_that_unpacks_to_hundreds_of_megabytes(tmp_path, refused):
    np.savez_compressed(tmp_path / "log.npz", q=np.zeros((20 << 20, 2)))
    refused(tmp_path / "log.npz", r"q.npy: unpacks to \d+ bytes \(more than 100 times looks like a decompression bomb")


def test_markup_and_control_characters_in_frames_and_topics(tmp_path, monkeypatch, capsys):
    """Messages show them as text, without what a terminal or a page would execute."""
    frame = "<script>alert(1)</script>\x1b[2J\n"
    two = [
        m._replace(frame=frame * (i % 2), topic="/w\x1b[2J") if isinstance(m, Wrench) else m
        for i, m in enumerate(recordings.messages())
    ]
    path = recordings.write(tmp_path, "mcap", two)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "setup.toml").write_text(named())
    assert main(["filter", str(path), "--setup", "setup.toml", "-o", "out.npz"]) == 1
    said = capsys.readouterr().err
    assert "the wrenches of /w?[2J are in several frames" in said
    assert said.endswith("\n")
    assert said[:-1].isprintable()
    assert not os.path.exists("out.npz")


def parquet_of(path, constant, blocks, dictionary):
    block = arrow.table([arrow.array(constant)] * len(COLUMNS), names=COLUMNS)
    with parquet.ParquetWriter(path, block.schema, compression="zstd", use_dictionary=dictionary) as writer:
        for _ in range(blocks):
            writer.write_table(block)
    return path


@pytest.mark.parametrize("dictionary", [True, False])
def test_a_parquet_whose_numbers_fill_the_memory(tmp_path, refused, dictionary):
    """Half a gigabyte in a megabyte: references to one number, or pages of zeros that compress a thousandfold."""
    path = parquet_of(tmp_path / "log.parquet", np.zeros(1 << 18), 20, dictionary)
    assert path.stat().st_size < 2 << 20
    refused(path, "that looks like a decompression bomb")


def test_a_page_of_a_parquet_that_declares_more_than_its_footer(tmp_path, refused):
    """Two gigabytes in the header of one page, unknown to the footer; its column is the last of the file."""
    path = parquet_of(tmp_path / "log.parquet", np.arange(1000.0), 1, False)
    metadata = parquet.ParquetFile(path).metadata
    last = metadata.row_group(0).column(len(COLUMNS) - 1)
    content, at = path.read_bytes(), last.data_page_offset + 3  # after the page's kind: its unpacked size
    size = content.index(b"\x15", at)
    assert content[at - 1] == 0x15
    # The header grows by three bytes; the page loses them at its end, so that all other positions stay.
    end = last.data_page_offset + last.total_compressed_size
    huge = bytes([0xFE, 0xFF, 0xFF, 0xFF, 0x0F])
    grown = content[:at] + huge + content[size:end]
    path.write_bytes(grown[:end] + content[end:])
    refused(path, "has a page that unpacks to 2147483647 bytes")


def test_a_parquet_of_one_long_text_repeated(tmp_path, refused):
    path = parquet_of(tmp_path / "log.parquet", ["x" * 100_000] * 1000, 1, True)
    assert path.stat().st_size < 1 << 20
    refused(path, "t: has the type string")


def test_two_joints_of_one_name_in_a_parquet_are_told_with_the_file(tmp_path, capsys):
    names = ["t", "q0", "q0", *COLUMNS[3:]]
    parquet.write_table(arrow.table([arrow.array(np.arange(10.0))] * len(names), names=names), tmp_path / "log.parquet")
    assert main(["info", str(tmp_path / "log.parquet")]) == 1
    assert "log.parquet: q0: two columns are of this joint" in capsys.readouterr().err


def hdf5_with(path, chunk, packed):
    with h5py.File(path, "w") as root:
        root["t"], root["wrench"] = np.arange(1000) * 0.01, np.ones((1000, 6))
        shape = {"shape": (1000, 2), "maxshape": (None, 2), "chunks": (chunk, 2), "dtype": "f8"}
        root.create_dataset("q", compression="gzip", **shape).id.write_direct_chunk((0, 0), packed)
    return path


def test_an_hdf5_chunk_that_unpacks_to_more_than_its_shape(tmp_path, refused):
    packed = zlib.compress(bytes(300 << 20))
    refused(hdf5_with(tmp_path / "log.h5", 1000, packed), "q: has a chunk of .* unpacks to more than the 16000 of its")


def test_an_hdf5_chunk_of_gigabytes(tmp_path, refused):
    path = hdf5_with(tmp_path / "log.h5", GIGABYTE // 8, zlib.compress(bytes(1 << 20)))
    refused(path, "q: has chunks of 2147483648 bytes")


def bag_chunk(compression, packed, size):
    return [b"op=\x05", b"compression=" + compression, b"size=" + struct.pack("<I", size)], packed


@pytest.mark.parametrize("compression", ["bz2", "lz4"])
def test_a_chunk_of_a_bag_that_declares_a_gigabyte(tmp_path, refused, compression):
    packed = pytest.importorskip({"bz2": "bz2", "lz4": "lz4.frame"}[compression]).compress(bytes(1 << 20))
    (tmp_path / "log.bag").write_bytes(bag_of(bag_chunk(compression.encode(), packed, GIGABYTE)))
    refused(tmp_path / "log.bag", "declares 1073741824 bytes in .* looks like a decompression bomb")


def test_many_chunks_of_a_bag_that_are_large_together(tmp_path, refused):
    chunk = bag_chunk(b"bz2", bz2.compress(bytes(16 << 20)), 16 << 20)
    (tmp_path / "log.bag").write_bytes(bag_of(*[chunk] * 40))
    refused(tmp_path / "log.bag", "no whole record|unpacks to more than")


def test_a_small_chunk_of_millions_of_tiny_records(tmp_path, refused):
    tiny = bag_record([b"op=\x02"], b"") * (1 << 19)
    (tmp_path / "log.bag").write_bytes(bag_of(bag_chunk(b"bz2", bz2.compress(tiny), len(tiny))))
    assert (tmp_path / "log.bag").stat().st_size < 3000
    refused(tmp_path / "log.bag", "a message has a damaged header")


def test_a_bag_that_is_full_of_what_may_begin_a_record(tmp_path, refused):
    (tmp_path / "log.bag").write_bytes(b"#ROSBAG V2.0\n" + b"\xff" * 8 + b"\x04\0\0\0op=\x02" * 200_000)
    refused(tmp_path / "log.bag", "holds too many records for its")


MCAP = b"\x89MCAP0\r\n"


def mcap_record(kind, content):
    return struct.pack("<BQ", kind, len(content)) + content


def mcap_text(text):
    return struct.pack("<I", len(text)) + text


def mcap_chunk(records):
    packed = zstandard.compress(records)
    header = struct.pack("<QQQI", 0, 0, len(records), 0) + mcap_text(b"zstd")
    return mcap_record(6, header + struct.pack("<Q", len(packed)) + packed)


def mcap_channel(topic, message_type, definition=b""):
    schema = struct.pack("<H", 1) + mcap_text(message_type) + mcap_text(b"ros2msg") + mcap_text(definition)
    channel = struct.pack("<HH", 1, 1) + mcap_text(topic) + mcap_text(b"cdr") + struct.pack("<I", 0)
    return mcap_record(3, schema) + mcap_record(4, channel)


def mcap_message(data):
    return mcap_record(5, struct.pack("<HIQQ", 1, 0, 0, 0) + data)


def test_an_mcap_of_millions_of_tiny_records(tmp_path, refused):
    (tmp_path / "log.mcap").write_bytes(MCAP + mcap_chunk(mcap_record(9, b"") * 6_000_000) * 20)
    refused(tmp_path / "log.mcap", "holds too many records for its")


def test_an_mcap_that_is_full_of_what_may_begin_a_chunk(tmp_path, refused):
    (tmp_path / "log.mcap").write_bytes(MCAP + b"\xff" * 9 + b"\x06" * 400_000)
    refused(tmp_path / "log.mcap", "holds too many records for its")


def test_a_joint_state_of_millions_of_names(tmp_path, refused):
    names = b"\0\1\0\0" + struct.pack("<III", 1, 0, 1) + bytes(4) + struct.pack("<I", 10_000_000) + bytes(40_000_000)
    content = MCAP + mcap_channel(b"/joints", b"sensor_msgs/msg/JointState") + mcap_chunk(mcap_message(names))
    (tmp_path / "log.mcap").write_bytes(content)
    refused(tmp_path / "log.mcap", "message 1 of /joints has a list of 10000000, more than 1000")


@pytest.mark.parametrize("column", ["name", "type", "serialization_format"])
def test_a_number_in_place_of_a_name_is_no_length(tmp_path, setup, column):
    """SQLite keeps any type in any column, and bytes(N) is N zeros."""
    path = recordings.write(tmp_path, "sqlite", recordings.messages(recordings.arrays(30)))
    with sqlite3.connect(path) as database:  # columns without a type keep numbers as they are
        fields = "id, name, type, serialization_format"
        database.execute(f"CREATE TABLE untyped ({fields})")
        database.execute(f"INSERT INTO untyped SELECT {fields} FROM topics")
        database.execute("DROP TABLE topics")
        database.execute("ALTER TABLE untyped RENAME TO topics")
        database.execute(f"UPDATE topics SET {column} = 3000000000")
    database.close()
    with bounded(mebibytes=128), pytest.raises(LogError):
        read_log(path, setup)


def test_pages_of_a_database_that_lead_to_the_same_messages_again(tmp_path, setup):
    """Every inner page refers to one child many times: the rows number the page's entries to the power of the depth."""
    path = recordings.write(tmp_path, "sqlite", recordings.messages(recordings.arrays(3000)))
    with sqlite3.connect(path) as database:
        database.executescript("PRAGMA journal_mode = DELETE; PRAGMA page_size = 512;")
    database.execute("VACUUM")
    database.close()
    content = bytearray(path.read_bytes())
    for start in range(512, len(content), 512):
        if content[start] == 5:  # an inner page of a table
            (count,) = struct.unpack_from(">H", content, start + 3)
            cells = struct.unpack_from(f">{count}H", content, start + 12)
            child = content[start + cells[0] : start + cells[0] + 4]
            for cell in cells:
                content[start + cell : start + cell + 4] = child
            content[start + 8 : start + 12] = child
    path.write_bytes(content)
    with bounded(10):
        with pytest.raises(LogError, match="--salvage reads what is whole"):
            read_log(path, setup)
        log = read_log(path, setup, salvage=True)
    assert "numbers of the messages do not increase" in log.repairs[0].what


def test_a_csv_that_is_one_line_of_many_megabytes(tmp_path, refused):
    (tmp_path / "log.csv").write_bytes(b"x" * (20 << 20))
    refused(tmp_path / "log.csv", "line 1: is longer than 1048576 characters")
    (tmp_path / "log.csv").write_bytes(",".join(COLUMNS).encode() + b"\n" + b"1" * (20 << 20))
    refused(tmp_path / "log.csv", "line 2: is longer than 1048576 characters")


@pytest.mark.parametrize("how", ["topic", "column", "array", "file"])
def test_names_of_a_megabyte_are_cut_in_messages(tmp_path, setup, how):
    long = "a" * 1_000_000
    if how == "topic":
        path = tmp_path / "log.mcap"
        channel = mcap_channel(long.encode(), b"sensor_msgs/msg/JointState")
        path.write_bytes(MCAP + channel + mcap_message(b"xx"))
    elif how == "column":
        path = tmp_path / "log.csv"
        path.write_text(f"t,{','.join(long[i : i + 100_000] for i in range(0, 900_000, 100_000))}\n1,2\n")
    elif how == "array":
        path = tmp_path / "log.npz"
        np.savez(path, **{f"../{long[:60_000]}": np.zeros(3)})
    else:
        path = tmp_path / f"{long}.npz"
    with pytest.raises(LogError) as caught:
        read_log(path, setup)
    assert len(str(caught.value)) < 2500


@pytest.mark.parametrize(
    "command",
    [
        "demo --duration 1e30 --rate 1e30",
        "demo --duration 1e200 --rate 1e200",
        "simulate --setup setup.toml -o log.npz --duration 1e30 --rate 1e30",
    ],
)
def test_logs_that_no_memory_holds_are_not_begun(logs, capsys, command):
    assert main(command.split()) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "samples" in printed.err
    assert printed.err.count("\n") == 1


HOSTILE = {
    "types within types": ("A a", "a recursive definition, or types nested too deeply"),
    "a line that is no field": ("?" * 100, "has a definition with the line"),
    "far too long": ("float64 x\n" * 40_000, "has a definition of 400000 characters"),
    "more numbers than there are bytes": (
        "float64[999999999] x",
        "is damaged: 24 bytes, at least 7999999992 are needed",
    ),
    "a list of lists of lists": ("B[999999] x\n" + "=" * 80 + "\nMSG: a/B\nuint8[999999] x", "is damaged: 24 bytes"),
}


@pytest.mark.parametrize("what", HOSTILE)
def test_a_definition_of_messages_that_is_made_to_do_harm(tmp_path, setup, refused, what):
    text, words = HOSTILE[what]
    records = mcap_channel(b"/state", b"a/msg/A", text.encode()) + 20 * mcap_message(b"\0\1\0\0" + bytes(20))
    (tmp_path / "log.mcap").write_bytes(MCAP + records + mcap_record(2, bytes(20)))
    stated = replace(setup, log=LogSetup(topics={"wrench": "/state:x"}))
    refused(tmp_path / "log.mcap", re.escape(words), setup=stated)
