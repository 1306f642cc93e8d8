import io
import struct
import zipfile
from functools import partial

import numpy as np
import pytest
from one_line import fails

from ftbias_jax.io import budget, read_log
from ftbias_jax.io.tables.array_files import load_arrays

T = 5


def arrays():
    values = np.random.default_rng(0)
    return {
        "t": np.arange(T) * 0.01,
        "q": values.normal(size=(T, 2)),
        "dq": values.normal(size=(T, 2)),
        "wrench": values.normal(size=(T, 6)),
        "temperature": np.full(T, 25.0),
    }


def member(shape, data=b""):
    """Bytes of an NPY file whose header declares a shape."""
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return stream.getvalue() + data


@pytest.mark.parametrize(
    ("remove", "add", "field", "what"),
    [
        ("q", {}, "q", "no motion data"),
        ("wrench", {}, "wrench", "no wrench data"),
        ("t", {}, "t_joints", "there is no time"),
        ("t", {"t_joints": np.arange(T)}, "t_wrench", "but no t_wrench"),
        ("dq", {"t_joints": np.arange(T)}, "t", "is given together with t_joints"),
    ],
)
def test_missing_or_contradicting_arrays_are_named(tmp_path, setup, remove, add, field, what):
    path = tmp_path / "log.npz"
    np.savez(path, **{name: value for name, value in arrays().items() if name != remove}, **add)
    fails(lambda: read_log(path, setup), path, f": {field}: ", what)


def test_unknown_formats_and_absent_files_are_named(tmp_path, setup):
    fails(lambda: read_log(tmp_path / "log.mat", setup), tmp_path / "log.mat", "'.mat'", ".npz, .csv")
    fails(lambda: read_log(tmp_path / "log.npz", setup), tmp_path / "log.npz", "No such file", "check the path")


def zip_of(content, compression=zipfile.ZIP_DEFLATED, name="t.npy", times=1):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", compression) as archive:
        for _ in range(times):
            archive.writestr(name, content)
    return stream.getvalue()


def claims_more_than_the_file():
    content = bytearray(zip_of(member((4,), data=bytes(32)), zipfile.ZIP_STORED))
    directory = content.index(b"PK\x01\x02")
    content[directory + 20 : directory + 24] = struct.pack("<I", 1 << 24)  # the compressed size
    return content


def newer_version():
    content = bytearray(member((0,)))
    content[6] = 3
    return zip_of(bytes(content))


REFUSED = {
    "a CSV file": (lambda: b"t,q0,q1\n0,1,2\n", ["is not an NPZ file", "numpy.savez"]),
    "a member larger than the file": (
        claims_more_than_the_file,
        [": t.npy: is larger than the file it is in", "numpy.savez"],
    ),
    "two arrays of one name": (
        lambda: zip_of(member((0,)), times=2),
        ["two arrays of one name", "numpy.savez"],
    ),
    "a newer NPY version": (newer_version, [": t: has NPY version (3, 0)", "plain arrays"]),
    "a bomb": (
        lambda: zip_of(member((1 << 20,), data=bytes(8 << 20))),
        [": t.npy: unpacks to", "decompression bomb"],
    ),
    **{
        f"the name {name}": (partial(zip_of, member((0,)), name=name), ["unsafe array name", "without slashes"])
        for name in ("../t.npy", "a/t.npy", "a\\t.npy", "..npy")
    },
    **{
        f"a header that promises {shape}": (lambda shape=shape: zip_of(member(shape, data=bytes(32))), [])
        for shape in ((10**12,), (2**40, 2**40), (3,), (5,), (-1,), (2**70, 0))
    },
}


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize("what", REFUSED)
def test_files_that_are_no_log_or_hostile_are_refused_before_memory_is_taken(tmp_path, monkeypatch, what):
    make, words = REFUSED[what]
    monkeypatch.setattr(budget, "SMALL", 1 << 16)
    path = tmp_path / "log.npz"
    path.write_bytes(make())
    fails(lambda: load_arrays(path), path, *words)


def test_object_arrays_are_refused_only_where_they_are_read(tmp_path):
    path = tmp_path / "log.npz"
    np.savez(path, t=np.zeros(2), extra=np.array([None, {}], object))
    assert load_arrays(path, ["t"]).keys() == {"t"}
    fails(lambda: load_arrays(path), path, ": extra: holds Python objects", "plain arrays")


def test_constant_arrays_of_ordinary_logs_pass(tmp_path):
    np.savez_compressed(tmp_path / "log.npz", dq=np.full((1 << 17, 7), np.nan))
    assert np.isnan(load_arrays(tmp_path / "log.npz")["dq"]).all()
