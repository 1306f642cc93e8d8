"""Which logs are found, where their results are written, and which share of them a machine processes."""

import os

import pytest

from ftbias_jax.errors import UsageError
from ftbias_jax.fleet.find import Task, expand, find_logs, is_folder, shard


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["logs"], ["b", "day/a", "day/c"]),
        (["logs/day/c.npz"], ["c"]),
        (["logs/day/c.npz", "logs/b.npz"], ["b", "day/c"]),
        (["logs/*/*.npz"], ["day/a", "day/c"]),
        (["logs/**/a.npz"], ["day/a"]),
        (["logs/day", "logs"], ["b", "day/a", "day/c"]),
        (["none.npz"], ["none"]),
    ],
)
def test_logs_are_found_and_keep_their_places(logs, arguments, expected):
    (logs / "notes.txt").write_text("no log")
    (logs / ".hidden.npz").write_text("no log")
    tasks = find_logs(arguments, "out", ".csv")
    assert [task.output for task in tasks] == [f"{name}.csv" for name in expected]


def test_a_bag_s_folder_is_one_log(logs):
    (logs / "day" / "bag").mkdir()
    for name in ("metadata.yaml", "bag_0.mcap", "bag_1.mcap"):
        (logs / "day" / "bag" / name).touch()
    assert "day/bag.npz" in [task.output for task in find_logs(["logs"], "out", ".npz")]
    assert find_logs(["logs/day/bag"], "out", ".npz") == [Task("logs/day/bag", "bag.npz")]


def test_the_output_folder_is_not_searched(logs):
    assert len(find_logs([str(logs)], str(logs / "day"), ".npz")) == 1


@pytest.mark.parametrize("argument", ["empty", "logs/*.bag"])
def test_arguments_without_logs_are_refused(logs, argument):
    (logs.parent / "empty").mkdir()
    with pytest.raises(UsageError, match="no log in"):
        find_logs(["logs", argument], "out", ".npz")


def test_two_logs_for_one_result_are_refused(logs):
    (logs / "b.csv").touch()
    with pytest.raises(UsageError, match=r"'logs/b.csv' and 'logs/b.npz' would both be written to 'b.npz'"):
        find_logs(["logs"], "out", ".npz")


def test_shards_are_all_logs_once():
    tasks = [Task(str(i), str(i)) for i in range(11)]
    shares = [shard(tasks, i, 4) for i in (1, 2, 3, 4)]
    assert sorted(map(len, shares)) == [2, 3, 3, 3]
    assert sorted((task for share in shares for task in share), key=lambda task: int(task.log)) == tasks


def test_folders_and_patterns_become_the_logs_in_them(logs):
    (logs / "other.csv").touch()
    assert expand(["logs/day/c.npz", "logs/day", "logs/*.npz"]) == ["logs/day/c.npz", "logs/day/a.npz", "logs/b.npz"]
    assert expand(["none.npz"]) == ["none.npz"]  # a reader reports it as missing
    with pytest.raises(UsageError, match="no log in"):
        expand([os.fspath(logs), "logs/*.bag"])


def test_a_name_without_a_suffix_is_a_folder(tmp_path):
    (tmp_path / "a.b").mkdir()
    names = ("results", "results.old/", os.fspath(tmp_path / "a.b"), "result.npz")
    assert list(map(is_folder, names)) == [True, True, True, False]
