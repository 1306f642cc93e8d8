import os
import stat
from functools import partial

import numpy as np
import one_line
import pytest

from ftbias_jax.errors import LogError, OutputError
from ftbias_jax.io.atomic import make_folder, make_folder_inside, write_atomic
from ftbias_jax.io.write.npz import load_npz, save_npz, save_npz_parts

fails = partial(one_line.fails, kind=OutputError)


def test_a_new_file_has_the_content_and_the_mode_of_any_new_file(tmp_path):
    write_atomic(tmp_path / "new", lambda file: file.write(b"content") and None)
    (tmp_path / "plain").touch()
    assert (tmp_path / "new").read_bytes() == b"content"
    modes = {stat.S_IMODE(os.stat(tmp_path / name).st_mode) for name in ("new", "plain")}
    assert len(modes) == 1
    assert sorted(os.listdir(tmp_path)) == ["new", "plain"]


def test_no_folder_inside_a_folder_of_results_is_a_link(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "run1").symlink_to("../elsewhere")
    (tmp_path / "named").symlink_to("results")
    folder = str(tmp_path / "results")
    place = f"{folder}/run1"
    fails(lambda: make_folder_inside(folder, f"{place}/deeper"), place, "symbolic link")
    make_folder_inside(str(tmp_path / "named"), str(tmp_path / "named"))
    make_folder_inside(str(tmp_path / "named"), str(tmp_path / "named" / "run2"))
    assert (tmp_path / "results" / "run2").is_dir()
    assert not os.listdir(tmp_path / "elsewhere")


def test_the_content_is_on_disk_before_the_name_is(tmp_path, monkeypatch):
    calls = []
    fsync, replace = os.fsync, os.replace
    monkeypatch.setattr(os, "fsync", lambda *args: calls.append("fsync") or fsync(*args))
    monkeypatch.setattr(os, "replace", lambda *args: calls.append("replace") or replace(*args))
    write_atomic(tmp_path / "result", lambda file: None)
    assert calls[:2] == ["fsync", "replace"]


def test_places_that_cannot_hold_a_file_are_named(tmp_path):
    missing = tmp_path / "missing" / "result"
    fails(lambda: write_atomic(missing, lambda file: None), missing, "No such file", "check that the folder exists")
    fails(lambda: write_atomic(tmp_path, lambda file: None), tmp_path, "is not a regular file", "path of a file")
    fails(lambda: write_atomic(os.devnull, lambda file: None), os.devnull, "is not a regular file", "path of a file")


def parts():
    rng = np.random.default_rng(0)
    for count in (3, 0, 5):
        yield {"t": rng.normal(size=count), "bias": np.float32(rng.normal(size=(count, 6))), "total": np.float64(count)}


def test_arrays_in_parts_read_back_and_the_same_arrays_give_the_same_bytes(tmp_path):
    save_npz_parts(tmp_path / "a.npz", parts())
    save_npz_parts(tmp_path / "b.npz", parts())
    first, *_, last = parts()
    arrays = {name: np.concatenate([first[name], last[name]]) for name in ("t", "bias")} | {"total": np.float64(8)}
    save_npz(tmp_path / "whole.npz", arrays)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    for read in (load_npz(tmp_path / "a.npz"), load_npz(tmp_path / "whole.npz"), dict(np.load(tmp_path / "a.npz"))):
        for name, array in arrays.items():
            np.testing.assert_array_equal(read[name], array)
            assert (read[name].dtype, read[name].shape) == (array.dtype, array.shape)


def test_parts_that_fail_leave_nothing(tmp_path):
    def failing():
        yield from parts()
        raise LogError("is damaged")

    with pytest.raises(LogError, match="is damaged"):
        save_npz_parts(tmp_path / "result.npz", failing())
    assert os.listdir(tmp_path) == []


def test_objects_are_not_written(tmp_path):
    with pytest.raises(ValueError, match="not plain numbers: b"):
        save_npz(tmp_path / "a.npz", {"a": np.zeros(2), "b": np.array([None])})
    assert os.listdir(tmp_path) == []


def test_a_folder_is_made_with_those_above_it_or_told(tmp_path):
    make_folder(tmp_path / "a" / "b")
    make_folder(tmp_path / "a" / "b")
    assert (tmp_path / "a" / "b").is_dir()
    (tmp_path / "file").touch()
    fails(lambda: make_folder(tmp_path / "file"), tmp_path / "file", "cannot make the folder", "name another")
