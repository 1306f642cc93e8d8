"""Logs by URL: the same as from the file, without secrets in outputs, and one line where a log is not available."""

import hashlib
import json
import os
import sys
import time

import fsspec
import numpy as np
import pytest
from small_archive import SETUP, filter_archive, manifest, outputs, write_log

from ftbias_jax.cli.main import main
from ftbias_jax.errors import LogError
from ftbias_jax.fleet.entry import state_of
from ftbias_jax.fleet.find import find_logs
from ftbias_jax.io import read_log
from ftbias_jax.io import remote as fetch
from ftbias_jax.io.write.npz import load_npz
from ftbias_jax.setup import load_setup


@pytest.fixture
def store(tmp_path, monkeypatch):
    """Three logs in a store in memory, with the setup in the current folder; a function returns the bytes of a file."""
    monkeypatch.chdir(tmp_path)
    memory = fsspec.filesystem("memory")
    for seed, name in enumerate(["b.npz", "day/a.npz", "day/c.npz"]):
        write_log(tmp_path / "logs" / name, seed)
        memory.pipe(f"/runs/{name}", (tmp_path / "logs" / name).read_bytes())
    memory.pipe("/runs/notes.txt", b"no log")
    (tmp_path / "setup.toml").write_text(SETUP)
    yield memory
    memory.rm("/runs", recursive=True)
    fetch.forget()


def test_paths_and_urls_are_told_apart():
    assert list(map(fetch.is_url, ("s3://b/x.npz", "https://h/x.csv", "memory://x"))) == [True] * 3
    assert list(map(fetch.is_url, ("runs/x.npz", "C:/x.npz", "/a/s3:/x"))) == [False] * 3


@pytest.mark.parametrize(
    ("url", "expected"),
    [
        ("https://me:secret@host/a%20b.npz?sig=secret#x", "https://host/a%20b.npz"),
        ("s3://bucket/what?.npz", "s3://bucket/what?.npz"),
        ("runs/x.npz", "runs/x.npz"),
    ],
)
def test_secrets_of_a_url_are_not_shown(url, expected):
    assert fetch.without_credentials(url) == expected


def test_filter_names_the_url_and_its_sum(store):
    assert main(["filter", "memory://runs/b.npz", "--setup", "setup.toml", "-o", "out.npz"]) == 0
    (log,) = json.loads(str(load_npz("out.npz")["provenance"]))["logs"]
    assert log["name"] == "memory://runs/b.npz"
    assert log["sha256"] == hashlib.sha256(store.cat("/runs/b.npz")).hexdigest()


def test_an_archive_in_a_store_is_filtered_once(store):
    assert filter_archive("memory://runs") == 0
    assert set(outputs()) == {"b.npz", "day/a.npz", "day/c.npz"}
    entry = manifest()[1]
    assert entry.log == "memory:///runs/day/a.npz"
    assert entry.state.sha256 == hashlib.sha256(store.cat("/runs/day/a.npz")).hexdigest()
    assert fetch._kept == {}  # copies are removed with their logs
    first = manifest()
    assert filter_archive("memory://runs") == 0
    assert manifest() == first
    store.pipe("/runs/b.npz", store.cat("/runs/day/c.npz"))
    assert filter_archive("memory://runs") == 0
    changed = [one.output for one, two in zip(manifest(), first, strict=True) if one != two]
    assert changed == ["b.npz"]


def test_patterns_find_logs_in_a_store(store):
    tasks = find_logs(["memory://runs/*/*.npz"], "out", ".npz")
    assert [(task.log, task.output) for task in tasks] == [
        ("memory:///runs/day/a.npz", "day/a.npz"), ("memory:///runs/day/c.npz", "day/c.npz")]  # fmt: skip


def test_several_files_of_a_log_may_be_in_a_store(store):
    with np.load("logs/b.npz") as log:
        for name, arrays in (("joints", {"q": log["q"]}), ("ft", {"wrench": log["wrench"]})):
            np.savez(f"{name}.npz", t=log["t"], **arrays)
            store.put(f"{name}.npz", f"/runs/two/1_{name}.npz")
    with open("setup.toml", "a") as file:
        file.write('[log.files]\nposition = "*_joints.npz"\nwrench = "*_ft.npz"\n')
    assert main(["check", "memory://runs/two", "--setup", "setup.toml", "-o", "out"]) == 0
    (entry,) = manifest("manifest.check.jsonl")
    assert entry.files == ("memory:///runs/two/1_joints.npz", "memory:///runs/two/1_ft.npz")


def test_a_log_that_is_too_large_is_refused_and_nothing_is_left(store, monkeypatch, tmp_path):
    monkeypatch.setattr(fetch, "MOST_BYTES", 1000)
    monkeypatch.setattr("tempfile.tempdir", os.fspath(tmp_path))
    with pytest.raises(LogError, match=r"memory://runs/b.npz: has more than 1000 bytes"):
        read_log("memory://runs/b.npz", load_setup("setup.toml"))
    assert not list(tmp_path.glob("ftbias-*"))


def test_copies_are_few_and_removed_at_last(store, monkeypatch, tmp_path):
    monkeypatch.setattr(fetch, "MOST_KEPT", 2)
    monkeypatch.setattr("tempfile.tempdir", os.fspath(tmp_path))
    for name in ("b", "day/a", "day/c"):
        read_log(f"memory://runs/{name}.npz", load_setup("setup.toml"))
    assert len(list(tmp_path.glob("ftbias-*"))) == 2
    fetch.forget()
    assert not list(tmp_path.glob("ftbias-*"))


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("memory://runs/none.npz", "memory://runs/none.npz: cannot be read"),
        ("nonsense://runs/b.npz", "nonsense://runs/b.npz: cannot be read: Protocol not known"),
        ("memory://runs/bad.npz", "memory://runs/bad.npz: is not an NPZ file"),
    ],
)
def test_what_cannot_be_had_is_told_with_its_url(store, url, words):
    store.pipe("/runs/bad.npz", b"no log")
    with pytest.raises(LogError, match=words):
        read_log(url, load_setup("setup.toml"))


def test_without_fsspec_the_extra_is_named(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "fsspec", None)
    (tmp_path / "setup.toml").write_text(SETUP)
    line = ["filter", "s3://me:secret@bucket/x.npz", "--setup", "setup.toml", "-o", "out.npz"]
    assert main(line) == 1
    text = capsys.readouterr().err
    assert "s3://bucket/x.npz: reading it needs the package fsspec (pip install 'ftbias-jax[remote]')" in text
    assert "secret" not in text


@pytest.mark.parametrize("ask", [fetch.local_copy, fetch.listed])
def test_what_a_server_says_is_told_without_secrets(monkeypatch, ask):

    def fail(*_, **__):
        raise OSError("403, url='https://host/x.npz?sig=s%3Dig', user 'me', password p@ss or p%40ss, s=ig")

    monkeypatch.setattr(fsspec, "open", fail)
    monkeypatch.setattr(fsspec.core, "url_to_fs", fail)
    with pytest.raises(LogError, match=r"https://host/x\.npz: cannot be read: 403") as caught:
        ask("https://me:p%40ss@host/x.npz?sig=s%3Dig")
    assert not any(secret in str(caught.value) for secret in ("s%3Dig", "p@ss", "p%40ss", "'me'"))


def test_a_time_that_is_not_known_is_never_that_of_before(monkeypatch):
    monkeypatch.setitem(sys.modules, "fsspec", None)
    before = time.time_ns()
    first, second = (state_of(["https://host/x.npz"]) for _ in range(2))
    assert before <= first.modified_ns < second.modified_ns
