import io
import os
import zipfile

import numpy as np
import pytest

from ftbias_jax.errors import LogError, OutputError
from ftbias_jax.io.write.npz import load_npz, save_npz, save_npz_parts


def parts():
    rng = np.random.default_rng(0)
    for count in (3, 0, 5):
        yield {"t": rng.normal(size=count), "bias": np.float32(rng.normal(size=(count, 6))), "total": np.float64(count)}


def test_parts_are_put_together(tmp_path):
    save_npz_parts(tmp_path / "result.npz", parts())
    whole = load_npz(tmp_path / "result.npz")
    for name in ("t", "bias"):
        expected = np.concatenate([part[name] for part in parts()])
        np.testing.assert_array_equal(whole[name], expected)
        assert whole[name].dtype == expected.dtype
    assert (whole["total"], whole["total"].shape) == (8, ())
    assert os.listdir(tmp_path) == ["result.npz"]


def test_numpy_reads_it_and_the_same_parts_give_the_same_bytes(tmp_path):
    for name in ("a.npz", "b.npz"):
        save_npz_parts(tmp_path / name, parts())
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    assert np.load(tmp_path / "a.npz")["bias"].shape == (8, 6)
    assert zipfile.ZipFile(io.BytesIO((tmp_path / "a.npz").read_bytes())).testzip() is None


def test_parts_that_fail_leave_nothing(tmp_path):
    def failing():
        yield from parts()
        raise LogError("is damaged")

    with pytest.raises(LogError, match="is damaged"):
        save_npz_parts(tmp_path / "result.npz", failing())
    assert os.listdir(tmp_path) == []


def test_folders_that_do_not_exist_are_named(tmp_path):
    with pytest.raises(OutputError, match="cannot be written: No such file"):
        save_npz_parts(tmp_path / "none" / "result.npz", parts())


def test_objects_are_refused(tmp_path):
    with pytest.raises(ValueError, match="not plain numbers: a"):
        save_npz(tmp_path / "result.npz", {"a": np.array([None])})
