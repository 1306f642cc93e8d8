"""Files that are cut, flipped or hostile are refused with a typed error, or their intact part is read and counted."""

import bz2
import io
import sqlite3
import struct

import numpy as np
import pytest
import recordings
import zstandard
from bounded import bounded
from mcap_ros2 import writer
from recordings import START, Joints, Wrench, bag_of

from ftbias_jax.errors import LogError
from ftbias_jax.io import budget, read_log
from ftbias_jax.io.budget import Budget
from ftbias_jax.io.ros import record

CONTAINERS = ["ros1", "ros1 bz2", "ros1 lz4", "sqlite", "mcap", "mcap zstd chunks"]


@pytest.fixture
def long_log():
    """Messages that fill several chunks or pages."""
    return recordings.messages(recordings.arrays(3000))


def salvage(path, setup):
    """Check that a file is refused without salvaging; return the salvaged log and what was lost."""
    with pytest.raises(LogError, match="--salvage reads what is whole") as caught:
        read_log(path, setup)
    assert "\n" not in str(caught.value)
    log = read_log(path, setup, salvage=True)
    assert any(repair.lost for repair in log.repairs)
    return log, log.repairs


def assert_part(log, published):
    """Check that every value that was read is one that was written under its stamp."""
    wrenches = {m.stamp: m.wrench for m in published if isinstance(m, Wrench)}
    stamps = START + np.rint((log.t + log.start - START * 1e-9) * 1e9).astype(int)
    written = np.array(list(wrenches))
    for stamp, wrench in zip(stamps, log.wrench, strict=True):
        if not np.isnan(wrench).any():
            nearest = written[np.abs(written - stamp).argmin()]  # Log.start is a float
            np.testing.assert_array_equal(wrench, wrenches[nearest])


@pytest.mark.parametrize("kind", [kind for kind in CONTAINERS if "bz2" not in kind])  # a block of bz2 is all or nothing
def test_a_cut_recording_is_salvaged_up_to_the_cut(tmp_path, setup, long_log, kind):
    path = recordings.write(tmp_path, kind, long_log)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    log, _ = salvage(path, setup)
    count = (~np.isnan(log.wrench).any(1)).sum()
    assert count > 0.3 * 3000
    assert_part(log, long_log)


def test_a_flipped_length_loses_only_its_record(tmp_path, setup, long_log):
    path = recordings.write(tmp_path, "ros1", long_log)
    content = bytearray(path.read_bytes())
    at = content.index(b"op=\x02", len(content) // 3) - 8
    content[at + 3] ^= 0x80  # a header of two gigabytes
    path.write_bytes(content)
    log, repairs = salvage(path, setup)
    assert (~np.isnan(log.wrench).any(1)).sum() + (~np.isnan(log.q).any(1)).sum() >= len(long_log) - 2
    assert any("bytes skipped" in repair.what for repair in repairs)


def test_flipped_stamps_and_frames_of_a_salvaged_bag_are_not_believed(tmp_path, setup, long_log):
    path = recordings.write(tmp_path, "ros1", long_log)
    content = bytearray(path.read_bytes())
    frames = [i for i in range(len(content)) if content.startswith(b"ft_sensor", i)]
    content[frames[300]] ^= 1
    content[frames[500] - 9] ^= 0x40  # the stamp's seconds
    content[frames[700] - 4] ^= 0x80  # the length of the frame
    path.write_bytes(content)
    log, repairs = salvage(path, setup)
    assert sum("not credible" in repair.what for repair in repairs) == 2
    assert (~np.isnan(log.wrench).any(1)).sum() == 2997
    assert_part(log, long_log)


def test_a_flipped_bit_in_an_mcap_chunk_loses_the_chunk_instead_of_a_digit(tmp_path, setup, long_log):
    """The chunks come from the official writer, which adds checksums."""
    path = tmp_path / "log.mcap"
    content = bytearray(mcap_of(long_log))
    content[len(content) // 2] ^= 0x40
    path.write_bytes(content)
    log, repairs = salvage(path, setup)
    assert "does not match its checksum" in repairs[0].what
    assert_part(log, long_log)


def mcap_of(published):
    """An MCAP file with many small chunks, written by the package mcap-ros2-support."""
    header = "std_msgs/Header header\n"
    schemas = {
        Joints: ("sensor_msgs/msg/JointState", header + "string[] name\nfloat64[] position\nfloat64[] velocity\n"),
        Wrench: ("geometry_msgs/msg/WrenchStamped", header + "float64[6] wrench\n"),
    }
    rest = "=" * 80 + "\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    rest += "=" * 80 + "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    stream = io.BytesIO()
    with writer.Writer(stream, chunk_size=20_000, compression=writer.CompressionType.NONE) as file:
        known = {kind: file.register_msgdef(name, text + rest) for kind, (name, text) in schemas.items()}
        for m in published:
            sec, nanosec = divmod(m.stamp, 10**9)
            content = {"header": {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": ""}}
            if isinstance(m, Joints):
                content |= {"name": list(m.names), "position": list(m.position), "velocity": list(m.velocity)}
            else:
                content["wrench"] = list(m.wrench)
            file.write_message(m.topic, known[type(m)], content, m.stamp)
    return stream.getvalue()


def test_mcap_by_its_makers_is_the_same_log(tmp_path, setup):
    (tmp_path / "log.mcap").write_bytes(mcap_of(recordings.messages()))
    log = read_log(tmp_path / "log.mcap", setup)
    np.testing.assert_array_equal(log.wrench, recordings.arrays()["wrench"])
    np.testing.assert_array_equal(log.q[::2], recordings.arrays()["q"])


def test_lengths_of_gigabytes_take_no_memory(tmp_path, setup):
    path = tmp_path / "log.bag"
    for content in (
        b"#ROSBAG V2.0\n" + b"\xff" * 4,
        bag_of(([b"op=\x05", b"compression=none", b"size=\xff\xff\xff\xff"], b"")),
        bag_of(([b"op=\x05", b"compression=bz2", b"size=\xff\xff\xff\xff"], bz2.compress(b""))),
        bag_of(([b"op=\x02"], b""))[:-4] + b"\xff" * 4,
        b"\x89MCAP0\r\n\x05" + b"\xff" * 8,
        b"\x89MCAP0\r\n\x06" + struct.pack("<QQQQIIQ", 40, 0, 0, 2**60, 0, 0, 0),
        b"\x89MCAP0\r\n\x04" + struct.pack("<QHHI", 8, 1, 0, 2**32 - 1),
    ):
        path.write_bytes(content)
        for how in (False, True):
            with bounded(mebibytes=64), pytest.raises(LogError):
                read_log(path, setup, salvage=how)


@pytest.mark.parametrize("compression", ["bz2", "lz4", "zstd"])
def test_bombs_that_declare_less_are_stopped_at_what_they_declare(tmp_path, compression):
    packers = {"bz2": "bz2", "lz4": "lz4.frame", "zstd": "zstandard"}
    packed = pytest.importorskip(packers[compression]).compress(bytes(50 << 20))
    (tmp_path / "log.bag").write_bytes(packed)
    allowed = Budget(tmp_path / "log.bag")
    with pytest.raises(budget.UnpackError, match="unpacks to more than 1000 bytes, but declares 1000"):
        budget.unpack(compression, packed, 1000, allowed)
    with pytest.raises(budget.UnpackError, match="cannot be unpacked"):
        budget.unpack(compression, b"no such stream", 1000, allowed)


def test_damage_in_many_places_is_told_in_few_lines(tmp_path, setup, long_log):
    path = recordings.write(tmp_path, "sqlite", long_log)
    with sqlite3.connect(path) as database:
        database.execute("UPDATE messages SET topic_id = 99 WHERE id % 3 = 0")
    database.close()
    _, repairs = salvage(path, setup)
    assert [repair.what for repair in repairs[20:]] == ["1480 more places are damaged", "3000 messages were recovered"]


def test_messages_that_are_bombs_are_refused(tmp_path, setup, monkeypatch):
    path = recordings.write(tmp_path, "sqlite", recordings.messages())
    with sqlite3.connect(path) as database:
        database.execute("UPDATE messages SET data = ? WHERE id = 5", [zstandard.compress(bytes(50 << 20))])
    database.close()
    monkeypatch.setattr(record, "SMALL_RECORDING", 1 << 16)
    for how in (False, True):
        with pytest.raises(LogError, match="looks like a decompression bomb"):
            read_log(path, setup, salvage=how)


def test_files_that_are_bombs_are_refused(tmp_path, setup, monkeypatch):
    monkeypatch.setattr(budget, "SMALL", 1 << 16)
    (tmp_path / "log.db3.zstd").write_bytes(zstandard.compress(bytes(50 << 20)))
    with pytest.raises(LogError, match=r"log\.db3\.zstd: unpacks to more than \d+ bytes"):
        read_log(tmp_path / "log.db3.zstd", setup)


@pytest.mark.parametrize(
    "script",
    [
        "ALTER TABLE messages RENAME TO m; CREATE VIEW messages AS WITH RECURSIVE r(id) AS (SELECT 1 UNION ALL SELECT "
        "id + 1 FROM r) SELECT id, 1 AS topic_id, 1 AS timestamp, x'00' AS data FROM r",
        "DROP TABLE topics",
        "ALTER TABLE messages DROP COLUMN data",
        "UPDATE topics SET name = x'ff'",
        "UPDATE messages SET data = 'text'",
        "UPDATE messages SET timestamp = 'late'",
        "UPDATE messages SET topic_id = 99",
    ],
)
def test_databases_that_are_no_bag_are_refused(tmp_path, setup, script):
    path = recordings.write(tmp_path, "sqlite", recordings.messages())
    with sqlite3.connect(path) as database:
        database.executescript("DROP INDEX IF EXISTS timestamp_idx;" + script)
    database.close()
    for how in (False, True):
        with pytest.raises(LogError):
            read_log(path, setup, salvage=how)
