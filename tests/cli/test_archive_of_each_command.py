"""Commands over archives: a result and a line for every log, and an exit code for all."""

import json
from pathlib import Path

import numpy as np
import pytest
from made_diagnoses import candidate
from small_archive import SETUP, manifest, write_log
from small_checks import right_log

from ftbias_jax.calibration import identify
from ftbias_jax.cli.commands.tune import usable
from ftbias_jax.cli.main import main
from ftbias_jax.diagnosis import diagnose as diagnosing
from ftbias_jax.setup import dump_setup, load_setup, parse_setup


def run(command, *arguments):
    return main([command, *map(str, arguments), "--setup", "setup.toml", "-o", "out"])


def files():
    return sorted(str(path.relative_to("out")) for path in Path("out").rglob("*") if path.is_file())


@pytest.fixture
def swapped(tmp_path, monkeypatch):
    """Three logs of a six-joint arm; in the last one force and torque are swapped."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "logs").mkdir()
    for seed in range(3):
        tables, arrays = right_log(seed)
        order = [3, 4, 5, 0, 1, 2] if seed == 2 else slice(None)
        np.savez(tmp_path / "logs" / f"{seed}.npz", **{**arrays, "wrench": arrays["wrench"][:, order]})
    (tmp_path / "setup.toml").write_text(dump_setup(parse_setup(tables)))
    return tmp_path / "logs"


def test_check_tells_each_log_s_mistakes(swapped, capsys):
    (swapped / "1.npz").write_bytes(b"no log")
    assert run("check", "logs") == 1
    entries = manifest("manifest.check.jsonl")
    assert [entry.status for entry in entries] == ["ok", "failed", "mistakes"]
    assert entries[2].quality["findings"] == ["force_torque_swapped"]
    assert files()[:2] == ["0.check.json", "2.check.json"]
    assert json.loads(Path("out/2.check.json").read_text())["ok"] is False
    assert "3 logs: 1 ok, 1 with mistakes, 0 with data loss, 1 failed\n" in capsys.readouterr().out
    assert run("check", "logs") == 1
    assert "failed (2 of all were done before)" in capsys.readouterr().out


def test_one_log_that_cannot_be_checked_is_lost_and_all_are_a_failure(logs):
    (logs / "b.npz").write_bytes(b"no log")
    assert run("check", "logs", "--shard", "1/2") == 3  # b and day/c
    assert run("check", "logs/b.npz") == 1


def test_folders_are_searched_for_a_single_answer_too(logs, capsys):
    assert main(["check", "logs", "--setup", "setup.toml", "--json", "check.json"]) == 0
    assert json.loads(Path("check.json").read_text())["ok"] is True


def test_diagnose_writes_answer_and_report_of_each_log(logs, monkeypatch, make_diagnosis):
    explained, unknown = make_diagnosis(), make_diagnosis(verdict="unknown", causes=())
    answers = {"b.npz": explained, "a.npz": unknown}

    def diagnosed(setup, read, names, without, unchecked):
        if names[0] not in answers:
            raise ValueError("a bug")
        return answers[names[0]]

    monkeypatch.setattr(diagnosing, "diagnose", diagnosed)
    assert run("diagnose", "logs") == 3
    first, second, third = manifest("manifest.diagnose.jsonl")
    assert (first.quality["verdict"], second.quality["verdict"]) == ("explained", "unknown")
    assert first.quality["causes"] == [cause.effect for cause in explained.causes]
    assert first.quality["gap_sigmas"] == pytest.approx(explained.gap.before_sigmas, rel=1e-5)
    assert first.quality["shrink"] == pytest.approx(explained.gap.shrink, rel=1e-5)
    assert (third.status, third.error) == ("failed", "logs/day/c.npz: ValueError: a bug")
    assert files()[:4] == ["b.diagnosis.html", "b.diagnosis.json", "day/a.diagnosis.html", "day/a.diagnosis.json"]


def test_diagnose_writes_the_setup_with_the_causes_of_each_log(logs, monkeypatch, make_diagnosis, capsys):
    cause = candidate()
    beyond = cause._replace(parameters=dict.fromkeys(cause.parameters, 1000000000.0))
    answers = {
        "b.npz": make_diagnosis(causes=(cause,)),
        "a.npz": make_diagnosis(causes=(beyond,)),
        "c.npz": make_diagnosis(verdict="none", causes=()),
    }
    monkeypatch.setattr(diagnosing, "diagnose", lambda setup, read, names, **more: answers[names[0]])
    monkeypatch.setattr("ftbias_jax.commissioning.judged.objection", lambda setup, diagnosis, logs: "")
    assert run("diagnose", "logs", "--apply") == 3
    entries = manifest("manifest.diagnose.jsonl")
    assert [entry.status for entry in entries] == ["ok", "data loss", "ok"]
    assert entries[1].repairs[0].startswith("not applied: ")
    assert "not applied: " in capsys.readouterr().out
    found = {path: load_setup(Path("out", path)).effects for path in files() if path.endswith(".applied.toml")}
    assert found == {"b.applied.toml": {cause.effect: cause.parameters}, "day/c.applied.toml": {}}
    assert load_setup("setup.toml").effects == {}


def test_a_setup_that_predicts_a_log_of_many_worse_is_not_written(logs, monkeypatch, make_diagnosis, capsys):
    """The causes are made up; the stated setup is right."""
    answer = make_diagnosis(causes=(candidate(),))
    monkeypatch.setattr(diagnosing, "diagnose", lambda setup, read, names, **more: answer)
    assert run("diagnose", "logs/b.npz", "--apply") == 3
    (entry,) = manifest("manifest.diagnose.jsonl")
    assert "predicts these logs worse" in entry.repairs[0]
    assert not any(path.endswith(".applied.toml") for path in files())


def test_a_setup_with_causes_replaces_no_input(logs, capsys):
    Path("logs/b.applied.toml").write_text(SETUP)
    line = ["diagnose", "logs/b.npz", "--setup", "logs/b.applied.toml", "-o", "logs"]
    assert main([*line, "--apply"]) == 2
    assert "the result of 'logs/b.npz' (.applied.toml)" in capsys.readouterr().err
    assert Path("logs/b.applied.toml").read_text() == SETUP


def test_identify_writes_a_setup_of_each_log(logs):
    assert run("identify", "logs/b.npz") == 0
    (entry,) = manifest("manifest.identify.jsonl")
    assert entry.quality["mass"] == pytest.approx(0.7, abs=4 * entry.quality["mass_std"])
    assert files()[0] == "b.identified.toml"


def test_logs_of_similar_length_are_identified_by_one_program(logs):
    write_log(logs / "day" / "a.npz", 0, samples=290)
    run("identify", "logs/b.npz")
    programs = len(identify._linearised._ready)
    run("identify", "logs/day/a.npz")
    assert len(identify._linearised._ready) == programs > 0


def test_many_logs_need_a_folder_for_what_is_identified(logs, capsys):
    assert main(["identify", "logs/b.npz", "logs/day/a.npz", "--setup", "setup.toml", "-o", "out.toml"]) == 2
    assert "2 logs for one setup" in capsys.readouterr().err


QUICK = ("--fit", "joints", "--hold-out", "0", "--restarts", "0")


def test_one_bad_log_does_not_end_tune(logs, capsys):
    (logs / "day" / "c.npz").write_bytes(b"no log")
    assert main(["tune", "logs", "--setup", "setup.toml", "-o", "tuned.toml", *QUICK]) == 3
    assert "warning: left out: logs/day/c.npz: is not an NPZ file" in capsys.readouterr().err
    assert Path("tuned.toml").exists()
    for name in ("b.npz", "day/a.npz"):
        (logs / name).write_bytes(b"no log")
    assert main(["tune", "logs", "--setup", "setup.toml", "-o", "none.toml", *QUICK]) == 1
    assert capsys.readouterr().err.startswith("ftbias: logs/b.npz: is not an NPZ file")
    assert not Path("none.toml").exists()


def test_tune_writes_a_setup_of_each_log(logs):
    (logs / "b.npz").write_bytes(b"no log")
    assert run("tune", "logs", *QUICK) == 3
    entries = manifest("manifest.tune.jsonl")
    assert [entry.status for entry in entries] == ["failed", "ok", "ok"]
    assert len(entries[1].quality["noise_density"]) == 6
    assert files()[:2] == ["day/a.tuned.toml", "day/c.tuned.toml"]


def test_a_log_with_other_conventions_is_left_out(swapped, capsys):
    setup = load_setup("setup.toml")
    paths = [f"logs/{seed}.npz" for seed in range(3)]
    found = usable(setup, paths, unchecked=False)
    assert list(found.logs) == paths[:2]
    assert "logs/2.npz: setup.toml: force_torque_swapped" in str(found.errors["logs/2.npz"])
    assert usable(setup, paths, unchecked=True).errors == {}
    assert usable(setup, paths[2:], unchecked=False).errors == {}  # the setup is wrong, not the log


@pytest.mark.parametrize(
    ("line", "option"),
    [
        ("filter logs --plot a.png", "--plot"),
        ("filter logs --check", "--check"),
        ("filter logs --offsets a.yaml", "--offsets"),
        ("check logs --json a.json", "--json"),
        ("diagnose logs --apply --in-place", "--in-place"),
        ("diagnose logs --html a.html", "--html"),
        ("identify logs --in-place", "--in-place"),
        ("tune logs --in-place", "--in-place"),
        ("tune logs --distributed localhost:1,2,0", "--distributed"),
    ],
)
def test_options_of_a_single_answer_are_refused(logs, capsys, line, option):
    command, *rest = line.split()
    assert run(command, *rest) == 2
    assert f"{option}: needs a single log" in capsys.readouterr().err
    assert not Path("out").exists()
