"""Archives: content of the manifest, which logs are skipped, and the effect of one bad log on the others."""

import importlib.util
import json
import os
from contextvars import Context

import numpy as np
import pytest
from pyarrow import parquet
from small_archive import SETUP, assert_same_outputs, filter_archive, manifest, outputs, write_log

from ftbias_jax.cli import archive
from ftbias_jax.cli.main import main
from ftbias_jax.fleet.entry import Settings
from ftbias_jax.fleet.find import Task
from ftbias_jax.fleet.manifest import Manifest, read_manifests
from ftbias_jax.fleet.place import Place
from ftbias_jax.io.write import npz


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
    assert lossy.repairs == (
        f"samples at the end of the sensor's range left out: {(clipped['wrench'] == 5).sum()} of fy",
    )
    assert set(outputs()) == {"b.npz", "day/a.npz", "day/c.npz"}
    printed = capsys.readouterr()
    assert f"failed     {bad.error}" in printed.out
    assert "4 logs: 2 ok, 1 with data loss, 1 failed" in printed.out


def test_if_all_logs_fail_the_command_has_failed(logs):
    assert filter_archive("none.npz", "neither.csv") == 1


def test_a_result_is_that_of_the_single_command(logs):
    assert filter_archive("logs") == 0
    assert main(["filter", "logs/b.npz", "--setup", "setup.toml", "-o", "b.npz"]) == 0
    of_archive = outputs()["b.npz"]
    for name, values in npz.load_npz("b.npz").items():
        if values.dtype.kind == "f":  # a single short log is compiled for few calls, which rounds differently
            np.testing.assert_allclose(of_archive[name], values, rtol=1e-6, atol=1e-15)
        else:
            np.testing.assert_array_equal(of_archive[name], values)


def test_results_have_the_fields_and_the_rate_asked_for_and_are_made_again_for_others(logs):
    few = ("--fields", "bias,contact_wrench", "--every", "3")
    assert filter_archive("logs", *few) == 0
    before = outputs()
    assert {len(arrays["t"]) for arrays in before.values()} == {100}
    assert all(arrays.keys() == {"t", "bias", "contact_wrench", "about", "provenance"} for arrays in before.values())
    assert filter_archive("logs", "--every", "4") == 0
    assert {len(arrays["t"]) for arrays in outputs().values()} == {75}
    assert filter_archive("logs", "--fields", "bias_smooth") == 2


def test_error_bars_contain_the_stated_error_of_the_tool(logs, capsys):
    assert filter_archive("logs/b.npz", "--smooth") == 0
    before = outputs()["b.npz"]
    (logs.parent / "setup.toml").write_text(SETUP.replace("mass = 0.7", "mass = 0.7\nmass_std = 0.07"))
    assert filter_archive("logs/b.npz", "--smooth") == 0
    after = outputs()["b.npz"]
    for name in ("bias_std", "contact_wrench_std", "bias_smooth_std"):
        np.testing.assert_allclose(after[name], np.hypot(before[name], 0.1 * before["wrench_tool"]), rtol=1e-5)
    np.testing.assert_array_equal(after["bias"], before["bias"])
    assert "the error bars include the uncertainty of the tool" in manifest()[0].repairs[0]


@pytest.fixture
def done(monkeypatch):
    """Outputs of the logs that were processed."""
    done, whole = [], archive.do_task

    def counted(task, **rest):
        done.append(task.output)
        return whole(task, **rest)

    monkeypatch.setattr(archive, "do_task", counted)
    return done


@pytest.mark.slow
def test_only_what_is_not_done_is_filtered_again(logs, done):
    def again(*more):
        done.clear()
        assert filter_archive("logs", *more) == 0
        return list(done)

    assert again() == ["b.npz", "day/a.npz", "day/c.npz"]
    first, before = manifest(), outputs()
    assert again() == []
    assert manifest() == first
    write_log(logs / "b.npz", 7)  # another log under the same name
    (logs.parent / "out" / "day" / "a.npz").write_bytes(b"cut")
    assert again() == ["b.npz", "day/a.npz"]
    assert again() == []
    assert again("--smooth") == again() == ["b.npz", "day/a.npz", "day/c.npz"]
    (logs.parent / "setup.toml").write_text(SETUP.replace("0.7", "0.8"))
    assert again() == ["b.npz", "day/a.npz", "day/c.npz"]
    (logs.parent / "out" / "manifest.filter.jsonl").write_text("{")
    assert len(again()) == 3
    assert again() == []
    assert outputs().keys() == before.keys()


def test_verify_makes_results_again_whose_bytes_rotted_at_the_same_size(logs, done):
    assert filter_archive("logs") == 0
    path = logs.parent / "out" / "day" / "a.npz"
    whole = path.read_bytes()
    path.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    for option, expected in (((), []), (("--verify",), ["day/a.npz"]), (("--verify",), [])):
        done.clear()
        assert filter_archive("logs", *option) == 0
        assert done == expected
    assert path.read_bytes() == whole


def test_damaged_lines_of_the_manifest_are_told(logs, done, capsys):
    assert filter_archive("logs") == 0
    path = logs.parent / "out" / "manifest.filter.jsonl"
    path.write_text(path.read_text().replace('"status":"ok"', '"status":["ok"]', 1))
    done.clear()
    capsys.readouterr()
    assert filter_archive("logs") == 0
    assert len(done) == 1
    assert "warning: 1 line of the manifest could not be read, their logs are done again" in capsys.readouterr().err


def test_logs_whose_names_are_no_utf8_are_worked_on_and_reported(logs, capsys):
    name = os.fsdecode(b"caf\xe9.npz")
    os.rename(logs / "b.npz", logs / name)
    assert filter_archive("logs") == 0
    assert manifest()[0].output.startswith(("caf", "day"))
    assert os.path.isfile(os.path.join("out", name))
    assert main(["check", "logs", "--setup", "setup.toml", "-o", "out"]) == 0
    with open(os.path.join("out", os.path.splitext(name)[0] + ".diagnosis.html"), "w") as report:
        report.write("")  # as diagnose would have written it
    line = manifest()[0]._replace(
        log=f"logs/{name}", output=os.path.splitext(name)[0] + ".diagnosis.json", quality={"verdict": "unknown"}
    )
    with Manifest("out/manifest.diagnose.jsonl") as written:
        written.add_entry(line)
    assert main(["report", "out", "-o", "page.html"]) == 0
    with open("page.html", encoding="utf-8") as page:
        text = page.read()
    assert "caf%E9.diagnosis.html" in text  # the bytes of the name
    assert "caf\N{REPLACEMENT CHARACTER}.npz" in text
    if importlib.util.find_spec("pyarrow"):
        parquet = importlib.import_module("pyarrow.parquet")
        assert r"caf\udce9.npz" in parquet.read_table("out/manifest.filter.parquet").to_pydict()["output"]
    capsys.readouterr()


def test_a_log_is_known_by_its_content_not_by_its_times(logs, done):
    assert filter_archive("logs") == 0
    restored, forged = logs / "b.npz", logs / "day" / "a.npz"
    os.utime(restored, ns=(0, 0))  # the same log from a backup
    times = forged.stat()
    size = len(forged.read_bytes())
    write_log(forged, 9)  # another log with the size and modification time of the old one
    os.utime(forged, ns=(times.st_atime_ns, times.st_mtime_ns))
    assert len(forged.read_bytes()) == size
    done.clear()
    assert filter_archive("logs") == 0
    assert done == ["day/a.npz"]


def test_results_of_an_old_manifest_are_not_made_again(logs, done):
    assert filter_archive("logs") == 0
    path = logs.parent / "out" / "manifest.filter.jsonl"
    (settings,) = read_manifests("out").settings.values()
    old = [
        {
            **{name: getattr(entry, name) for name in ("log", "output", "status", "error", "samples", "output_bytes")},
            "repairs": list(entry.repairs),
            "made_from": {
                "log_bytes": entry.state.bytes,
                "log_modified_ns": entry.state.modified_ns,
                **{name: getattr(settings, name) for name in ("setup_sha256", "choices", "version")},
            },
        }
        for entry in manifest()
    ]
    path.with_name("manifest.json").write_text(json.dumps({"schema": 1, "logs": old}))
    path.unlink()
    done.clear()
    write_log(logs / "b.npz", 7, 301)
    assert filter_archive("logs") == 0
    assert done == ["b.npz"]


def test_the_manifest_has_the_quality_of_every_log(logs):
    assert filter_archive("logs") == 0
    result, entry = outputs()["b.npz"], manifest()[0]
    np.testing.assert_allclose(entry.quality["bias"], result["bias"][-1], rtol=1e-5)
    np.testing.assert_allclose(entry.quality["bias_std"], result["bias_std"][-1], rtol=1e-5)
    measured = np.isfinite(result["innovation"])
    assert entry.quality["nis"] == pytest.approx(result["nis"].sum() / measured.sum(), rel=1e-5)
    assert entry.quality["gated_share"] == pytest.approx(1 - measured.any(1).mean())
    assert (entry.quality["findings"], entry.quality["date"], entry.samples) == ([], None, 300)
    left = (result["wrench_unbiased"] - result["wrench_tool"]).std(0)
    np.testing.assert_allclose(entry.quality["residual_std"], left, rtol=1e-5)


def test_the_manifest_is_also_a_table(logs):
    assert filter_archive("logs") == 0
    table = parquet.read_table("out/manifest.filter.parquet").to_pydict()
    assert table["log"] == [entry.log for entry in manifest()]
    assert table["bias_tz"] == [entry.quality["bias"][5] for entry in manifest()]
    assert table["setup"] == ["setup.toml"] * 3


def test_nothing_is_said_of_a_table_where_it_cannot_be_written(logs, monkeypatch, capsys):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert filter_archive("logs") == 0
    assert capsys.readouterr().out.endswith("wrote out/manifest.filter.jsonl\n")


def test_shards_write_their_own_manifests_and_know_each_other_s(logs, capsys):
    assert filter_archive("logs", "--shard", "1/2") == 0
    assert filter_archive("logs", "--shard", "2/2") == 0
    assert [entry.output for entry in manifest("manifest.filter.1-of-2.jsonl")] == ["b.npz", "day/c.npz"]
    assert [entry.output for entry in manifest("manifest.filter.2-of-2.jsonl")] == ["day/a.npz"]
    capsys.readouterr()
    assert filter_archive("logs") == 0
    assert "3 logs: 3 ok, 0 with data loss, 0 failed (3 of all were done before)" in capsys.readouterr().out


def test_a_log_whose_process_was_killed_has_failed(monkeypatch):
    monkeypatch.setattr(
        "ftbias_jax.runtime.executors.run_each", lambda work, tasks, jobs: ((task, None) for task in tasks)
    )
    job = archive.Job(Settings("filter", "", {}, ""), Place("out"), None, None, {})
    (entry,) = archive.run_tasks(job, [Task("deadly", "deadly.npz")], 2)
    assert (entry.log, entry.output, entry.status) == ("deadly", "deadly.npz", "failed")
    assert "its process was killed" in entry.error


def lasting(entry):
    """The part of an entry that does not depend on when a log was filtered."""
    return entry._replace(seconds=0, done=0)


def test_processes_give_the_results_of_one(logs):
    assert Context().run(filter_archive, "logs") == 0  # with programs compiled like those of separate processes
    expected, entries = outputs(), manifest()
    for path in (logs.parent / "out").rglob("*.*"):
        path.unlink()
    assert filter_archive("logs", "--jobs", 2) == 0
    assert_same_outputs(outputs(), expected)
    assert list(map(lasting, manifest())) == list(map(lasting, entries))
