"""Archives of logs with a file per stream: one result and one line of the manifest per log."""

import hashlib
import json
import os
from pathlib import Path

import numpy as np
import pytest
from small_archive import SETUP, filter_archive, manifest, outputs, write_log

from ftbias_jax.cli.main import main
from ftbias_jax.fleet.find import Task, expand, find_logs, inputs

STAR = {"position": "*_joints.npz", "wrench": "*_ft.npz"}
FIXED = {"position": "joints.npz", "wrench": "ft.npz"}


def split(path, files, shared):
    """A log in two files instead of one."""
    write_log(path, seed=len(shared))
    with np.load(path) as log:
        for key, arrays in (("position", {"q": log["q"]}), ("wrench", {"wrench": log["wrench"]})):
            np.savez(path.parent / files[key].replace("*", shared), t=log["t"], **arrays)
    path.unlink()


def with_files(files):
    return SETUP + "[log.files]\n" + "".join(f'{key} = "{name}"\n' for key, name in files.items())


@pytest.fixture
def flat(tmp_path, monkeypatch):
    """Two logs of two files each in one folder, and a file that belongs to neither."""
    monkeypatch.chdir(tmp_path)
    for shared in ("a", "bb"):
        split(tmp_path / "logs" / "whole.npz", STAR, shared)
    np.savez(tmp_path / "logs" / "notes.npz", x=1)
    (tmp_path / "setup.toml").write_text(with_files(STAR))
    return tmp_path / "logs"


def test_a_flat_folder_has_a_log_for_each_file_of_the_wrench(flat):
    tasks = find_logs(["logs"], "out", ".npz", STAR)
    assert tasks == [
        Task(f"logs/{name}_ft.npz", f"{name}_ft.npz", (f"logs/{name}_joints.npz", f"logs/{name}_ft.npz"))
        for name in ("a", "bb")
    ]
    assert find_logs(["logs/*_joints.npz"], "out", ".npz", STAR) == tasks  # any of the files will do
    assert find_logs(["logs/*.npz", "logs/a_joints.npz"], "out", ".npz", STAR) == tasks
    assert expand(["logs/a_joints.npz", "logs/a_ft.npz"], STAR) == ["logs/a_ft.npz"]
    assert inputs(["logs/a_ft.npz"], STAR) == ["logs/a_joints.npz", "logs/a_ft.npz"]


def test_each_folder_with_the_named_files_is_a_log(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for day in ("1", "2"):
        split(tmp_path / "logs" / day / "whole.npz", FIXED, "")
    tasks = find_logs(["logs"], "out", ".npz", FIXED)
    assert [(task.log, task.output) for task in tasks] == [(f"logs/{day}/ft.npz", f"{day}/ft.npz") for day in "12"]


def test_a_pattern_that_fits_every_name_does_not_take_files_of_the_others(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("a.npz", "a_ft.npz"):
        np.savez(name, x=1)
    assert expand(["."], {"position": "*.npz", "wrench": "*_ft.npz"}) == ["./a_ft.npz"]


def test_every_log_is_filtered_once_from_all_its_files(flat):
    assert filter_archive("logs") == 0
    assert set(outputs()) == {"a_ft.npz", "bb_ft.npz"}
    entry = manifest()[0]
    assert (entry.log, entry.files) == ("logs/a_ft.npz", ("logs/a_joints.npz", "logs/a_ft.npz"))
    sums = [hashlib.sha256(Path(path).read_bytes()).hexdigest() for path in entry.files]
    lines = "".join(f"{one}  {os.path.basename(path)}\n" for one, path in zip(sums, entry.files, strict=True))
    assert entry.state.sha256 == hashlib.sha256(lines.encode()).hexdigest()
    assert entry.state.bytes == sum(Path(path).stat().st_size for path in entry.files)
    (log,) = json.loads(str(outputs()["a_ft.npz"]["provenance"]))["logs"]
    assert [file["sha256"] for file in log["files"]] == sums
    assert (log["name"], log["sha256"]) == ("a_ft.npz", entry.state.sha256)


def test_a_log_is_another_one_if_any_of_its_files_is(flat):
    assert filter_archive("logs") == 0
    first = manifest()
    with np.load(flat / "a_joints.npz") as joints:
        changed = {**joints, "q": joints["q"] + 1e-4}
    np.savez(flat / "a_joints.npz", **changed)
    assert filter_archive("logs") == 0
    one, two = manifest()
    assert one.done > first[0].done
    assert two == first[1]


def test_a_missing_file_fails_its_log_alone(flat):
    (flat / "a_ft.npz").unlink()
    assert filter_archive("logs") == 3
    assert [(entry.log, entry.status) for entry in manifest()] == [
        ("logs/a_joints.npz", "failed"), ("logs/bb_ft.npz", "ok")]  # fmt: skip
    assert "a_ft.npz" in manifest()[0].error


def test_a_named_file_that_is_no_part_of_a_log_is_told(flat, capsys):
    assert filter_archive("logs/notes.npz") == 1
    assert "logs/notes.npz: does not match log.files of the setup" in capsys.readouterr().out
    assert main(["check", "empty*", "--setup", "setup.toml"]) == 2
    assert "a pattern of files that log.files names: *_joints.npz, *_ft.npz" in capsys.readouterr().err


def test_all_files_of_one_log_may_be_named_for_one_answer(flat, capsys):
    files = ["logs/a_joints.npz", "logs/a_ft.npz"]
    assert main(["filter", *files, "--setup", "setup.toml", "-o", "out.npz"]) == 0
    assert main(["filter", "logs", "--setup", "setup.toml", "-o", "out.npz"]) == 2
    assert "2 logs for the one file 'out.npz'" in capsys.readouterr().err


@pytest.mark.parametrize(
    "command",
    [
        "filter LOG -o logs/a_joints.npz",
        "check LOG --json logs/a_joints.json",
        "diagnose LOG --json logs/a_joints.json",
    ],
)
def test_no_file_of_a_log_is_written_over(flat, capsys, command):
    (flat / "a_joints.json").symlink_to("a_joints.npz")
    words = command.replace("LOG", "logs/a_ft.npz").split()
    assert main([*words, "--setup", "setup.toml"]) == 2
    assert "the same file as the input 'logs/a_joints.npz'" in capsys.readouterr().err


def test_check_gives_a_line_for_each_log_and_the_report_shows_it(flat):
    assert main(["check", "logs", "--setup", "setup.toml", "-o", "out"]) == 0
    entries = manifest("manifest.check.jsonl")
    assert [entry.output for entry in entries] == ["a_ft.check.json", "bb_ft.check.json"]
    assert main(["report", "out", "-o", "page.html"]) == 0
