"""Archives: which logs are found, what the manifest says, what is skipped, and what one bad log does to the others."""

import numpy as np
import pytest
from small_archive import SETUP, assert_same_outputs, filter_archive, manifest, outputs, write_log

from ftbias_jax.cli.jobs import archive, filter_many
from ftbias_jax.cli.jobs.archive import Task, find_logs
from ftbias_jax.cli.main import main
from ftbias_jax.errors import UsageError
from ftbias_jax.io.write import npz


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
    shares = [archive.shard(tasks, i, 4) for i in (1, 2, 3, 4)]
    assert sorted(map(len, shares)) == [2, 3, 3, 3]
    assert sorted((task for share in shares for task in share), key=lambda task: int(task.log)) == tasks


def test_one_bad_log_does_not_stop_the_others(logs, capsys):
    (logs / "day" / "b.npz").write_bytes(b"\x1b[2J no log")
    clipped = dict(npz.load_npz(logs / "day" / "c.npz"))
    clipped["wrench"][:, 1] = np.clip(9 * np.sin(np.arange(300) / 20), -9.5, 5)
    np.savez(logs / "day" / "c.npz", **clipped)
    assert filter_archive("logs") == 3
    assert [(entry.output, entry.status) for entry in manifest()] == [
        ("b.npz", "ok"), ("day/a.npz", "ok"), ("day/b.npz", "failed"), ("day/c.npz", "data loss")]  # fmt: skip
    bad, lossy = manifest()[2:]
    assert "is not an NPZ file" in bad.error
    assert lossy.repairs == [
        f"samples at the end of the sensor's range left out: {(clipped['wrench'] == 5).sum()} of fy"
    ]
    assert set(outputs()) == {"b.npz", "day/a.npz", "day/c.npz"}
    printed = capsys.readouterr()
    assert f"failed     {bad.error}" in printed.out
    assert "4 logs: 2 ok, 1 with data loss, 1 failed" in printed.out


def test_if_all_logs_fail_the_command_has_failed(logs):
    assert filter_archive("none.npz", "neither.csv") == 1


def test_a_result_is_that_of_the_single_command(logs):
    assert filter_archive("logs") == 0
    assert main(["filter", "logs/b.npz", "--setup", "setup.toml", "-o", "b.npz"]) == 0
    single = npz.load_npz("b.npz")
    assert_same_outputs({"b.npz": outputs()["b.npz"]}, {"b.npz": single})


def test_only_what_is_not_done_is_filtered_again(logs, monkeypatch):
    assert filter_archive("logs") == 0
    first, before = manifest(), outputs()
    done = []
    whole = filter_many.filter_task

    def counted(task, **rest):
        done.append(task.output)
        return whole(task, **rest)

    monkeypatch.setattr(filter_many, "filter_task", counted)

    def again(*more):
        done.clear()
        assert filter_archive("logs", *more) == 0
        return list(done)

    assert again() == []
    assert manifest() == first
    write_log(logs / "b.npz", 7)  # another log under the name
    (logs.parent / "out" / "day" / "a.npz").write_bytes(b"cut")
    assert again() == ["b.npz", "day/a.npz"]
    assert again() == []
    assert again("--smooth") == again() == ["b.npz", "day/a.npz", "day/c.npz"]
    (logs.parent / "setup.toml").write_text(SETUP.replace("0.7", "0.8"))
    assert again() == ["b.npz", "day/a.npz", "day/c.npz"]
    (logs.parent / "out" / "manifest.json").write_text("{")
    assert len(again()) == 3
    assert outputs().keys() == before.keys()


def test_shards_write_their_own_manifests_and_know_each_other_s(logs, capsys):
    assert filter_archive("logs", "--shard", "1/2") == 0
    assert filter_archive("logs", "--shard", "2/2") == 0
    assert [entry.output for entry in manifest("manifest-1-of-2.json")] == ["b.npz", "day/c.npz"]
    assert [entry.output for entry in manifest("manifest-2-of-2.json")] == ["day/a.npz"]
    capsys.readouterr()
    assert filter_archive("logs") == 0
    assert "3 logs: 3 ok, 0 with data loss, 0 failed (3 of all were done before)" in capsys.readouterr().out


def test_a_log_whose_process_was_killed_has_failed(monkeypatch):
    monkeypatch.setattr(filter_many, "run_each", lambda work, tasks, jobs: ((task, None) for task in tasks))
    (entry,) = filter_many.run_tasks(None, [Task("deadly", "deadly.npz")], 2)
    assert (entry.log, entry.output, entry.status) == ("deadly", "deadly.npz", "failed")
    assert "its process was killed" in entry.error


def test_processes_give_the_results_of_one(logs):
    assert filter_archive("logs") == 0
    expected, entries = outputs(), manifest()
    for path in (logs.parent / "out").rglob("*.*"):
        path.unlink()
    assert filter_archive("logs", "--jobs", 2) == 0
    assert_same_outputs(outputs(), expected)
    assert manifest() == entries  # in the same order


@pytest.mark.parametrize("option", [["--plot", "a.png"], ["--check"], ["--offsets", "a.yaml"]])
def test_options_of_a_single_log_are_refused(logs, capsys, option):
    assert filter_archive("logs", *option) == 2
    assert "needs a single log" in capsys.readouterr().err


def test_many_logs_need_a_folder(logs, capsys):
    assert main(["filter", "logs/b.npz", "logs/day/a.npz", "--setup", "setup.toml", "-o", "out.npz"]) == 2
    assert "2 logs for the one file 'out.npz'" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["0/2", "3/2", "1", "1/0", "a/b", "1.5/2"])
def test_shards_are_numbered_from_one(capsys, text):
    with pytest.raises(SystemExit) as end:
        main(["filter", "logs", "--setup", "setup.toml", "-o", "out", "--shard", text])
    assert end.value.code == 2
    assert "must be I/N with I from 1 to N" in capsys.readouterr().err
