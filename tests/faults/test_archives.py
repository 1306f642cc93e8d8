"""Failures while logs are filtered from file to file: a killed process, a full disk."""

import errno
import os
import re
import signal
import subprocess
import sys
import tempfile
import time

import pytest
import recordings
from small_archive import assert_same_outputs, filter_archive, manifest, named, outputs, write_log

import ftbias_jax
from ftbias_jax import files
from ftbias_jax.cli import archive
from ftbias_jax.cli.main import main
from ftbias_jax.io.write.npz import load_npz


def filter_in_another_process():
    program = "import sys; from ftbias_jax.cli.main import main; sys.exit(main())"
    command = [sys.executable, "-c", program, "filter", "logs", "--setup", "setup.toml", "-o", "out"]
    environment = {**os.environ, "PYTHONPATH": os.path.dirname(os.path.dirname(ftbias_jax.__file__))}
    return subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def statuses():
    return [entry.status for entry in manifest()]


@pytest.mark.slow
def test_sigkill_in_the_middle_of_an_archive(logs, monkeypatch, capsys):
    """A file with a result's name is complete, and what the manifest lists is not repeated."""
    for seed in range(12):
        write_log(logs / "more" / f"{seed:02d}.npz", seed, 20_000)
    process = filter_in_another_process()
    while process.poll() is None and "ok" not in statuses():
        time.sleep(0.02)
    process.kill()
    assert process.wait() == -signal.SIGKILL
    done = [entry.output for entry in manifest() if entry.status == "ok"]
    assert 0 < len(done) < 15
    assert set(done) <= outputs().keys()  # each was loaded
    again, whole = [], archive.do_task
    monkeypatch.setattr(archive, "do_task", lambda task, **rest: again.append(task.output) or whole(task, **rest))
    assert filter_archive("logs") == 0
    assert sorted([*done, *again]) == [entry.output for entry in manifest()]
    assert f"15 logs: 15 ok, 0 with data loss, 0 failed ({len(done)} of all" in capsys.readouterr().out
    assert len(outputs()) == 15


class Disk:
    """A disk with limited room, which temporary files give back."""

    room = 10**9

    def file(self, opened, temporary):
        return File(self, opened, temporary)


class File:
    """An open file on the disk, which is removed if it does not fit."""

    def __init__(self, disk, opened, temporary):
        self.disk, self.opened, self.temporary, self.taken = disk, opened, temporary, 0

    def write(self, content):
        size = memoryview(content).nbytes
        if size > self.disk.room:
            self.temporary = True
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self.disk.room -= size
        self.taken += size
        return self.opened.write(content)

    def __getattr__(self, name):
        return getattr(self.opened, name)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.opened.close()
        self.disk.room += self.taken * self.temporary


@pytest.fixture
def disk(monkeypatch):
    """A limited disk for results; reading them uses the real disk."""
    disk, make = Disk(), tempfile.TemporaryFile
    monkeypatch.setattr(files, "open", lambda *how: disk.file(os.fdopen(*how), False), raising=False)
    monkeypatch.setattr(tempfile, "TemporaryFile", lambda **where: disk.file(make(**where), True))
    return disk


@pytest.mark.parametrize("room", [0, 10_000, 150_000])
def test_a_full_disk_leaves_the_old_result_and_one_line(logs, disk, capsys, room):
    (logs.parent / "out.npz").write_bytes(b"an older result")
    disk.room = room
    assert main(["filter", "logs/b.npz", "--setup", "setup.toml", "-o", "out.npz", "--force"]) == 1
    message = "ftbias: out.npz: cannot be written: No space left on device (check that the folder exists, may be"
    assert capsys.readouterr().err.splitlines()[-1].startswith(message)  # after any lines of progress
    assert (logs.parent / "out.npz").read_bytes() == b"an older result"
    assert sorted(os.listdir()) == ["logs", "out.npz", "setup.toml"]


def test_a_disk_that_is_full_in_the_middle_of_an_archive(logs, disk, capsys):
    for _ in range(2):  # in the first run compiled programs may take room, too
        disk.room = 10**9
        assert filter_archive("logs") == 0
        expected, used = outputs(), 10**9 - disk.room
        for path in (logs.parent / "out").rglob("*.npz"):
            path.unlink()
    disk.room = used * 3 // 4  # a result takes twice its room while it is written
    assert filter_archive("logs") == 3
    assert [entry.status for entry in manifest()] == ["ok", "failed", "failed"]
    assert "No space left on device" in manifest()[1].error
    assert outputs().keys() == {"b.npz"}
    disk.room = 10**9
    assert filter_archive("logs") == 0
    assert_same_outputs(outputs(), expected)


def test_a_disk_without_room_for_the_manifest(logs, disk, capsys):
    disk.room = 100
    assert filter_archive("logs") == 1
    printed = capsys.readouterr()
    assert printed.err.startswith("ftbias: out/manifest.filter.jsonl: cannot be written: No space left on device")
    assert printed.err.count("\n") == 1
    assert os.listdir("out") == ["manifest.filter.jsonl"]
    disk.room = 10**9
    assert filter_archive("logs") == 0  # continues after the cut line
    assert len(manifest()) == 3


def test_a_cut_bag_is_refused_or_salvaged_with_its_loss_told(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    path = recordings.write(tmp_path, "ros1", recordings.messages(recordings.arrays(3000)))
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    (tmp_path / "setup.toml").write_text(named())
    command = ["filter", path.name, "--setup", "setup.toml", "-o", "out.npz"]
    assert main(command) == 1
    assert "(--salvage reads what is whole)" in capsys.readouterr().err
    assert not os.path.exists("out.npz")
    assert main([*command, "--salvage"]) == 3
    assert re.search(r"warning: log.bag: \d{4} messages were recovered", capsys.readouterr().err)
    assert 1000 < len(load_npz("out.npz")["t"]) < 2000
