"""The same log through every format, and features that only HDF5 and Parquet have."""

import sys

import h5py
import log_files
import numpy as np
import pyarrow as arrow
import pytest
import recordings
from one_line import reading_fails as fails
from pyarrow import parquet as pq

from ftbias_jax.io import read_log
from ftbias_jax.io.log import Log

FIELDS = ("t", "q", "dq", "wrench")


def written(path, log):
    return log_files.write(path, {name: getattr(log, name) for name in FIELDS})


def columns(log):
    return log_files.columns({name: getattr(log, name) for name in FIELDS})


@pytest.fixture(scope="session")
def original(tmp_path_factory, setup) -> Log:
    """A log as read from a recording: two merged streams."""
    folder = tmp_path_factory.mktemp("ros")
    return read_log(recordings.write(folder, "ros1", recordings.messages()), setup)


@pytest.mark.parametrize("suffix", log_files.SUFFIXES)
def test_every_format_gives_the_same_log(tmp_path, setup, original, suffix):
    log = read_log(written(tmp_path / f"log{suffix}", original), setup)
    for field in ("t", "q", "dq", "wrench", "temperature"):
        np.testing.assert_allclose(getattr(log, field), getattr(original, field), rtol=0, atol=1e-12)


@pytest.mark.parametrize(("name", "module"), [("log.h5", "h5py"), ("log.parquet", "pyarrow")])
def test_a_missing_package_is_named_with_its_extra(tmp_path, setup, original, monkeypatch, name, module):
    written(tmp_path / name, original)
    monkeypatch.setitem(sys.modules, module, None)
    fails(tmp_path / name, setup, f"needs the package {module}", "pip install 'ftbias-jax[")


@pytest.mark.parametrize("name", ["log.h5", "log.parquet"])
def test_other_files_are_refused(tmp_path, setup, name):
    fails(tmp_path / name, setup, "cannot be read: ", "No such file")
    for content in (b"", b"t,q0,q1\n0,1,2\n", bytes(100)):
        (tmp_path / name).write_bytes(content)
        fails(tmp_path / name, setup)
    fails(tmp_path, setup)


def test_parquet_stamps_may_be_integers_or_timestamps(tmp_path, setup, original):
    start = 1_700_000_000 * 10**9
    t = start + np.rint(original.t * 1e9).astype(np.int64)
    for kind in (arrow.int64(), arrow.timestamp("ns"), arrow.timestamp("us")):
        times = arrow.array(t // 1000 if kind == arrow.timestamp("us") else t).cast(kind)
        pq.write_table(arrow.table({**columns(original), "t": times}), tmp_path / "log.parquet")
        log = read_log(tmp_path / "log.parquet", setup)
        np.testing.assert_allclose(log.t, original.t, atol=1e-9)
        assert log.start == pytest.approx(start * 1e-9)


def test_parquet_nulls_are_not_measured(tmp_path, setup, original):
    table = {name: arrow.array(values, from_pandas=True) for name, values in columns(original).items()}
    assert table["q0"].null_count
    pq.write_table(arrow.table(table), tmp_path / "log.parquet")
    np.testing.assert_array_equal(read_log(tmp_path / "log.parquet", setup).q, original.q)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"q1": None}, ["position: no columns for the position"]),
        ({"fx": ["a"]}, ["fx: has the type string", "real numbers"]),
        ({"fx": [True]}, ["fx: has the type bool", "real numbers"]),
        ({"t": [None]}, ["t: has 60 nulls", "every sample a stamp"]),
    ],
)
def test_parquet_columns_that_cannot_be_read_are_named(tmp_path, setup, original, changes, words):
    table = {**columns(original), **{name: v and v * len(original.t) for name, v in changes.items()}}
    pq.write_table(arrow.table({name: v for name, v in table.items() if v is not None}), tmp_path / "log.parquet")
    fails(tmp_path / "log.parquet", setup, *words)


def test_a_parquet_without_rows_and_one_with_an_empty_column(tmp_path, setup, original):
    pq.write_table(
        arrow.table({name: arrow.array(x[:0]) for name, x in columns(original).items()}), tmp_path / "0.parquet"
    )
    fails(tmp_path / "0.parquet", setup, "has no rows")
    nothing = {"fx": arrow.nulls(len(original.t)), "notes": arrow.nulls(len(original.t))}
    pq.write_table(arrow.table({**columns(original), **nothing}), tmp_path / "log.parquet")
    log = read_log(tmp_path / "log.parquet", setup)
    assert np.isnan(log.wrench[:, 0]).all()
    np.testing.assert_array_equal(log.wrench[:, 1:], original.wrench[:, 1:])


def test_hdf5_streams_with_their_own_stamps_are_merged(tmp_path, setup, original):
    path = log_files.write(tmp_path / "log.h5", {**recordings.arrays(), "notes/anything": "other data are ignored"})
    np.testing.assert_array_equal(read_log(path.rename(tmp_path / "log.hdf5"), setup).q, original.q)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda root: root.__setitem__("q", h5py.ExternalLink("other.h5", "/q")), "q: is a link"),
        (lambda root: root.__setitem__("q", h5py.SoftLink("/wrench")), "q: is a link"),
        (lambda root: root.create_group("q"), "q: no motion data"),
        (lambda root: root.__setitem__("q", "text"), "q: is no dataset of numbers"),
        (lambda root: root.__setitem__("q", h5py.Empty("f8")), "q: is no dataset of numbers"),
        (lambda root: root.create_dataset("q", (60, 2), "f4", external=[("raw", 0, 480)]), "q: is stored in another"),
        (lambda root: root.create_virtual_dataset("q", h5py.VirtualLayout((60, 2), "f4")), "q: is stored in another"),
        (lambda root: root.create_dataset("q", (10**12, 2), "f4", chunks=(1000, 2)), "q: declares more than"),
        (lambda root: root.create_dataset("q", (10**7, 2), "f4", chunks=(1000, 2)), "q: has shape (10000000, 2)"),
        (lambda root: None, "q: no motion data"),
    ],
)  # fmt: skip
def test_hdf5_datasets_that_cannot_be_read_are_named(tmp_path, setup, original, change, words):
    path = written(tmp_path / "log.h5", original)
    with h5py.File(path, "a") as root:
        del root["q"]
        change(root)
    fails(path, setup, words)
