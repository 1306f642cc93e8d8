import subprocess
import sys
from pathlib import Path

import pytest

import validation
from validation import protocols
from validation.__main__ import main
from validation.generator import make


@pytest.fixture(autouse=True)
def quiet(monkeypatch):
    monkeypatch.setattr("ftbias_jax.runtime.jax_config.prepare_jax", lambda: None)


def test_make_writes_a_set_and_refuses_to_mix_two(tmp_path, capsys):
    out = tmp_path / "new" / "set"
    command = ["make", str(out), "--count", "2", "--duration", "2,3", "--rate", "100", "--effects", "gain"]
    assert main(command) == 0
    assert sorted(path.name for path in out.iterdir()) == [
        *(f"log_00{i}.{end}" for i in range(2) for end in ("npz", "toml")),
        "truth.json",
    ]
    assert capsys.readouterr().out == f"wrote 2 logs with their setups and truth.json to {out}\n"
    assert main(command) == 1
    assert "holds a set already" in capsys.readouterr().err


def test_make_writes_pairs_of_unlisted_kinds(tmp_path, capsys):
    out = tmp_path / "set"
    command = ["make", str(out), "--protocol", "unlisted", "--kinds", "unseen", "--count", "1"]
    assert main([*command, "--duration", "2", "--rate", "100"]) == 0
    assert sorted(str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()) == sorted(
        f"{place}{name}"
        for place in ("", "second/")
        for name in ("extra/log_000.npz", "log_000.npz", "log_000.toml", "truth.json")
    )
    assert capsys.readouterr().out == f"wrote 1 pairs of logs with their setups and truth.json to {out}\n"
    assert main(command) == 1
    assert "holds a set already" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("--kinds all", "--kinds: says nothing to the protocol"),
        ("--protocol unlisted --effects gain", "--effects: says nothing to the protocol"),
        ("--effects gain,tool_mas", "--effects: no effect is called 'tool_mas'"),
        ("--count 1 --duration 1e30", "samples a log do not fit the memory"),
    ],
)
def test_what_make_cannot_do_is_refused_before_anything_is_written(tmp_path, capsys, options, words):
    assert main(["make", str(tmp_path / "set"), *options.split()]) == 2
    assert words in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_set_of_logs_that_is_interrupted_has_no_half_log(tmp_path, monkeypatch):
    """A file with a log's name is complete: an unfinished one never has that name."""

    def interrupted(file, **columns):
        file.write(b"half a log")
        raise KeyboardInterrupt

    monkeypatch.setattr(make.np, "savez_compressed", interrupted)
    assert main(["make", str(tmp_path / "set"), "--count", "1", "--duration", "3,4", "--effects", "none"]) == 1
    assert list((tmp_path / "set").iterdir()) == []


@pytest.mark.parametrize("option", ["--count 0", "--count x", "--duration 5,-1", "--rate nan", "--jobs 0"])
def test_numbers_are_checked(capsys, option):
    with pytest.raises(SystemExit) as end:
        main(["make", "set", *option.split()])
    assert end.value.code == 2


@pytest.mark.parametrize(
    ("options", "protocol", "verdicts", "score"),
    [
        ("", "withheld", "verdicts", "verdicts/score.json"),
        ("--leave-one-out", "leave_one_out", "verdicts_without", "verdicts_without/score.json"),
        ("--out mine --json score.json --jobs 3", "withheld", "mine", "score.json"),
    ],
)
def test_score_prints_and_writes(make_set, monkeypatch, capsys, options, protocol, verdicts, score):
    folder = make_set({"log_000": {}})
    monkeypatch.chdir(folder)
    calls = []

    def stand_in(folder, logs, out, jobs):
        calls.append((out, jobs, [log.name for log in logs]))
        out.mkdir()
        return protocols.Score("the table", {"logs": 1}, {"log_000": "it broke"})

    monkeypatch.setattr(protocols, protocol, stand_in)
    assert main(["score", ".", *options.split()]) == 1
    printed = capsys.readouterr()
    assert printed.out.startswith(f"the table\nwrote {score}; ")
    assert printed.err == "warning: log_000: no diagnosis: it broke\n"
    assert (folder / score).read_text() == '{\n "logs": 1\n}\n'
    ((out, jobs, logs),) = calls
    assert (out.name, jobs, logs) == (verdicts, 3 if "jobs" in options else 1, ["log_000.npz"])


@pytest.mark.parametrize(
    "options",
    [
        "--json truth.json",
        "--json link.json",
        "--json log_0.toml",
        "--out verdicts --json verdicts/log_0.json",
        "--leave-one-out --json link.json",
    ],
)
def test_the_score_replaces_nothing_of_the_set_and_no_verdict(make_set, monkeypatch, capsys, options):
    folder = make_set({"log_0": {}})
    monkeypatch.chdir(folder)
    (folder / "link.json").symlink_to("truth.json")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert main(["score", ".", *options.split()]) == 2
    assert "is the same file as" in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_it_runs_as_a_folder():
    folder = Path(validation.__file__).parent
    words = [sys.executable, str(folder), "make", "set", "--protocol", "unlisted", "--effects", "gain"]
    done = subprocess.run(words, capture_output=True, text=True)
    message = "validation: --effects: says nothing to the protocol unlisted"
    assert (done.returncode, done.stderr.startswith(message)) == (2, True), done.stderr
